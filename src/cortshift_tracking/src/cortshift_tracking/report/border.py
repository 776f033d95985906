"""How far the border of a field moves, where nothing should: the paper's own check of the alignment (section 3.2)."""
import numpy as np
from scipy import ndimage


def immobile_misalignment(field, border=0.004):
    """Displacement of features that should not move, around the craniotomy.

    The outermost valid points of the field, `border` [m] wide, are taken for the rim.
    Returns of the displacement there: median and 95th percentile of its length, length of its median vector (a misalignment
    of the tool tracking moves all of it alike) [m], and the number of points; NaN where there is none.
    """
    valid = field.valid
    filled = ndimage.binary_fill_holes(valid)
    distance = ndimage.distance_transform_edt(np.pad(filled, 1))[1:-1, 1:-1] * field.resolution
    rim = valid & (distance <= border)
    if not rim.any():
        return float('nan'), float('nan'), float('nan'), 0
    magnitude = np.linalg.norm(field.displacement[rim], axis=-1)
    common = np.linalg.norm(np.median(field.displacement[rim], axis=0))
    return float(np.median(magnitude)), float(np.percentile(magnitude, 95)), float(common), int(rim.sum())
