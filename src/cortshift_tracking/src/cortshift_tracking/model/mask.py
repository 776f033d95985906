"""The brain in a T1-weighted MR, where no mask is given: as the MR registration finds the cortex, by intensity and by what is connected."""
import numpy as np
from scipy import ndimage

from cortshift_tracking.errors import VolumeError
from cortshift_tracking.mr.cortex import CortexSettings
from cortshift_tracking.mr.volume import Volume

STEP = 0.0015       # of the grid on which brain is told from the rest [m]
OPENING = 0.0045    # thinner bridges between brain and dura or skull are cut [m]
BRIGHTEST = 1.7     # times the typical brain: brighter is fat
PLAUSIBLE = (0.0006, 0.0024)   # volume of a human brain [m^3]


def brain_mask(volume, craniotomy):
    """Volume of 0 and 1 on a grid of STEP. craniotomy: a point on the head near the brain, pmr [m]. Raises VolumeError."""
    corners = volume.corners_pmr()
    axes = [np.arange(corners[0, n], corners[1, n], STEP) for n in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing='ij'), -1)
    values = np.nan_to_num(np.stack([volume.sample(plane) for plane in grid]))
    bright = values > 0.25 * np.percentile(values, 99)
    middle = grid[bright].mean(0) if bright.any() else corners.mean(0)
    inward = (middle - craniotomy) / np.linalg.norm(middle - craniotomy)
    seed = craniotomy + 0.035 * inward
    deep = values[np.linalg.norm(grid - seed, axis=-1) < 0.015]
    if not len(deep):
        raise VolumeError(f'{volume.source}: the craniotomy lies outside; check the patient registration and the axes of pmr ({volume.axes})')
    typical = np.median(deep)
    brain = (values > CortexSettings.brain_share * typical) & (values < BRIGHTEST * typical)
    away = ndimage.distance_transform_edt(brain, sampling=STEP)
    core, _ = ndimage.label(away > OPENING)
    at = core[np.linalg.norm(grid - seed, axis=-1) < 0.015]
    at = at[at > 0]
    if not len(at):
        raise VolumeError(f'{volume.source}: no brain below the craniotomy; check the patient registration, or give a brain mask (--brain)')
    kept = core == np.bincount(at).argmax()
    kept = ndimage.distance_transform_edt(~kept, sampling=STEP) <= OPENING * 1.15
    # What closes over: sulci and ventricles belong to the brain.
    closed = ndimage.distance_transform_edt(~kept, sampling=STEP) > 0.006
    closed = ndimage.distance_transform_edt(~closed, sampling=STEP) > 0.006
    closed = ndimage.binary_fill_holes(closed | kept)
    size = closed.sum() * STEP ** 3
    if not PLAUSIBLE[0] <= size <= PLAUSIBLE[1]:
        raise VolumeError(f'{volume.source}: what is found as brain has {size * 1e6:.0f} ml, which no brain has; give a brain mask (--brain)')
    T = np.diag([STEP, STEP, STEP, 1.0])
    T[:3, 3] = corners[0]
    return Volume(closed.astype(np.float32), T, volume.axes, f'{volume.source} (brain found in it)')
