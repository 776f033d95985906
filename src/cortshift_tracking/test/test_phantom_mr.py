"""The phantom's MR: its cortex is the undeformed surface, and a known shift against it is recovered."""
import io
import os
import subprocess
import sys

import numpy as np
import pytest
import rosbag
from cortshift_tracking.errors import VolumeError
from cortshift_tracking.field_bag import summarise, write_field
from cortshift_tracking.messages import Stage, field_from_message
from cortshift_tracking.mr import load_volume
from cortshift_tracking.mr_cortex import CortexSettings, distances_to_cortex, extract_cortex
from cortshift_tracking.mr_registration import register_to_mr
from cortshift_tracking.volume import Volume

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)
from pcd import read_pcd  # noqa: E402

CASE = os.path.join(HERE, '..', '..', '..', 'config', 'phantom', 'phantom_registration.yaml')


def tool(name, *arguments, text=None):
    return subprocess.run(['rosrun', 'cortshift_stereo', name, *map(str, arguments)], input=text, stdout=subprocess.PIPE,
                          universal_newlines=True, check=True).stdout


def truth(points, start, end):
    """Of points (N, 3) near the surface of `start`: distance from it, distance inside the rim, displacement to `end` [m]."""
    lines = tool('phantom_truth', CASE, start, end, text=''.join('%.9f,%.9f,%.9f\n' % tuple(p) for p in points))
    table = np.genfromtxt(io.StringIO(lines), delimiter=',', names=True)
    return table['distance_m'], table['rim_m'], np.stack([table[name] for name in ('dx_m', 'dy_m', 'dz_m')], -1)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('phantom')


@pytest.fixture(scope='module')
def stages(folder):
    """What stereo makes of the phantom's images."""
    found = {}
    for name in ('unmoved', 'moved'):
        tool('phantom_surface', CASE, name, folder / f'{name}.pcd', '--reconstructed')
        found[name] = Stage(name, '', 1.0, *read_pcd(folder / f'{name}.pcd'), None, 1.0)
    return found


def phantom_mr(folder, voxel_mm):
    path = folder / f'mr_{voxel_mm}.nii'
    tool('phantom_mr', CASE, path, '--voxel', voxel_mm, '--side', 95)
    return load_volume(path)


def test_first_surface_lies_on_the_cortex_of_the_mr(folder, stages):
    volume = phantom_mr(folder, 0.4)
    assert volume.orientation == 'LAS' and np.allclose(volume.spacing, 0.0004)
    points = stages['unmoved'].points
    cortex = extract_cortex(volume, points, settings=CortexSettings(resolution=0.00015, smoothing=0.00015))
    sparse = points[::4, ::4].reshape(-1, 3)
    sparse = sparse[np.isfinite(sparse).all(-1)]
    _, rim, _ = truth(sparse, 'unmoved', 'moved')
    distance = np.abs(distances_to_cortex(sparse[rim > 0], cortex)) * 1000
    print(f'surface to cortex of the MR: median {np.nanmedian(distance):.3f} mm, 99.9th percentile '
          f'{np.nanpercentile(distance, 99.9):.3f} mm, largest {np.nanmax(distance):.3f} mm of {distance.size}, '
          f'{np.isnan(distance).mean():.2%} unknown')
    assert distance.size > 10000 and np.isnan(distance).mean() < 0.005
    assert np.nanmedian(distance) < 0.06 and np.nanpercentile(distance, 99.9) <= 0.3
    assert np.nanmax(distance) < 0.45  # the aim is 0.3: walls of the narrowest sulci, where both surfaces err


def test_known_shift_against_the_mr_is_recovered(folder, stages, tmp_path):
    field, overlap = register_to_mr(stages['moved'], phantom_mr(folder, 0.8))
    write_field(str(tmp_path / 'pmr__moved.bag'), field, summarise(field, overlap, 1.0))
    with rosbag.Bag(str(tmp_path / 'pmr__moved.bag')) as bag:
        read = field_from_message(next(message for _, message, _ in bag.read_messages('/shift/field')))
    assert read.from_key == 'pmr' and read.summary.valid_points == field.valid.sum() and 0.5 < read.summary.overlap <= 1
    assert np.allclose(read.displacement[field.valid], field.displacement[field.valid], atol=1e-6)
    start = field.start[::6, ::6].reshape(-1, 3)
    estimate = field.displacement[::6, ::6].reshape(-1, 3)
    known = np.isfinite(start).all(-1)
    _, rim, true = truth(start[known], 'undeformed', 'moved')
    inside = rim > 0
    error = np.linalg.norm(estimate[known] - true, axis=-1)[inside] * 1000
    # The craniotomy's area, counted on the same grid over the exact surface.
    tool('phantom_surface', CASE, 'moved', folder / 'exact.pcd')
    sparse = read_pcd(folder / 'exact.pcd')[0][::8, ::8]
    _, rim_all, _ = truth(sparse.reshape(-1, 3), 'moved', 'moved')
    rim_all = rim_all.reshape(sparse.shape[:2])
    cell = np.linalg.norm(np.cross(sparse[1:, :-1] - sparse[:-1, :-1], sparse[:-1, 1:] - sparse[:-1, :-1]), axis=-1)
    area = cell[rim_all[:-1, :-1] > 0].sum()
    covered = inside.sum() * (6 * field.resolution) ** 2 / area
    largest = np.linalg.norm(true[inside], axis=-1).max() * 1000
    print(f'MR to stage: shift up to {largest:.2f} mm; error median {np.median(error):.3f} mm, 90th percentile '
          f'{np.percentile(error, 90):.3f} mm, on {covered:.0%} of the craniotomy; {np.mean(~inside):.1%} of the vectors outside it')
    assert largest > 4.5
    assert np.median(error) <= 0.5 and covered >= 0.7
    assert np.mean(~inside) < 0.03  # bone is not taken for brain


def test_surface_far_from_the_head_is_refused(folder, stages):
    volume = phantom_mr(folder, 1.0)
    with pytest.raises(VolumeError, match='registration'):
        extract_cortex(volume, stages['unmoved'].points[::4, ::4] + [0.5, 0, 0])
    with pytest.raises(VolumeError, match='no brain|no cortex'):
        extract_cortex(Volume(np.full((60, 60, 60), 7, np.float32), volume.T_pmr_voxel @ np.diag([1.6, 1.6, 1.6, 1])),
                       stages['unmoved'].points[::4, ::4])
