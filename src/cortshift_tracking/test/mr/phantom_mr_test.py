"""The phantom's MR: its cortex is the undeformed surface, and a known shift against it is recovered."""
import subprocess

import numpy as np
import pytest
import rosbag
import yaml
from cortshift_tracking.case.field_bag import summarise, write_field
from cortshift_tracking.case.messages import field_from_message
from cortshift_tracking.errors import VolumeError
from cortshift_tracking.mr.cortex import CortexSurface, distances_to_cortex, extract_cortex
from cortshift_tracking.mr.cross_section import cut
from cortshift_tracking.mr.reader import load_volume
from cortshift_tracking.mr.registration import register_to_mr
from cortshift_tracking.mr.volume import Volume
from phantom_mr import CASE, Section, ShiftError, another_head, describe, inside_rim, phantom_mr, reconstructed, tool
from programs import program
from scipy import ndimage
from scipy.spatial.transform import Rotation

SECTION_BAR = 0.0003  # [m]


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('phantom')


@pytest.fixture(scope='module')
def stages(folder):
    return {name: reconstructed(folder, name) for name in ('unmoved', 'moved')}


@pytest.mark.parametrize('seed', [7, 23])
def test_section_of_the_first_stage_lies_on_the_cortex_of_the_mr(tmp_path, seed):
    case = another_head(tmp_path / 'case.yaml', seed)
    section = Section(tmp_path, case)
    assert section.volume.orientation == 'LAS' and np.allclose(section.volume.spacing, 0.00025)
    assert np.isnan(section.of_the_mr).mean() < 0.001
    of_the_mr = section.of_the_mr[np.isfinite(section.of_the_mr)]
    print(f'head {seed}: cortex of the MR to the exact one: {describe(of_the_mr)}')
    print(f'head {seed}: section to the cortex of the MR: {describe(section.distance)}; {section.share:.1%} of the craniotomy is drawn')
    assert np.median(of_the_mr) < 0.00002 and of_the_mr.max() <= SECTION_BAR
    assert section.share > 0.9 and section.distance.max() <= SECTION_BAR
    # The lines themselves, as a report draws them.
    middle = np.median(section.shown, axis=0)
    for axis in range(3):
        for offset in (-0.012, 0.0, 0.009):
            line = cut(section.sure[::2, ::2], axis, middle[axis] + offset)
            line = inside_rim(np.concatenate([line, line.mean(1, keepdims=True)], 1), case)
            assert len(line) > 200 and np.abs(distances_to_cortex(line, section.cortex)).max() <= SECTION_BAR


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
    found = ShiftError(field, folder)
    print(f'MR to stage: shift up to {found.largest_mm:.2f} mm; error median {np.median(found.error_mm):.3f} mm, 90th percentile '
          f'{np.percentile(found.error_mm, 90):.3f} mm, on {found.covered:.0%} of the craniotomy; {found.outside:.1%} of the vectors '
          'outside it')
    assert found.largest_mm > 4.5
    assert np.median(found.error_mm) <= 0.5 and found.covered >= 0.7
    assert found.outside < 0.03  # bone is not taken for brain


def test_the_tumour_is_where_its_labels_say(tmp_path):
    for name, more in (('with', ('--tumour', tmp_path / 'tumour.nii')), ('without', ())):
        tool('phantom_mr', CASE, tmp_path / f'{name}.nii', '--voxel', 1, '--side', 80, *more)
    seen, plain, labels = (load_volume(str(tmp_path / f'{name}.nii')) for name in ('with', 'without', 'tumour'))
    inside = labels.data > 0.5
    outside = ~ndimage.binary_dilation(inside, iterations=2)
    with open(CASE, encoding='utf-8') as file:
        place = yaml.safe_load(file)['brain_in_pmr']
    middle = np.array(place['translation']) - 0.024 * Rotation.from_euler('xyz', place['rpy']).apply([0, 0, 1])
    assert np.linalg.norm(labels.to_pmr(np.argwhere(inside)).mean(0) - middle) < 0.0001
    assert inside.sum() * 1e-9 == pytest.approx(4 / 3 * np.pi * 0.010 ** 3, rel=0.02)
    assert np.array_equal(seen.data[outside], plain.data[outside])
    assert np.median(seen.data[ndimage.binary_erosion(inside, iterations=4)]) == pytest.approx(60, abs=1)


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
    run = subprocess.run([program('phantom_mr', 'cortshift_stereo'), CASE, str(folder / 'huge.nii'), '--voxel', '0.2'],
                         stderr=subprocess.PIPE, universal_newlines=True, check=False)
    assert run.returncode == 1 and 'voxels a side, allowed are 800' in run.stderr and not (folder / 'huge.nii').exists()


def test_surface_far_from_the_head_is_refused(folder, stages):
    volume = phantom_mr(folder, 1.0)
    with pytest.raises(VolumeError, match='registration'):
        extract_cortex(volume, stages['unmoved'].points[::4, ::4] + [0.5, 0, 0])
    with pytest.raises(VolumeError, match='no brain|no cortex'):
        extract_cortex(Volume(np.full((60, 60, 60), 7, np.float32), volume.T_pmr_voxel @ np.diag([1.6, 1.6, 1.6, 1])),
                       stages['unmoved'].points[::4, ::4])
