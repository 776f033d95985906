"""How well motion at depth is taken out, judged by deformations that another engine made with another law (phantom/make_head_truth).

Beside it: a thin-plate spline through the same vectors, held at the skull opposite, and the mean shift of the surface for all.
"""
import pathlib

import model_head as head
import numpy as np
import pytest
from cortshift_tracking.model.mesh import volumes
from cortshift_tracking.model.prepare import ModelSettings, prepare_model
from cortshift_tracking.model.update import bin_field, update
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

TRUTH = pathlib.Path(__file__).resolve().parents[1] / 'data' / 'head_truth.npz'
NOISE = 0.0002     # standard deviation of each component of a vector's error [m], independent
COMMON = 0.0002    # and what moves all vectors together
DRAWS = (7, 17, 27)   # of both, that a case is judged on
DOWN = -head.OUTWARD


class Truth:
    def __init__(self):
        with np.load(TRUTH) as file:
            self.nodes = file['nodes'] * 1e-6
            self.tetrahedra = file['tetrahedra'].astype(int)
            self.moved = {name: file[name] * 1e-6 for name in file.files if name not in ('nodes', 'tetrahedra')}
        self.tree = cKDTree(self.nodes[self.tetrahedra].mean(1))

    def at(self, points, name):
        """Displacement of points (N, 3), linear in the tetrahedron that holds them or, on the border, the nearest one goes on."""
        near = self.tree.query(points, k=16)[1]
        corners = self.nodes[self.tetrahedra[near]]
        local = np.linalg.solve((corners[..., 1:, :] - corners[..., :1, :]).swapaxes(-1, -2), (points[:, None] - corners[..., 0, :])[..., None])[..., 0]
        weights = np.concatenate([1 - local.sum(-1, keepdims=True), local], -1)
        best = weights.min(-1).argmax(1)
        rows = np.arange(len(points))
        return np.einsum('nc,ncj->nj', weights[rows, best], self.moved[name][self.tetrahedra[near[rows, best]]])


@pytest.fixture(scope='module')
def truth():
    return Truth()


@pytest.fixture(scope='module')
def model():
    mr, brain, _ = head.volumes()
    points, _ = head.surface_grid()
    labels = {}
    grid = np.stack(np.meshgrid(*[np.arange(n) for n in mr.data.shape], indexing='ij'), -1)
    for name in ('falx', 'ventricles', 'tumour'):
        labels[name] = type(mr)(head.inside(name, mr.to_pmr(grid)).astype(np.float32), mr.T_pmr_voxel, 'RAS', name)
    return prepare_model(mr, brain, head.CRANIOTOMY, points[np.isfinite(points[..., 0])], labels, ModelSettings(elements=20000, samples=40))


def measured(truth, name, draw=DRAWS[0]):
    points, _ = head.surface_grid(step=0.001)
    start = points[np.isfinite(points[..., 0])]
    random = np.random.default_rng(draw)
    moved = truth.at(start, name) + random.normal(0, NOISE, start.shape) + random.normal(0, COMMON, 3)
    return start, moved, np.full(len(start), np.sqrt(3 * (NOISE ** 2 + COMMON ** 2)))


def border_of_tumour(name):
    """Points; of a tumour that is gone, those of the brain 3 mm outside."""
    directions = np.random.default_rng(5).standard_normal((600, 3))
    radius = head.TUMOUR_RADIUS + (0.003 if name == 'resection' else 0.0)
    points = head.TUMOUR + radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return points[((points / head.RADII) ** 2).sum(1) < 0.9]


def at_depth(truth, name):
    """Points of the brain deeper than 8 mm below the border and within 50 mm of the craniotomy."""
    middles = truth.nodes[truth.tetrahedra].mean(1)
    chosen = (((middles / (head.RADII - 0.008)) ** 2).sum(1) < 1) & (np.linalg.norm(middles - head.CRANIOTOMY, axis=1) < 0.05)
    chosen &= ~head.inside('ventricles', middles)
    if name == 'resection':
        chosen &= np.linalg.norm(middles - head.TUMOUR, axis=1) > head.TUMOUR_RADIUS + 0.002
    return middles[chosen]


def moved_by(model, result, points):
    tetrahedron, weights = model.places(points)
    assert (tetrahedron >= 0).mean() > 0.99
    nodes = model.mesh.tetrahedra[np.where(tetrahedron >= 0, tetrahedron, 0)]
    return np.einsum('nc,ncj->nj', weights, result.displacement[nodes]), (weights * result.sd[nodes]).sum(1)


def spline(start, moved, points):
    far = head.RADII * np.array([[a, b, c] for a in (-1, 0, 1) for b in (-1, 0, 1) for c in (-1, 0, 1) if a or b or c])
    far /= np.linalg.norm(far / head.RADII, axis=1, keepdims=True)
    far = far[np.linalg.norm(far - head.CRANIOTOMY, axis=1) > 0.045]
    return RBFInterpolator(np.concatenate([start[::11], far]), np.concatenate([moved[::11], 0 * far]), smoothing=1e-7)(points)


def residuals(truth, model, name, missing=0.0, draw=DRAWS[0]):
    """missing: share of the surface, on one side, that shows nothing."""
    start, moved, sd = measured(truth, name, draw)
    aside = (start - head.CRANIOTOMY) @ [1.0, 0.3, -0.4]
    seen = aside <= np.quantile(aside, 1 - missing)
    start, moved, sd = start[seen], moved[seen], sd[seen]
    gone = model.tissue == model.tissues.index('tumour') if name == 'resection' else None
    result = update(model, bin_field(model, start, moved, sd, common=np.sqrt(3) * COMMON), DOWN, gone)
    return result, start, moved


#: Least share of the motion of the tumour's border that is taken out, and largest error / standard deviation. Below a bulge 80 % is not
#: reached, and the update says that it is less sure.
BARS = {'sag': (0.8, 1.5), 'resection': (0.8, 1.5), 'bulge': (0.4, 1.5)}
CASES = tuple(BARS)   # what head_truth.npz holds


@pytest.mark.parametrize('name', CASES)
def test_motion_at_depth_is_taken_out(truth, model, name):
    tumour, deep = border_of_tumour(name), at_depth(truth, name)
    true, true_deep = truth.at(tumour, name), truth.at(deep, name)
    taken_out, error, sd, others = [], [], [], {'spline': [], 'surface shift for all': []}
    for draw in DRAWS:
        result, start, moved = residuals(truth, model, name, draw=draw)
        found, _ = moved_by(model, result, tumour)
        found_deep, sd_deep = moved_by(model, result, deep)
        taken_out.append(np.median(1 - np.linalg.norm(found - true, axis=1) / np.linalg.norm(true, axis=1)))
        error.append(np.linalg.norm(found_deep - true_deep, axis=1))
        sd.append(sd_deep)
        others['spline'].append(np.linalg.norm(spline(start, moved, deep) - true_deep, axis=1))
        others['surface shift for all'].append(np.linalg.norm(moved.mean(0) - true_deep, axis=1))
    print('taken out: ' + ', '.join(f'{share:.1%}' for share in taken_out))
    taken_out, error, sd = np.mean(taken_out), np.concatenate(error), np.concatenate(sd)
    others = {other: np.concatenate(errors) for other, errors in others.items()}
    ratio = np.sqrt((error ** 2).mean() / (sd ** 2).mean())
    print(f'{name}: true {np.median(np.linalg.norm(true, axis=1)) * 1000:.2f} mm at the border of the tumour, taken out {taken_out:.0%}; at depth '
          f'{np.median(error) * 1000:.2f} / {np.percentile(error, 95) * 1000:.2f} mm, error / sd {ratio:.2f}; '
          + ', '.join(f'{other} {np.median(e) * 1000:.2f} / {np.percentile(e, 95) * 1000:.2f} mm' for other, e in others.items())
          + f'; drained {result.drained:.2f}, swelling {result.swelling:.4f}, tau {result.tau:.5f}, skull {result.pressing:.2f}')
    assert taken_out >= BARS[name][0]
    assert np.median(error) <= 0.0010 and np.percentile(error, 95) <= 0.0022
    assert np.median(error) <= 2 / 3 * np.median(others['surface shift for all'])
    assert np.median(error) < np.median(others['spline'])
    assert 0.7 < ratio < BARS[name][1]
    assert ['bulges: what swells below it cannot be told' in text for text in result.warnings] == [True] * (name == 'bulge')


@pytest.mark.parametrize('name', CASES)
def test_a_third_of_the_surface_may_be_missing(truth, model, name):
    deep = at_depth(truth, name)
    error = [np.median(np.linalg.norm(moved_by(model, residuals(truth, model, name, missing)[0], deep)[0] - truth.at(deep, name), axis=1))
             for missing in (0.0, 0.3)]
    print(f'{name}: {error[0] * 1000:.2f} mm at depth, {error[1] * 1000:.2f} mm with 30 % of the surface missing')
    assert error[1] <= 1.2 * error[0]


def test_the_truth_is_a_sound_deformation(truth):
    for name in CASES:
        ratio = volumes(truth.nodes + truth.moved[name], truth.tetrahedra) / volumes(truth.nodes, truth.tetrahedra)
        assert ratio.min() > 0.05, name
