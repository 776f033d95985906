"""From a recorded case to its updated MR by the command lines, the brain found in the MR; and every refusal by its text."""
import dataclasses
import json
import shutil

import numpy as np
import pytest
import rosbag
from cortshift_tracking.case.folder import read_case
from cortshift_tracking.model.brain import load_model
from cortshift_tracking.model.case_update import located, update_case
from cortshift_tracking.model.mask import brain_mask
from cortshift_tracking.mr.reader import load_volume, save_nifti
from cortshift_tracking.mr.volume import Volume
from offline_tools import PHANTOM_BAG, PHANTOM_CASE, run_tool
from scipy.spatial.transform import Rotation

FROM, TO = 'dural_opening', 'after_resection'
CRANIOTOMY = np.array([0.041, 0.037, 0.064])          # as the phantom's case file says
RADIUS = 0.075                                        # of the undeformed cortex
OUTWARD = Rotation.from_euler('xyz', [-0.736, 0.052, -0.781]).apply([0, 0, 1])
GRAVITY = np.array([-0.42, -0.66, -0.62]) / np.linalg.norm([0.42, 0.66, 0.62])


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A case, its MR and the model prepared of it."""
    folder = tmp_path_factory.mktemp('case_update')
    run_tool('process_bag', PHANTOM_BAG, '--capture', f'{FROM}@3', f'{TO}@20', '--shift', f'{FROM}:{TO}', '--output', folder / 'case')
    run_tool('phantom_mr', PHANTOM_CASE, folder / 'pmr.nii', '--voxel', 1.5, package='cortshift_stereo')
    run_tool('prepare_model', folder / 'case', '--mr', folder / 'pmr.nii', '--output', folder / 'model.npz', '--elements', 12000)
    return folder


def update(folder, *more, case='case', model='model.npz', out='refused', status=1):
    """What update_mr says on the error channel."""
    return run_tool('update_mr', folder / case, '--model', folder / model, '--shift', f'{FROM}:{TO}', '--output', folder / out,
                    '--gravity', *GRAVITY, *more, status=status)[1]


def test_the_brain_is_found_in_the_mr(folder):
    volume = load_volume(str(folder / 'pmr.nii'))
    mask = brain_mask(volume, CRANIOTOMY)
    index = np.argwhere(np.ones(mask.data.shape))
    true = np.linalg.norm(mask.to_pmr(index) - (CRANIOTOMY - RADIUS * OUTWARD), axis=1) < RADIUS
    found = mask.data.ravel() > 0.5
    assert 2 * (true & found).sum() / (true.sum() + found.sum()) > 0.97


def test_the_brain_is_found_in_a_real_head(tmp_path):
    """mricron-data's ch2, beside what BET found in it."""
    folder = '/usr/share/mricron/templates/'
    volume, bet = (load_volume(folder + name, template_space=True) for name in ('ch2.nii.gz', 'ch2bet.nii.gz'))
    mask = brain_mask(volume, np.array([0.045, 0.02, 0.075]))
    index = np.argwhere(np.ones(mask.data.shape))
    true, found = np.nan_to_num(bet.sample(mask.to_pmr(index))) > 0, mask.data.ravel() > 0.5
    assert 2 * (true & found).sum() / (true.sum() + found.sum()) > 0.93
    assert (true & ~found).sum() < 0.02 * true.sum()


def test_the_updated_mr_of_a_case(folder):
    update(folder, out='out', status=0)
    summary = json.loads((folder / 'out/summary.json').read_text())
    assert summary['model']['stage'] == FROM and summary['model']['epoch'] == 1
    begins, resected = summary['warnings']
    assert 'the field begins at stage "dural_opening"' in begins and 'no resected part was given' in resected
    assert {path.name for path in (folder / 'out').iterdir()} == {'updated_mr.nii.gz', 'labels_now.nii.gz', 'now_from_pmr.nrrd',
                                                                  'pmr_from_now.nrrd', 'summary.json'}


def test_brain_goes_where_it_was_measured_and_bone_does_not_hold_it(folder):
    case, model, volume = read_case(str(folder / 'case')), load_model(str(folder / 'model.npz')), load_volume(str(folder / 'pmr.nii'))
    field = case.field(FROM, TO)
    assert field.brain   # the outline travels with the field
    updated = update_case(model, volume, field, GRAVITY, {}, epochs={FROM: 1, TO: 1})
    on = field.on_brain(field.start) & field.valid
    assert 0.3 < on.sum() / field.valid.sum() < 0.9   # the rest is bone and drape
    start = field.start[on][::40] - 0.001 * field.normal_pmr
    now, _, known = located(model, updated.update, start)
    error = np.linalg.norm(now - start - field.displacement[on][::40], axis=1)[known]
    assert known.mean() > 0.95 and np.median(error) < 0.0005 and np.percentile(error, 95) < 0.0015
    border = np.intersect1d(model.zone, model.mesh.border)
    covered = border[~field.in_opening(model.mesh.nodes[border])]
    assert len(covered) > 20
    outwards = (updated.update.displacement[covered] * (model.mesh.nodes[covered] - (CRANIOTOMY - RADIUS * OUTWARD)) / RADIUS).sum(1)
    assert outwards.max() < 0.0015   # bone keeps the brain in


def test_what_lies_on_the_brain_is_a_hole_in_it(folder):
    field = read_case(str(folder / 'case')).field(FROM, TO)
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    holed = dataclasses.replace(field, brain=(0.010 * square + 0.03, 0.004 * square + 0.03))
    places = field.T_pmr_projection[:3, 3] + np.array([[0.023, 0.03], [0.03, 0.03], [0.001, 0.03]]) @ field.T_pmr_projection[:3, :2].T
    assert holed.on_brain(places).tolist() == [True, False, False]
    assert holed.in_opening(places).tolist() == [True, True, False]   # the skull does not hold the brain under it


# ---- refusals -------------------------------------------------------------------------------------------------------------

def test_no_mr_is_refused(folder):
    told = run_tool('prepare_model', folder / 'case', '--output', folder / 'none.npz', status=1)[1]
    assert 'no MR given; a brain model is made from the preoperative MR: give --mr MR' in told
    told = run_tool('prepare_model', folder / 'case', '--mr', folder / 'lost.nii', '--output', folder / 'none.npz', status=1)[1]
    assert 'lost.nii' in told and not (folder / 'none.npz').exists()


def test_a_mask_with_two_parts_is_refused(folder):
    volume = load_volume(str(folder / 'pmr.nii'))
    away = np.linalg.norm(volume.to_pmr(np.argwhere(np.ones(volume.data.shape))) - (CRANIOTOMY - RADIUS * OUTWARD), axis=1)
    inside = (away < RADIUS).reshape(volume.data.shape)
    inside[inside.shape[0] // 2 - 1:inside.shape[0] // 2 + 2] = False
    save_nifti(Volume(inside.astype(np.float32), volume.T_pmr_voxel, volume.axes, 'two'), str(folder / 'two.nii'))
    told = run_tool('prepare_model', folder / 'case', '--mr', folder / 'pmr.nii', '--brain', folder / 'two.nii', '--output',
                    folder / 'none.npz', status=1)[1]
    assert 'two.nii: the brain mask has 2 parts' in told and 'a brain is one: correct the mask' in told


def test_a_field_off_the_model_is_refused(folder):
    other_side = 1000 * (CRANIOTOMY - RADIUS * OUTWARD + RADIUS * Rotation.from_rotvec([0, 1.6, 0]).apply(OUTWARD))
    run_tool('prepare_model', folder / 'case', '--mr', folder / 'pmr.nii', '--output', folder / 'aside.npz', '--elements', 4000,
             '--craniotomy', *other_side)
    told = update(folder, model='aside.npz')
    assert "of the field lies within 10 mm of the model's surface at the craniotomy" in told
    assert 'the model is of another craniotomy or the patient registration is wrong' in told


@pytest.mark.parametrize('epoch, reason', [
    (2, f'patient registration or calibration changed between them (epochs {FROM}: 1, {TO}: 2, of the model: 1)'),
    (0, f'the epoch of {TO} is not known (the stage is not in the case any more, or is of an old version)')])
def test_an_epoch_that_differs_or_is_not_known_is_refused(folder, epoch, reason):
    case = folder / f'case_{epoch}'
    shutil.copytree(folder / 'case', case)
    (path,) = (case / 'stages').glob(f'*{TO}*.bag')
    with rosbag.Bag(str(path)) as bag:
        messages = list(bag.read_messages())
    with rosbag.Bag(str(path), 'w') as bag:
        for topic, message, stamp in messages:
            if topic == '/stage/info':
                message.epoch = epoch
            bag.write(topic, message, stamp)
    told = update(folder, case=case.name)
    assert reason in told
    assert not (folder / 'refused').exists()


def test_a_model_of_another_mr_is_refused(folder):
    run_tool('phantom_mr', PHANTOM_CASE, folder / 'other.nii', '--voxel', 2, package='cortshift_stereo')
    told = update(folder, '--mr', folder / 'other.nii')
    assert 'the model is of another MR' in told and 'other.nii; prepare one of this MR' in told


def test_a_damaged_model_is_refused(folder):
    (folder / 'damaged.npz').write_bytes((folder / 'model.npz').read_bytes()[:4000])
    assert 'is no brain model, or is damaged' in update(folder, model='damaged.npz')
