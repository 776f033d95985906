"""Surfaces of the labelled structures: where they were in the MR, and where they are now."""
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, diags

from cortshift_tracking.mr.volume import Volume

#: Where labels overlap: the oedema gives way to all others, these to those behind them, and other names to these, in the order of the alphabet.
LEAST_FIRST, ABOVE = 'oedema', ('ventricles', 'falx', 'tentorium', 'tumour')
RELAXED = 4   # times that each vertex goes to the middle of its neighbours, within its own cube of voxels


@dataclass(frozen=True)
class Structure:
    """Of what is left of it. was, now (V, 3): its border in pmr [m]; sd (V,) [m] of now, NaN beside the model; quads (Q, 4): corners in order,
    seen from outside. None of them where all of it was resected. whole: was and quads of it before the resection; (): nothing was taken out.
    """
    name: str
    was: np.ndarray
    now: np.ndarray
    sd: np.ndarray
    quads: np.ndarray
    whole: tuple = ()


def by_precedence(names):
    """Names of labels, those that others cover first. It is the same in whichever order they were given."""
    return sorted(names, key=lambda name: (name != LEAST_FIRST, ABOVE.index(name) + 1 if name in ABOVE else 0, name))


def left_of(label, resected):
    """Volume of what is left of a label, and the share (0-1) of it that was resected. resected: Volume, > 0.5 where tissue has gone."""
    voxels = np.argwhere(label.data > 0.5)
    gone = np.nan_to_num(resected.sample(label.to_pmr(voxels))) > 0.5
    data = label.data.copy()
    data[tuple(voxels[gone].T)] = 0
    return Volume(data, label.T_pmr_voxel, label.axes, label.source), float(gone.mean()) if len(gone) else 0.0


def border_of_label(label):
    """Border of a Volume that is > 0.5 inside: vertices (V, 3) in pmr [m] and quads (Q, 4), counterclockwise seen from outside.

    Surface nets (Gibson 1998): a vertex in each cube of eight voxels that is cut, relaxed within that cube.
    """
    filled = np.argwhere(label.data > 0.5)
    if not len(filled):
        return np.zeros((0, 3)), np.zeros((0, 4), int)
    low, high = filled.min(0), filled.max(0) + 1
    inside = np.pad(label.data[tuple(slice(a, b) for a, b in zip(low, high))] > 0.5, 1)
    shape = np.array(inside.shape) - 1   # of the cubes between voxels
    total, count, quads = np.zeros((shape.prod(), 3)), np.zeros(shape.prod()), []
    for axis in range(3):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        lower, upper = (np.moveaxis(inside, axis, 0)[part] for part in (slice(None, -1), slice(1, None)))
        edges = np.argwhere(np.moveaxis(lower != upper, 0, axis))
        middle = edges + 0.5 * (np.arange(3) == axis)
        around = []
        for on_b, on_c in ((-1, -1), (0, -1), (0, 0), (-1, 0)):
            cell = edges + on_b * (np.arange(3) == b) + on_c * (np.arange(3) == c)
            around.append(np.ravel_multi_index(tuple(cell.T), shape))
            np.add.at(total, around[-1], middle)
            np.add.at(count, around[-1], 1)
        around = np.stack(around, -1)
        leaves = inside[tuple(edges.T)]   # along the axis, one leaves the structure
        quads.append(np.where(leaves[:, None], around, around[:, ::-1]))
    quads = np.concatenate(quads)
    used = np.nonzero(count)[0]
    number = np.full(len(count), -1)
    number[used] = np.arange(len(used))
    quads = number[quads]
    corner = np.stack(np.unravel_index(used, shape), -1)
    vertices = _relaxed(total[used] / count[used][:, None], quads, corner)
    if np.linalg.det(label.T_pmr_voxel[:3, :3]) < 0:
        quads = quads[:, ::-1]
    return label.to_pmr(vertices - 1 + low), quads


def _relaxed(vertices, quads, corner):
    ends = np.concatenate([quads, np.roll(quads, -1, axis=1)]).T.reshape(4, 2, -1)
    a, b = ends[:, 0].ravel(), ends[:, 1].ravel()
    near = coo_matrix((np.ones(2 * len(a)), (np.concatenate([a, b]), np.concatenate([b, a]))), (len(vertices),) * 2).tocsr()
    near.data[:] = 1
    near = diags(1 / np.asarray(near.sum(1)).ravel()) @ near
    for _ in range(RELAXED):
        vertices = np.clip((vertices + near @ vertices) / 2, corner, corner + 1)
    return vertices


def located(model, result, points, resected=None):
    """Where points (N, 3) of the MR are now, their standard deviation [m], and whether they are in the model and not resected.

    resected: Volume, > 0.5 where tissue has gone, which the elements show only as finely as they are; or None.
    """
    tetrahedron, weights = model.places(points)
    known = tetrahedron >= 0
    nodes = model.mesh.tetrahedra[np.where(known, tetrahedron, 0)]
    now = points + np.einsum('nc,ncj->nj', weights, result.displacement[nodes])
    sd = (weights * result.sd[nodes]).sum(1)
    known &= ~result.resected[np.where(known, tetrahedron, 0)]
    if resected is not None:
        known &= ~(np.nan_to_num(resected.sample(points)) > 0.5)
    return np.where(known[:, None], now, np.nan), np.where(known, sd, np.nan), known


def structures_of(model, result, now_from_pmr, labels, left):
    """Structure of each label that holds something. Vertices beside the model go with the warp, as the labels on the grid do.

    labels, left: name to Volume; as they were, and what is left of each.
    """
    structures = []
    for name, label in labels.items():
        whole = border_of_label(label)
        if not len(whole[1]):
            continue
        taken = left[name] is not label
        was, quads = border_of_label(left[name]) if taken else whole
        now, sd, known = located(model, result, was)
        structures.append(Structure(name, was, np.where(known[:, None], now, was + now_from_pmr.at(was)), sd, quads, whole if taken else ()))
    return structures
