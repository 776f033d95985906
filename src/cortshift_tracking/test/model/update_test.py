"""From the MR to the updated MR on a small head: what the model is told comes out again, and what cannot be is refused with its reason."""
import json
import os
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import model_head as head
import nibabel
import numpy as np
import pytest
from cortshift_msgs.msg import ShiftSummary
from cortshift_tracking.case.messages import Field, Provenance
from cortshift_tracking.model import system as system_module
from cortshift_tracking.model.brain import ModelError, load_model, save_model
from cortshift_tracking.model.case_update import located, update_case, write_update
from cortshift_tracking.model.mesh import quality
from cortshift_tracking.model.loads import loads_of
from cortshift_tracking.model.prepare import ModelSettings, prepare_model
from cortshift_tracking.model.system import Condensed, System, rows_of
from cortshift_tracking.model.update import UpdateSettings, bin_field, update
from cortshift_tracking.model.warp import warps_of
from cortshift_tracking.mr.reader import save_nifti
from cortshift_tracking.mr.volume import Volume

DOWN = -head.OUTWARD
SETTINGS = ModelSettings(elements=8000, samples=24)


def field_of(points, displacement, frame=np.eye(3), from_key='pmr', confidence=0.9):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = frame, head.CRANIOTOMY
    valid = np.isfinite(points[..., 0])
    return Field(from_key, 'after', 1.0, 2.0, T, 0.0005, points, np.where(valid[..., None], displacement, np.nan),
                 np.full(points.shape, 128, np.uint8), np.where(valid, confidence, np.nan),
                 ShiftSummary(warnings=['the rows do not agree']), provenance=Provenance('1.0', 'c', 'd'))


@pytest.fixture(scope='module', params=[('RAS', 0.0), ('LPS', 0.3)], ids=['RAS', 'LPS oblique'])
def made(request):
    axes, oblique = request.param
    mr, brain, tumour = head.volumes(oblique=oblique, axes=axes)
    turn = np.diag([-1.0, -1.0, 1.0]) if axes == 'LPS' else np.eye(3)
    points, frame = head.surface_grid()
    model = prepare_model(mr, brain, turn @ head.CRANIOTOMY, (points[np.isfinite(points[..., 0])] @ turn), {'tumour': tumour}, SETTINGS)
    field = field_of(points @ turn, head.sag(points) @ turn, turn @ frame)
    return model, mr, field, turn


@pytest.fixture(scope='module')
def updated(made):
    model, mr, field, turn = made
    return update_case(model, mr, field, turn @ DOWN, model.labels)


def test_the_mesh_is_sound(made):
    mesh = made[0].mesh
    assert quality(mesh.nodes, mesh.tetrahedra).min() > 0.05
    exact = 4 / 3 * np.pi * head.RADII.prod()
    assert abs(mesh.volumes.sum() / exact - 1) < 0.03
    near = np.linalg.norm(mesh.nodes[mesh.tetrahedra].mean(1) - made[0].craniotomy, axis=1)
    assert np.median(mesh.volumes[near < 0.02]) < 0.4 * np.median(mesh.volumes[near > 0.08])


def test_the_surface_goes_where_it_was_measured(made, updated):
    model, _, field, _ = made
    start = field.start[field.valid]
    inward = start + 0.0005 * (-start / np.linalg.norm(start, axis=1, keepdims=True))
    now, _, known = located(model, updated.update, inward)
    error = np.linalg.norm(now - inward - field.displacement[field.valid], axis=1)[known]
    assert known.mean() > 0.7
    assert np.median(error) < 0.0004
    assert np.percentile(error, 95) < 0.0010


def test_uncertain_vectors_pull_less(made):
    model, _, field, turn = made
    start, moved = (values[field.valid] for values in (field.start, field.displacement))
    wrong = moved.copy()
    half = (start - model.craniotomy) @ turn @ [1, 0, 0] > 0
    wrong[half] += 0.003 * (turn @ head.OUTWARD)
    residual = {}
    for name, sd in (('trusted', 0.0003), ('doubted', 0.005)):
        pulls = bin_field(model, start, wrong, np.where(half, sd, 0.0003))
        result = update(model, pulls, turn @ DOWN)
        place = start[half][::7] * 0.99
        now, _, known = located(model, result, place)
        residual[name] = np.median(np.linalg.norm(now - place - moved[half][::7], axis=1)[known])
    assert residual['doubted'] < 0.75 * residual['trusted']


def test_an_infinite_uncertainty_is_one_that_is_not_known(made):
    model, _, field, _ = made
    start, moved = (values[field.valid] for values in (field.start, field.displacement))
    infinite, unknown = (bin_field(model, start, moved, uncertainty) for uncertainty in (np.full(len(start), np.inf), None))
    assert (infinite.sd == unknown.sd).all()


def test_the_standard_deviation_grows_away_from_the_data(made, updated):
    model, _, _, turn = made
    depth = np.array([0.004, 0.02, 0.04])
    points = model.craniotomy + depth[:, None] * (turn @ DOWN)
    _, sd, known = located(model, updated.update, points)
    assert known.all()
    assert sd[0] < sd[1] and sd[0] < 0.7 * sd[2]


def test_nothing_leaves_the_skull_but_at_the_craniotomy(made, updated):
    model, _, _, turn = made
    border = np.setdiff1d(np.unique(model.mesh.border), model.zone)
    now = (model.mesh.nodes + updated.update.displacement)[border] @ turn
    assert ((now / head.RADII) ** 2).sum(1).max() ** 0.5 < 1 + 0.0015 / head.RADII.min()


def test_no_element_and_no_voxel_is_folded(made, updated):
    mesh = made[0].mesh
    assert quality(mesh.nodes + updated.update.displacement, mesh.tetrahedra).min() > 0
    assert updated.now_from_pmr.least_stretch() > 0
    assert updated.pmr_from_now.least_stretch() > 0


def test_resected_tissue_is_out(made, updated):
    """Half of a tumour: what is told of it is of the other half."""
    model, mr, field, turn = made
    tumour = model.labels['tumour']
    voxels = np.argwhere(tumour.data > 0.5)
    upper = (tumour.to_pmr(voxels) @ turn - head.TUMOUR) @ head.OUTWARD > 0
    part = np.zeros_like(tumour.data)
    part[tuple(voxels[upper].T)] = 1
    half = update_case(model, mr, field, turn @ DOWN, model.labels, resected=replace(tumour, data=part))
    before, after = (one.labels.data == 1 for one in (updated, half))
    assert 0.4 * before.sum() < after.sum() < 0.6 * before.sum()
    assert half.summary['labels']['tumour']['resected'] == pytest.approx(upper.mean(), abs=1e-3) and 0.4 < upper.mean() < 0.6
    structure, = half.structures
    assert ((structure.was @ turn - head.TUMOUR) @ head.OUTWARD).max() < 0.004
    assert len(structure.whole[0]) == len(updated.structures[0].was)
    hole = half.mr.data[before & ~after]
    known, gone = (located(model, half.update, tumour.to_pmr(voxels), *more)[2] for more in ((), (half.resected,)))
    assert not gone[upper].any() and (gone[~upper] == known[~upper]).all() and known[~upper].mean() > 0.6
    assert np.median(hole) == mr.data.min() and updated.mr.data[before].min() > 60   # the tumour is bright


def test_where_all_of_a_label_is_resected_nothing_of_it_is_now(made):
    model, mr, field, turn = made
    doubted = replace(mr, warnings=('the header names no unit of length; taken as mm',))
    updated = update_case(model, doubted, field, turn @ DOWN, model.labels, resected=model.labels['tumour'])
    assert updated.summary['labels']['tumour'] == {'value': 1, 'resected': 1.0}
    assert 'MR: the header names no unit of length; taken as mm' in updated.summary['warnings']
    assert not updated.labels.data.any() and not len(updated.structures[0].quads) and len(updated.structures[0].whole[1])
    assert not [text for text in updated.summary['warnings'] if 'resected' in text]
    assert updated.summary['resected_mm3'] == pytest.approx(4 / 3 * np.pi * head.TUMOUR_RADIUS ** 3 * 1e9, rel=0.25)
    _, _, known = located(model, updated.update, (turn @ head.TUMOUR)[None])
    assert not known[0]


@pytest.fixture(scope='module')
def with_falx():
    mr, brain, tumour = head.volumes()
    points, _ = head.surface_grid()
    grid = np.stack(np.meshgrid(*[np.arange(n) for n in mr.data.shape], indexing='ij'), -1)
    places = mr.to_pmr(grid)

    def label(name, inside):
        return Volume(inside.astype(np.float32), mr.T_pmr_voxel, 'RAS', name)
    labels = {'tumour': tumour, 'falx': label('falx', head.inside('falx', places)), 'ventricles': label('ventricles', head.inside('ventricles', places))}
    around = (np.linalg.norm(places - head.TUMOUR, axis=-1) < 0.03) & ~np.any([l.data > 0.5 for l in labels.values()], 0)
    labels['oedema'] = label('oedema', around)
    return prepare_model(mr, brain, head.CRANIOTOMY, points[np.isfinite(points[..., 0])], labels, SETTINGS)


def response(model, loads, theta):
    """Pulls of what loads do alone at the exposed surface, and the displacement (N, 3) of all nodes."""
    points, _ = head.surface_grid(step=0.001)
    start = points[np.isfinite(points[..., 0])]
    pulls = bin_field(model, start, np.zeros_like(start), np.full(len(start), 0.0002))
    known = Condensed(model, loads.forces, np.zeros(len(model.tissue), bool), UpdateSettings(), np.zeros(0, int))
    told = replace(loads, mean=theta, covariance=1e-12 * np.eye(len(theta)))
    system = System(known, rows_of(known, model, pulls, np.ones(len(pulls.triangle), bool)), pulls.displacement.ravel(),
                    np.full(3 * len(pulls.sd), 1e3), told)
    found, force = system.solution(0.001)
    moved = (known.columns @ found + known.everywhere(force[:, None])[:, 0]).reshape(-1, 3)
    surface = (pulls.weights[..., None] * moved[model.mesh.border[pulls.triangle]]).sum(1)
    return replace(pulls, displacement=surface), moved


@pytest.mark.parametrize('bulges', [True, False])
def test_a_load_that_explains_all_vectors_is_found_whole(with_falx, bulges):
    """What the skull does to a load is mechanics: it does not make the load less likely."""
    loads = loads_of(with_falx, DOWN, bulges, np.ones(len(with_falx.tissue), bool))
    pulls, moved = response(with_falx, loads, np.array([0.0, 0.25]) if bulges else np.array([1.5, 1.0, 0.5, 0.0]))
    found = update(with_falx, pulls, DOWN)
    error = np.linalg.norm(found.displacement - moved, axis=1)
    assert np.median(error) < 0.1 * np.median(np.linalg.norm(pulls.displacement, axis=1))
    if bulges:
        assert found.swelling == pytest.approx(0.25, rel=0.15)


def test_the_surface_does_not_tell_what_swells(with_falx):
    """The whole brain, and what is near the craniotomy, swollen until the same surface rises by 4 mm."""
    names = tuple('brain' if name in ('oedema', 'tumour') else name for name in with_falx.tissues)
    model = replace(with_falx, tissues=names)
    loads = loads_of(model, None, True, np.ones(len(model.tissue), bool))
    tumour = np.linalg.norm(model.mesh.nodes - head.TUMOUR, axis=1) < head.TUMOUR_RADIUS
    lifted = []
    for part in np.eye(2):
        pulls, moved = response(model, loads, 0.1 * part)
        lifted.append((moved[tumour] @ head.OUTWARD).mean() / np.percentile(pulls.displacement @ head.OUTWARD, 99) * 0.004)
    print(f'the tumour rises by {lifted[0] * 1000:.1f} and {lifted[1] * 1000:.1f} mm')
    assert lifted[0] > 1.5 * lifted[1] > 0


def test_dura_and_fluid_do_not_swell(with_falx):
    names = np.array(with_falx.tissues)[with_falx.tissue]
    for name in ('falx', 'ventricles'):
        alone = loads_of(with_falx, None, True, names == name)
        assert not alone.forces.any(), name


def test_what_swells_is_the_oedema_that_is_known_or_what_is_near_the_tumour(with_falx):
    kept = np.ones(len(with_falx.tissue), bool)
    assert loads_of(with_falx, None, True, kept).swells == 'the tissue of the label "oedema"'
    without = replace(with_falx, tissues=tuple('brain' if name == 'oedema' else name for name in with_falx.tissues))
    assert loads_of(without, None, True, kept).swells == 'the tissue around the tumour'
    nothing = replace(with_falx, tissues=tuple('brain' if name in ('oedema', 'tumour') else name for name in with_falx.tissues))
    assert loads_of(nothing, None, True, kept).swells == 'the tissue near the craniotomy'


def test_woodbury_is_the_model_without_those_elements(made):
    """The same vectors and loads in a model that never had them."""
    from cortshift_tracking.model.elasticity import stiffness
    model = made[0]
    resected = model.tissue == 1
    known = Condensed(model, np.zeros((3 * len(model.mesh.nodes), 1)), resected, UpdateSettings(), np.zeros(0, int))
    force = np.zeros((len(known.compliance), 1))
    force[2] = 1e-3
    found = known.everywhere(force)[:, 0]
    whole = known.model.factor.solve(_full(model, force))
    # The residual of the changed stiffness: K u - gone u = f.
    nodes = np.unique(model.mesh.tetrahedra[resected])
    number = np.full(len(model.mesh.nodes), -1)
    number[nodes] = np.arange(len(nodes))
    gone = 0.999 * stiffness(model.mesh.nodes[nodes], number[model.mesh.tetrahedra[resected]], model.lame[resected])
    dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
    back = np.zeros(len(found))
    back[dofs] = gone @ found[dofs]
    assert np.allclose(found - known.model.factor.solve(back), whole[:, 0], atol=1e-9 * np.abs(found).max() + 1e-12, rtol=1e-6)
    assert not np.allclose(found, whole[:, 0], rtol=1e-3)


def test_resected_tissue_away_from_what_is_kept_is_solved_in_blocks(made, monkeypatch):
    """The same numbers, and no more right sides at once."""
    model = made[0]
    deep = np.linalg.norm(model.mesh.nodes[model.mesh.tetrahedra].mean(1), axis=1) < 0.02
    assert not np.isin(model.mesh.tetrahedra[deep], model.zone).all()
    widest, found, solve = [], [], type(model.factor).solve

    def seen(factor, right):
        widest[-1] = max(widest[-1], np.shape(right)[1])
        return solve(factor, right)
    monkeypatch.setattr(type(model.factor), 'solve', seen)
    for at_once in (10000, 40):
        monkeypatch.setattr(system_module, 'AT_ONCE', at_once)
        widest.append(0)
        found.append(Condensed(model, np.zeros((3 * len(model.mesh.nodes), 1)), deep, UpdateSettings(), np.zeros(0, int)))
    assert widest[0] > 100 and widest[1] == 40
    assert np.allclose(found[0].compliance, found[1].compliance, rtol=1e-9, atol=1e-9 * np.abs(found[0].compliance).max())


def _full(model, force):
    full = np.zeros((3 * len(model.mesh.nodes), 1))
    full[(3 * model.zone[:, None] + np.arange(3)).ravel()] = force[:3 * len(model.zone)]
    return full


def test_a_linear_motion_is_met_at_every_grid_point(made):
    """Linear elements and linear interpolation hold it exactly; and the grid has no hole in the brain."""
    model, mr, _, _ = made
    slope = np.array([[0.01, 0.02, 0.0], [0.0, -0.015, 0.01], [0.02, 0.0, 0.012]])
    warp, _ = warps_of(model, SimpleNamespace(displacement=model.mesh.nodes @ slope.T), mr)
    points = np.argwhere(warp.brain) @ warp.T_pmr_grid[:3, :3].T + warp.T_pmr_grid[:3, 3]
    np.testing.assert_allclose(warp.vectors[warp.brain], points @ slope.T, atol=1e-8)
    cell = abs(np.linalg.det(warp.T_pmr_grid[:3, :3]))
    assert warp.brain.sum() * cell == pytest.approx(model.mesh.volumes.sum(), rel=0.02)


def test_files_are_what_was_said(made, updated, tmp_path):
    write_update(updated, str(tmp_path))
    assert {name.name for name in tmp_path.iterdir()} == {'updated_mr.nii.gz', 'labels_now.nii.gz', 'now_from_pmr.nrrd', 'pmr_from_now.nrrd',
                                                          'summary.json'}
    summary = json.loads((tmp_path / 'summary.json').read_text())
    assert {'the rows do not agree', 'no resected part was given: tissue that was taken out counts as there'} <= set(summary['warnings'])
    assert summary['made_with']['field'] == {'software': '1.0', 'configuration': 'c', 'calibration': 'd'}
    assert summary['made_with']['software']
    assert summary['labels']['tumour']['value'] == 1
    assert 0 < summary['labels']['tumour']['centre_shift_mm'] < 9
    header = (tmp_path / 'pmr_from_now.nrrd').read_bytes().split(b'\n\n')[0].decode()
    assert 'pmr_from_now' in header and 'left-posterior-superior' in header


def test_plastimatch_warps_the_mr_to_the_same(made, updated, tmp_path):
    """An independent program, with ITK's conventions, and both directions."""
    _, mr, _, _ = made
    write_update(updated, str(tmp_path))
    save_nifti(mr, str(tmp_path / 'mr.nii'))
    warp = ['plastimatch', 'warp', '--fixed', 'mr.nii', '--output-type', 'float']
    for source, field, out in (('mr.nii', 'pmr_from_now.nrrd', 'there.nii'), ('updated_mr.nii.gz', 'now_from_pmr.nrrd', 'back.nii')):
        done = subprocess.run([*warp, '--input', source, '--xf', field, '--output-img', out], cwd=str(tmp_path), capture_output=True)
        assert done.returncode == 0, done.stdout + done.stderr
    ours = nibabel.load(str(tmp_path / 'updated_mr.nii.gz')).get_fdata()
    theirs = nibabel.load(str(tmp_path / 'there.nii')).get_fdata()
    inner = tuple(slice(4, -4) for _ in range(3))
    moved = np.abs(ours - mr.data)[inner] > 5
    assert moved.sum() > 500
    assert np.percentile(np.abs(ours - theirs)[inner], 99.9) < 1.5   # of about 130
    assert np.abs(ours - theirs)[inner][moved].mean() < 0.01 * np.ptp(mr.data)
    back = nibabel.load(str(tmp_path / 'back.nii')).get_fdata()
    brain = np.linalg.norm(made[1].to_pmr(np.argwhere(np.ones(mr.data.shape))) @ made[3] / head.RADII, axis=1).reshape(mr.data.shape) < 0.85
    assert np.abs(back - mr.data)[brain].mean() < 0.3 * np.abs(ours - mr.data)[brain & (np.abs(ours - mr.data) > 1)].mean()


def test_both_directions_belong_together(made, updated):
    points = made[0].mesh.nodes[::37]
    inner = ((points @ made[3] / head.RADII) ** 2).sum(1) < 0.8
    there = points[inner] + updated.now_from_pmr.at(points[inner])
    back = there + updated.pmr_from_now.at(there)
    assert np.percentile(np.linalg.norm(back - points[inner], axis=1), 95) < 0.00015


def test_a_model_survives_its_file(made, updated, tmp_path):
    model, _, field, turn = made
    save_model(model, str(tmp_path / 'model.npz'))
    again = load_model(str(tmp_path / 'model.npz'))
    start, moved = (values[field.valid] for values in (field.start, field.displacement))
    result = update(again, bin_field(again, start, moved, None), turn @ DOWN)
    assert np.abs(result.displacement - updated.update.displacement).max() < 1e-6
    assert (again.labels['tumour'].data == model.labels['tumour'].data).all() and again.provenance == model.provenance


# ---- refusals -------------------------------------------------------------------------------------------------------------

def test_a_field_off_the_model_is_refused(made):
    model, mr, field, turn = made
    off = field_of(field.start + turn @ [0, 0.06, -0.02], field.displacement)
    with pytest.raises(ModelError, match="of the field lies within 10 mm of the model's surface .* of another craniotomy"):
        update_case(model, mr, off, None, {})


def test_a_field_on_resected_tissue_alone_is_refused(made):
    model, _, field, _ = made
    start, moved = (values[field.valid] for values in (field.start, field.displacement))
    near = np.linalg.norm(model.mesh.nodes[model.mesh.tetrahedra].mean(1) - model.craniotomy, axis=1) < 0.045
    with pytest.raises(ModelError, match='every vector lies on tissue that was resected'):
        update(model, bin_field(model, start, moved, None), resected=near)


def test_a_model_of_another_mr_is_refused(made):
    model, mr, field, _ = made
    other = Volume(mr.data + 1, mr.T_pmr_voxel, mr.axes, 'other.nii')
    with pytest.raises(ModelError, match=r'the model is of another MR \(mr.nii\) than other.nii; prepare one of this MR'):
        update_case(model, other, field, None, {})


def test_an_epoch_that_differs_is_refused(made):
    model, mr, field, _ = made
    with pytest.raises(ModelError, match=r'changed between them \(epochs before: 1, after: 2\); capture both stages in one epoch'):
        update_case(model, mr, field, None, {}, epochs={'before': 1, 'after': 2})


def test_tools_refuse_and_work(tmp_path):
    """The command lines, end to end: no MR, then prepared; no field there."""
    scripts = os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', '..', 'scripts')
    mr, brain, tumour = head.volumes(step=0.003)
    for volume, name in ((mr, 'mr.nii'), (brain, 'brain.nii'), (tumour, 'tumour.nii')):
        save_nifti(volume, str(tmp_path / name))

    def run(tool, *arguments):
        return subprocess.run([sys.executable, os.path.join(scripts, tool), *arguments], cwd=str(tmp_path), capture_output=True, text=True)
    middle = [f'{1000 * value:.2f}' for value in head.CRANIOTOMY]
    done = run('prepare_model', '.', '--output', 'model.npz', '--craniotomy', *middle)
    assert done.returncode == 1 and 'no MR given; a brain model is made from the preoperative MR' in done.stderr
    done = run('prepare_model', '.', '--mr', 'mr.nii', '--brain', 'brain.nii', '--label', 'tumour=tumour.nii', '--output', 'model.npz',
               '--craniotomy', *middle, '--elements', '6000')
    assert done.returncode == 0, done.stderr
    done = run('update_mr', '.', '--model', 'model.npz', '--shift', 'before', '--output', 'out')
    assert done.returncode == 1 and 'give FROM:TO, two keys' in done.stderr
    done = run('update_mr', '.', '--model', 'model.npz', '--shift', 'before:after', '--output', 'out')
    assert done.returncode == 1 and 'holds no stage' in done.stderr
