"""Volumes that mark a part of the MR: a brain mask, a label, what was resected. Above 0 is marked, whatever the number."""
import numpy as np

from cortshift_tracking.errors import VolumeError
from cortshift_tracking.mr.reader import load_volume
from cortshift_tracking.mr.volume import Volume

MOST_STRUCTURES = 50   # of a file of labels; more are shades of grey


def load_marked(source, one_structure=False):
    """Volume of 0 and 1 (float32) of an MrSource; what is not a number marks nothing.

    Form and series of the MrSource are those of the MR: the form counts only where this file's header leaves a choice, the series not at all.
    one_structure: refuse a file that numbers several. Raises VolumeError, for values between whole numbers too.
    """
    volume = load_volume(source.path, source.axes, source.form, template_space=source.template_space, form_decides=False)
    marked = volume.data > 0
    if volume.unknown is not None:
        marked &= ~volume.unknown
    values = np.unique(volume.data[marked])
    if len(values) > 1 and (values != np.round(values)).any():
        raise VolumeError(f'{source.path}: holds parts of voxels ({values[0]:g} to {values[-1]:g}: a probability, or a mask that was resampled), '
                          'and how much of one counts is not said; write it as 0 and 1')
    if one_structure and len(values) > 1:
        told = ', '.join(f'{value:g}' for value in values[:6]) + (' ...' if len(values) > 6 else '')
        what = 'numbers several structures' if len(values) <= MOST_STRUCTURES else 'holds grey values'
        raise VolumeError(f'{source.path}: {what} ({told}); if all of it is one, write it as 0 and 1, else give a file for each')
    return Volume(marked.astype(np.float32), volume.T_pmr_voxel, volume.axes, volume.source, volume.notes, warnings=volume.warnings)
