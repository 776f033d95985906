"""The one judgement of a preoperative MR, for every tool that takes one: whether it is a head, of this patient's space, and shows what
the surfaces show."""
import os
from dataclasses import dataclass
from typing import Optional

import numpy as np

from cortshift_tracking.errors import VolumeError
from cortshift_tracking.mr.nifti import EXTENT_RANGE
from cortshift_tracking.mr.reader import load_volume

LEAST_INSIDE = 0.5   # share of a surface that lies in the volume; where less does, the two do not belong together
REACH = 0.012        # the cortex is looked for this far from a surface [m], as CortexSettings.reach


@dataclass(frozen=True)
class MrSource:
    """A file or folder of a preoperative MR, and how it is meant; see load_volume."""
    path: str
    axes: str = 'RAS'
    form: Optional[str] = None
    series: Optional[str] = None
    template_space: bool = False


def add_options(parser):
    """The options of every tool that takes an MR."""
    parser.add_argument('--axes', choices=('RAS', 'LPS'), default='RAS', help='what the axes of pmr point to (default RAS)')
    parser.add_argument('--form', choices=('sform', 'qform'), help='of a NIfTI header that holds both and contradicts itself')
    parser.add_argument('--series', help='end of the SeriesInstanceUID, where a DICOM folder holds several')
    parser.add_argument('--template-space', action='store_true', help='the MR is in coordinates of a template, and that is meant')


def about_source(source):
    """What a result remembers of an MrSource; JSON."""
    return {'mr_source': os.path.abspath(source.path), 'axes': source.axes, 'form': source.form, 'series': source.series,
            'template_space': source.template_space}


def remembered_source(about, path, given_by):
    """MrSource of about_source's words, of which older results have only the first two. path: where the MR is now, '' where it was.

    given_by: what path is given by, for people. Raises VolumeError where it is gone.
    """
    if not path and not os.path.exists(about['mr_source']):
        raise VolumeError(f'{about["mr_source"]}: the MR is not there any more; give it by {given_by}')
    series = None if path else about.get('series')   # another copy may have another UID
    return MrSource(path or about['mr_source'], about['axes'], about.get('form'), series, about.get('template_space', False))


def source_from(options, path):
    return MrSource(path, options.axes, options.form, options.series, options.template_space)


def admit_mr(source, surfaces):
    """The Volume of an MrSource, if it can serve the surfaces: (name, points (..., 3) in pmr [m]) of each.

    Raises VolumeError with reason and remedy.
    """
    path = source.path
    volume = load_volume(path, source.axes, source.form, source.series, source.template_space)
    if min(volume.data.shape) < 2:
        raise VolumeError(f'{path}: is a single slice ({" x ".join(map(str, volume.data.shape))} voxels), not a volume; give the whole '
                          'series')
    if volume.data.min() == volume.data.max():
        raise VolumeError(f'{path}: every voxel is {volume.data.min():g}, so it shows nothing; export it again')
    longest = (volume.spacing * volume.data.shape).max()
    if not EXTENT_RANGE[0] <= longest <= EXTENT_RANGE[1]:
        raise VolumeError(f'{path}: the volume is {longest * 1000:.4g} mm long, which is no head; check the unit in its header')
    for name, points in surfaces:
        _check_surface(volume, name, np.asarray(points)[np.isfinite(points).all(-1)])
    return volume


def _check_surface(volume, name, points):
    if not len(points):
        raise VolumeError(f'surface "{name}" has no points; capture the stage again')
    share = np.isfinite(volume.sample(points[::97])).mean()
    if share < LEAST_INSIDE:
        raise VolumeError(f'surface "{name}" lies outside {volume.source}: only {share:.0%} of it is in the volume; check the patient '
                          f'registration and the axes of pmr ({volume.axes})')
    if volume.unknown is None:
        return
    around = volume.crop(points.min(0) - REACH, points.max(0) + REACH)
    if around.unknown.any():
        raise VolumeError(f'{volume.source}: {int(around.unknown.sum())} voxels around surface "{name}" are not numbers (NaN or infinite), '
                          'so its cortex cannot be told; export the volume again')
