"""Volumes that mark a part of the MR: a brain mask, a label, what was resected. Above 0 is marked, whatever the number."""
import numpy as np

from cortshift_tracking.errors import VolumeError
from cortshift_tracking.mr.reader import load_volume
from cortshift_tracking.mr.volume import Volume


def load_marked(source, one_structure=False):
    """Volume of 0 and 1 (float32) of an MrSource; what is not a number marks nothing.

    Form and series of the MrSource are those of the MR: the form counts only where this file's header leaves a choice, the series not at all.
    one_structure: refuse a file that numbers several. Raises VolumeError.
    """
    volume = load_volume(source.path, source.axes, source.form, template_space=source.template_space, form_decides=False)
    marked = volume.data > 0
    if volume.unknown is not None:
        marked &= ~volume.unknown
    values = np.unique(volume.data[marked])
    if one_structure and len(values) > 1 and (values == np.round(values)).all():
        told = ', '.join(f'{value:g}' for value in values[:6]) + (' ...' if len(values) > 6 else '')
        raise VolumeError(f'{source.path}: numbers several structures ({told}); give a file for each, which is 0 everywhere else')
    return Volume(marked.astype(np.float32), volume.T_pmr_voxel, volume.axes, volume.source, volume.notes, warnings=volume.warnings)
