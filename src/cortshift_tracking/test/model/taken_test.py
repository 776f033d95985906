"""What a model and an update take, refuse and leave, as far as no model is needed to show it."""
import json
from types import SimpleNamespace

import model_head as head
import nibabel
import numpy as np
import pytest
from cortshift_tracking.errors import VolumeError
from cortshift_tracking.model import case_update
from cortshift_tracking.model.brain import ModelError, load_model
from cortshift_tracking.model.case_update import check_epochs, direction_of, epochs_of, write_update
from cortshift_tracking.model.mesh import distance_to
from cortshift_tracking.model.prepare import ModelSettings, check_mask, prepare_model, tissues_of
from cortshift_tracking.model.warp import Warp, labels_now
from cortshift_tracking.mr.admission import MrSource
from cortshift_tracking.mr.marked import load_marked
from cortshift_tracking.mr.volume import Volume


@pytest.mark.parametrize('order', [('tumour', 'oedema'), ('oedema', 'tumour')])
def test_where_labels_overlap_the_tumour_counts(order):
    """An oedema that was drawn as the whole lesion, given before the tumour or behind it."""
    mr, _, tumour = head.volumes(step=0.003)
    places = mr.to_pmr(np.argwhere(np.ones(mr.data.shape)))
    lesion = Volume((np.linalg.norm(places - head.TUMOUR, axis=1) < 0.02).reshape(mr.data.shape).astype(np.float32), mr.T_pmr_voxel, 'RAS', 'lesion')
    given = {'tumour': tumour, 'oedema': lesion}
    labels = {name: given[name] for name in order}
    tissue, names = tissues_of(places, labels)
    now = labels_now(mr, Warp(np.zeros((2, 2, 2, 3), np.float32), mr.T_pmr_voxel, None, 'RAS'), labels, None).data.ravel()
    is_tumour = tumour.data.ravel() > 0.5
    for found in (tissue, now):
        assert (found[is_tumour] == names.index('tumour')).all()
        assert (found[~is_tumour & (lesion.data.ravel() > 0.5)] == names.index('oedema')).all()


def test_a_label_that_another_covers_whole_is_refused():
    mr, _, tumour = head.volumes(step=0.003)
    places = mr.to_pmr(np.argwhere(np.ones(mr.data.shape)))
    with pytest.raises(ModelError, match=r'label "oedema" \(tumour.nii\) lies whole below label "tumour" .* take "oedema" out of "tumour"'):
        tissues_of(places, {'tumour': tumour, 'oedema': tumour})


def test_a_mask_of_two_parts_is_refused():
    _, brain, _ = head.volumes()
    data = brain.data.copy()
    data[data.shape[0] // 2 - 2:data.shape[0] // 2 + 2] = 0
    with pytest.raises(ModelError, match='brain.nii: the brain mask has 2 parts .* a brain is one: correct the mask'):
        check_mask(Volume(data, brain.T_pmr_voxel, 'RAS', 'brain.nii'))


def test_a_damaged_file_is_refused(tmp_path):
    (tmp_path / 'model.npz').write_bytes(b'PK\x03\x04 nothing')
    with pytest.raises(ModelError, match='is no brain model, or is damaged'):
        load_model(str(tmp_path / 'model.npz'))
    with pytest.raises(ModelError, match='no such file; make it with prepare_model'):
        load_model(str(tmp_path / 'none.npz'))


def test_a_stage_that_is_not_there_has_an_epoch_that_is_not_known():
    stages = [SimpleNamespace(key='before', epoch=2), SimpleNamespace(key='other', epoch=3)]
    assert epochs_of(SimpleNamespace(from_key='before', to_key='gone'), stages) == {'before': 2, 'gone': 0}
    assert epochs_of(SimpleNamespace(from_key='pmr', to_key='before'), stages) == {'before': 2}
    model = SimpleNamespace(provenance={'epoch': 2})
    check_epochs(model, {'before': 2})
    with pytest.raises(ModelError, match=r'the epoch of gone is not known \(the stage is not in the case any more'):
        check_epochs(model, epochs_of(SimpleNamespace(from_key='pmr', to_key='gone'), stages))


@pytest.mark.parametrize('values', [(0, 0, 0), (float('nan'), 0, 1), (float('inf'), 0, 0)])
def test_gravity_that_is_no_direction_is_refused_by_its_option(values):
    with pytest.raises(ModelError, match='--gravity .*: is no direction; give that of gravity in pmr'):
        direction_of(values, '--gravity')
    assert np.allclose(direction_of((0, 0, -9), '--gravity'), [0, 0, -1])


def test_the_distance_goes_on_beyond_the_grid():
    """The grid ends 12 mm beside the brain."""
    distance = distance_to(head.volumes(step=0.003)[1])
    away = np.array([0.005, 0.02, 0.05])
    assert np.abs(distance.at([[0, 0, head.RADII[2] + a] for a in away]) - away).max() < 0.002


def test_a_craniotomy_beside_the_brain_is_refused():
    mr, brain, _ = head.volumes(step=0.003)
    with pytest.raises(ModelError, match='the craniotomy lies 2[3-6] mm from the border of the brain; check the patient registration'):
        prepare_model(mr, brain, head.CRANIOTOMY * (1 + 0.025 / np.linalg.norm(head.CRANIOTOMY)))


def test_without_a_surface_the_refusal_speaks_of_the_craniotomy():
    mr, brain, _ = head.volumes(step=0.003)
    settings = ModelSettings(elements=1500, opening=0.001)
    with pytest.raises(ModelError, match='the border of the brain has only [0-9] nodes within 1 mm of the craniotomy'):
        prepare_model(mr, brain, head.CRANIOTOMY, settings=settings)
    with pytest.raises(ModelError, match='the first surface lies nowhere on the border of the brain'):
        prepare_model(mr, brain, head.CRANIOTOMY, np.full((40, 3), 0.3), settings=settings)


def test_an_update_that_is_cut_short_leaves_no_summary_and_no_older_picture(tmp_path, monkeypatch):
    volume = Volume(np.zeros((2, 2, 2), np.float32), np.diag([0.001, 0.001, 0.001, 1]))
    warp = Warp(np.zeros((2, 2, 2, 3), np.float32), volume.T_pmr_voxel, None, 'RAS')
    updated = SimpleNamespace(mr=volume, labels=volume, now_from_pmr=warp, pmr_from_now=warp, summary={'number': 1})
    write_update(updated, str(tmp_path), np.zeros((4, 4, 3), np.uint8))
    assert json.loads((tmp_path / 'summary.json').read_text()) == {'number': 1} and (tmp_path / 'overlay.png').exists()

    def full(*_):
        raise OSError('No space left on device')
    monkeypatch.setattr(case_update, 'write_nrrd', full)
    with pytest.raises(OSError):
        write_update(updated, str(tmp_path))
    assert sorted(path.name for path in tmp_path.iterdir()) == ['labels_now.nii.gz', 'now_from_pmr.nrrd', 'pmr_from_now.nrrd', 'updated_mr.nii.gz']


def test_parts_of_voxels_and_shades_of_grey_mark_nothing(tmp_path):
    data = np.zeros((30, 30, 20), np.float32)
    data[5:20, 5:20, 5:15] = np.linspace(0.01, 1, 10)
    image = nibabel.Nifti1Image(data, np.diag([1, 1, 1, 1.0]))
    image.header.set_xyzt_units('mm')
    nibabel.save(image, tmp_path / 'soft.nii')
    with pytest.raises(VolumeError, match=r'soft.nii: holds parts of voxels \(0.01 to 1: a probability, or a mask that was resampled\)'):
        load_marked(MrSource(str(tmp_path / 'soft.nii')))
    grey = nibabel.Nifti1Image(np.arange(18000, dtype=np.int16).reshape(30, 30, 20), np.diag([1, 1, 1, 1.0]))
    grey.header.set_xyzt_units('mm')
    nibabel.save(grey, tmp_path / 'grey.nii')
    with pytest.raises(VolumeError, match=r'grey.nii: holds grey values \(1, 2, 3, 4, 5, 6 ...\); if all of it is one, write it as 0 and 1'):
        load_marked(MrSource(str(tmp_path / 'grey.nii')), one_structure=True)
