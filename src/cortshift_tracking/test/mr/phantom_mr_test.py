"""The phantom's MR: its cortex is the undeformed surface, and a known shift against it is recovered."""
import io
import os
import subprocess
import sys

import numpy as np
import pytest
import rosbag
import yaml
from cortshift_tracking.mr.cross_section import cut, sure_points
from cortshift_tracking.errors import VolumeError
from cortshift_tracking.case.field_bag import summarise, write_field
from cortshift_tracking.case.messages import Stage, field_from_message
from cortshift_tracking.mr.reader import load_volume
from cortshift_tracking.mr.cortex import CortexSettings, CortexSurface, distances_to_cortex, extract_cortex
from cortshift_tracking.mr.registration import register_to_mr
from cortshift_tracking.mr.volume import Volume

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, '..', 'support'))
from pcd import read_pcd  # noqa: E402

CASE = os.path.join(HERE, '..', '..', '..', '..', 'config', 'phantom', 'phantom_registration.yaml')
SECTION_BAR = 0.0003  # [m]


def tool(name, *arguments, text=None):
    return subprocess.run(['rosrun', 'cortshift_stereo', name, *map(str, arguments)], input=text, stdout=subprocess.PIPE,
                          universal_newlines=True, check=True).stdout


def truth(points, start, end, case=CASE):
    """Of points (N, 3) near the surface of `start`: distance from it, distance inside the rim, displacement to `end` [m]."""
    lines = tool('phantom_truth', case, start, end, text=''.join('%.9f,%.9f,%.9f\n' % tuple(p) for p in points))
    table = np.genfromtxt(io.StringIO(lines), delimiter=',', names=True)
    return table['distance_m'], table['rim_m'], np.stack([table[name] for name in ('dx_m', 'dy_m', 'dz_m')], -1)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('phantom')


def reconstructed(folder, name, case=CASE):
    """A stage as stereo makes it of the phantom's images."""
    tool('phantom_surface', case, name, folder / f'{name}.pcd', '--reconstructed')
    return Stage(name, '', 1.0, *read_pcd(folder / f'{name}.pcd'), None, 1.0)


@pytest.fixture(scope='module')
def stages(folder):
    return {name: reconstructed(folder, name) for name in ('unmoved', 'moved')}


def phantom_mr(folder, voxel_mm, case=CASE, side_mm=95):
    path = folder / f'mr_{voxel_mm}.nii'
    tool('phantom_mr', case, path, '--voxel', voxel_mm, '--side', side_mm)
    return load_volume(path)


def inside_rim(points, case, start='unmoved'):
    """The points (N, 3) within the craniotomy, of an array (..., 3) with NaN."""
    points = points[np.isfinite(points).all(-1)]
    return points[truth(points, start, 'moved', case)[1] > 0]


def another_head(path, seed):
    """The case with other vessels, gyri and another opening."""
    with open(CASE, encoding='utf-8') as file:
        case = yaml.safe_load(file)
    case['head']['seed'] = seed
    case['head']['craniotomy']['seed'] = seed
    path.write_text(yaml.safe_dump(case), encoding='utf-8')
    return path


def describe(distance):
    return (f'median {np.median(distance) * 1000:.3f} mm, 99.9th percentile {np.percentile(distance, 99.9) * 1000:.3f} mm, largest '
            f'{distance.max() * 1000:.3f} mm of {distance.size}')


@pytest.mark.parametrize('seed', [7, 23])
def test_section_of_the_first_stage_lies_on_the_cortex_of_the_mr(tmp_path, seed):
    case = another_head(tmp_path / 'case.yaml', seed)
    stage = reconstructed(tmp_path, 'unmoved', case)
    tool('phantom_surface', case, 'unmoved', tmp_path / 'exact.pcd')
    seen = inside_rim(read_pcd(tmp_path / 'exact.pcd')[0], case)
    # Voxels that resolve the floor of a sulcus; clinical ones would be compared with their own partial volume.
    volume = phantom_mr(tmp_path, 0.25, case, 80)
    assert volume.orientation == 'LAS' and np.allclose(volume.spacing, 0.00025)
    cortex = extract_cortex(volume, stage.points, settings=CortexSettings(resolution=0.00015, smoothing=0.00015))
    of_the_mr = np.abs(distances_to_cortex(seen, cortex))
    assert np.isnan(of_the_mr).mean() < 0.001
    of_the_mr = of_the_mr[np.isfinite(of_the_mr)]
    sure = sure_points(stage.points, stage.confidence)
    shown = inside_rim(sure, case)
    share = len(shown) / len(seen)
    distance = np.abs(distances_to_cortex(shown, cortex))
    print(f'head {seed}: cortex of the MR to the exact one: {describe(of_the_mr)}')
    print(f'head {seed}: section to the cortex of the MR: {describe(distance)}; {share:.1%} of the craniotomy is drawn')
    assert np.median(of_the_mr) < 0.00002 and of_the_mr.max() <= SECTION_BAR
    assert share > 0.9 and distance.max() <= SECTION_BAR
    # The lines themselves, as a report draws them.
    middle = np.median(shown, axis=0)
    for axis in range(3):
        for offset in (-0.012, 0.0, 0.009):
            line = cut(sure[::2, ::2], axis, middle[axis] + offset)
            line = inside_rim(np.concatenate([line, line.mean(1, keepdims=True)], 1), case)
            assert len(line) > 200 and np.abs(distances_to_cortex(line, cortex)).max() <= SECTION_BAR


def test_cortex_of_a_clinical_mr_errs_by_partial_volume_only(folder, stages):
    """Voxels of 0.8 mm: a quarter of a voxel at most points, most of one where sulci are narrower than a voxel."""
    volume = phantom_mr(folder, 0.8)
    points = inside_rim(stages['unmoved'].points[::4, ::4], CASE)
    cortex = extract_cortex(volume, stages['unmoved'].points)
    distance = np.abs(distances_to_cortex(points, cortex))
    assert np.isnan(distance).mean() < 0.005
    distance = distance[np.isfinite(distance)]
    print(f'voxels of 0.8 mm: surface to cortex of the MR: {describe(distance)}')
    assert np.median(distance) < 0.0001 and np.percentile(distance, 95) < 0.0003


def test_known_shift_against_the_mr_is_recovered(folder, stages, tmp_path):
    field, overlap = register_to_mr(stages['moved'], phantom_mr(folder, 0.8))
    write_field(str(tmp_path / 'pmr__moved.bag'), field, summarise(field, overlap, 1.0, field.normal_pmr))
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


def test_distance_to_the_cortex_is_that_of_geometry():
    radius, half, step = 0.06, 0.02, 0.0005
    x, y = np.meshgrid(np.arange(-half, half, step), np.arange(half, -half, -step))  # rows go down
    surface = np.stack([x, y, np.sqrt(radius ** 2 - x ** 2 - y ** 2)], -1)
    cortex = CortexSurface(surface, None, None, np.array([0.0, 0, 1]))
    random = np.random.default_rng(3)
    direction = np.column_stack([random.uniform(-0.3, 0.3, (500, 2)), np.ones(500)])
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    height = random.uniform(-0.001, 0.001, 500)
    assert np.abs(distances_to_cortex(direction * (radius + height)[:, None], cortex) - height).max() < 2e-6  # sagitta
    assert np.isnan(distances_to_cortex([[half + 0.003, 0, np.sqrt(radius ** 2 - half ** 2)]], cortex)).all()


def test_mr_that_fills_the_memory_is_refused(folder):
    run = subprocess.run(['rosrun', 'cortshift_stereo', 'phantom_mr', CASE, str(folder / 'huge.nii'), '--voxel', '0.2'],
                         stderr=subprocess.PIPE, universal_newlines=True, check=False)
    assert run.returncode == 1 and 'voxels a side, allowed are 800' in run.stderr and not (folder / 'huge.nii').exists()


def test_surface_far_from_the_head_is_refused(folder, stages):
    volume = phantom_mr(folder, 1.0)
    with pytest.raises(VolumeError, match='registration'):
        extract_cortex(volume, stages['unmoved'].points[::4, ::4] + [0.5, 0, 0])
    with pytest.raises(VolumeError, match='no brain|no cortex'):
        extract_cortex(Volume(np.full((60, 60, 60), 7, np.float32), volume.T_pmr_voxel @ np.diag([1.6, 1.6, 1.6, 1])),
                       stages['unmoved'].points[::4, ::4])
