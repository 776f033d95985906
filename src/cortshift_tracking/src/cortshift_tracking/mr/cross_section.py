"""Sections of organised surfaces and of MR volumes by planes across one axis of pmr (paper Figs. 2d, 11a, 12a)."""
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from cortshift_tracking.geometry import median_spacing, triangles

#: Axis of pmr that a plane is perpendicular to.
PLANES = {'sagittal': 0, 'coronal': 1, 'axial': 2}
#: What the pmr axes point to: (negative end, positive end).
LETTERS = {'RAS': ('LR', 'PA', 'IS'), 'LPS': ('RL', 'AP', 'IS')}
#: A section draws no point of lower confidence. At 0.7 the disparity is expected to deviate by 0.065 px, which at 300 mm from
#: the phantom's stereo head is 0.06 mm in depth: five standard deviations stay within the 0.3 mm that a section is read to.
SECTION_CONFIDENCE = 0.7


@dataclass(frozen=True)
class PictureAxes:
    """How a plane is shown: radiological, so the patient's right is at the left; sagittal with the face at the left."""
    across: int           # pmr axis that runs horizontally
    up: int               # pmr axis that runs vertically
    flip_across: bool     # the axis grows towards the left
    flip_up: bool         # the axis grows downwards
    letters: Tuple[str, str, str, str]  # body directions at the left, right, bottom and top of the picture


def picture_axes(plane, axes='RAS'):
    """PictureAxes of 'axial', 'coronal' or 'sagittal' in a pmr with `axes` RAS or LPS."""
    across, up = {'axial': (0, 1), 'coronal': (0, 2), 'sagittal': (1, 2)}[plane]
    left_wanted = 'R' if across == 0 else 'A'
    top_wanted = 'A' if up == 1 else 'S'
    flip_across = LETTERS[axes][across][0] != left_wanted
    flip_up = LETTERS[axes][up][1] != top_wanted
    horizontal = LETTERS[axes][across][::-1 if flip_across else 1]
    vertical = LETTERS[axes][up][::-1 if flip_up else 1]
    return PictureAxes(across, up, flip_across, flip_up, tuple(horizontal + vertical))


def mr_section(volume, plane, at, low, high, step):
    """Intensities of a volume on a plane.

    at: coordinate of the plane on its axis [m]. low, high: corners (across, up) of the shown part [m]; step [m].
    Returns (rows, columns), row 0 at low[1]; NaN outside the volume.
    """
    shown = picture_axes(plane, volume.axes)
    u = np.arange(low[0], high[0] + step / 2, step)
    v = np.arange(low[1], high[1] + step / 2, step)
    points = np.empty((len(v), len(u), 3))
    points[..., PLANES[plane]] = at
    points[..., shown.across] = u
    points[..., shown.up] = v[:, None]
    return volume.sample(points)


def sure_points(points, confidence):
    """The surface (H, W, 3) without the points (NaN) that its reconstruction does not trust enough for a section.

    confidence: (H, W) 0-1 of the reconstruction.
    """
    return np.where((np.asarray(confidence) >= SECTION_CONFIDENCE)[..., None], points, np.nan)


def cut(points_pmr, axis, at, max_edge=None):
    """Section of an organised surface (H, W, 3) [m] by the plane coordinate[axis] = at.

    Linear within each triangle, so exact for the mesh. Returns segments (N, 2, 3) [m].
    max_edge: longest edge of an uncut triangle [m]; by default six times the surface's median spacing.
    """
    points = np.asarray(points_pmr, float)
    if max_edge is None:
        max_edge = 6 * median_spacing(points)
    corners = triangles(points, max_edge)
    flat = points.reshape(-1, 3)
    height = flat[:, axis] - at
    side = height[corners] >= 0
    crossing = side.any(1) & ~side.all(1)
    corners, side = corners[crossing], side[crossing]
    # The corner that is alone on its side; both its edges cross the plane.
    lone = np.where(side.sum(1) == 1, side.argmax(1), (~side).argmax(1))
    rows = np.arange(len(corners))
    segments = np.empty((len(corners), 2, 3))
    for n, other in enumerate((1, 2)):
        p, q = corners[rows, lone], corners[rows, (lone + other) % 3]
        t = height[p] / (height[p] - height[q])
        segments[:, n] = flat[p] + t[:, None] * (flat[q] - flat[p])
    return segments
