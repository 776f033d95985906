"""The update on grids: both directions of the warp, the MR and the labels as they are now, and files that other programs read."""
import gzip
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from cortshift_tracking.durable import write_durably
from cortshift_tracking.errors import CortshiftError
from cortshift_tracking.model.structures import by_precedence
from cortshift_tracking.mr.volume import AXES_FROM_RAS, Volume

STEP = 0.002          # of the grids of vectors [m]
AT_ONCE = 1000000     # grid points, so that memory stays small
LEAST_FADE = 0.006    # outside the brain vectors fade to nothing over this, or over twice the largest [m]: nothing folds there


@dataclass(frozen=True)
class Warp:
    """Vectors (I, J, K, 3) in pmr [m] at T_pmr_grid. brain (I, J, K): where the model says them; elsewhere they fade."""
    vectors: np.ndarray
    T_pmr_grid: np.ndarray
    brain: np.ndarray
    axes: str

    def at(self, points):
        """Vectors at points (N, 3) in pmr, linear between the grid's, 0 outside."""
        inverse = np.linalg.inv(self.T_pmr_grid)
        index = (np.asarray(points) @ inverse[:3, :3].T + inverse[:3, 3]).T
        return np.stack([ndimage.map_coordinates(self.vectors[..., n], index, order=1, mode='constant') for n in range(3)], -1)

    def least_stretch(self):
        """Smallest determinant of the deformation over the grid: not above 0, and something is folded."""
        step = np.linalg.norm(self.T_pmr_grid[:3, :3], axis=0)
        turn = self.T_pmr_grid[:3, :3] / step
        slope = np.stack(np.gradient(self.vectors, *step, axis=(0, 1, 2)), -1) @ turn.T
        return float(np.linalg.det(np.eye(3) + slope).min())


def grid_of(volume, step=STEP):
    """Shape and T_pmr_grid of a grid along a volume's axes, over all of it."""
    shape = np.ceil((np.array(volume.data.shape) - 1) * volume.spacing / step).astype(int) + 1
    T = volume.T_pmr_voxel.copy()
    T[:3, :3] *= step / volume.spacing
    return tuple(shape), T


def warps_of(model, update, volume):
    """now_from_pmr and pmr_from_now on a grid over the MR: where a point of the MR is now, and where a point of now was."""
    now = model.mesh.nodes + update.displacement
    return (_sampled(model, model.mesh.nodes, update.displacement, volume), _sampled(model, now, -update.displacement, volume))


def _sampled(model, nodes, vectors, volume):
    shape, T = grid_of(volume)
    inverse = np.linalg.inv(T)
    index = nodes @ inverse[:3, :3].T + inverse[:3, 3]
    low = np.clip(np.floor(index.min(0)).astype(int), 0, np.array(shape) - 1)
    high = np.clip(np.ceil(index.max(0)).astype(int) + 1, 1, shape)
    grid, brain = np.zeros((*shape, 3), np.float32), np.zeros(shape, bool)
    for part in _parts(index[model.mesh.tetrahedra], shape):
        points, tetrahedron, weights = _grid_points_in(index[model.mesh.tetrahedra[part]], shape)
        at = tuple(points.T)
        grid[at] = np.einsum('nc,ncj->nj', weights, vectors[model.mesh.tetrahedra[part][tetrahedron]])
        brain[at] = True
    if not brain.any():
        raise CortshiftError(f'{volume.source}: holds nothing of the model; give the MR that the model is of')
    step = np.linalg.norm(T[:3, :3], axis=0)
    fade = max(LEAST_FADE, 2 * float(np.linalg.norm(vectors, axis=1).max()))
    margin = int(np.ceil(fade / step.min())) + 1
    part = tuple(slice(max(0, a - margin), min(s, b + margin)) for a, b, s in zip(low, high, shape))
    away, nearest = ndimage.distance_transform_edt(~brain[part], sampling=step, return_indices=True)
    share = np.clip(1 - away / fade, 0, 1)
    grid[part] = grid[part][tuple(nearest)] * share[..., None]
    return Warp(grid, T, brain, volume.axes)


def _boxes(corners, shape):
    """First grid point and number of them along each axis, of the boxes around tetrahedra with corners (N, 4, 3) in grid points."""
    low = np.clip(np.ceil(corners.min(1) - 1e-6), 0, shape).astype(int)
    high = np.clip(np.floor(corners.max(1) + 1e-6), -1, np.array(shape) - 1).astype(int)
    return low, np.maximum(high - low + 1, 0)


def _parts(corners, shape):
    """Slices of the tetrahedra whose boxes hold AT_ONCE grid points or few more."""
    held = np.cumsum(_boxes(corners, shape)[1].prod(1))
    ends = np.unique(np.append(np.searchsorted(held, np.arange(AT_ONCE, held[-1], AT_ONCE)) + 1, len(corners)))
    return [slice(a, b) for a, b in zip([0, *ends[:-1]], ends)]


def _grid_points_in(corners, shape):
    """Grid points (M, 3) in tetrahedra with corners (N, 4, 3) [grid points], which one (M,), and barycentric weights (M, 4)."""
    low, size = _boxes(corners, shape)
    count = size.prod(1)
    owner = np.repeat(np.arange(len(corners)), count)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    rest, k = np.divmod(place, size[owner, 2])
    points = low[owner] + np.stack([*np.divmod(rest, size[owner, 1]), k], -1)
    inverse = np.linalg.inv(corners[:, 1:] - corners[:, :1])
    local = np.einsum('nj,njk->nk', points - corners[owner, 0], inverse[owner])
    weights = np.concatenate([1 - local.sum(1, keepdims=True), local], 1)
    inside = weights.min(1) > -1e-9
    return points[inside], owner[inside], weights[inside]


def warped(volume, pmr_from_now, order=1):
    """The volume as it is now, on its own grid. order 0 for labels."""
    moving = np.argwhere(np.abs(pmr_from_now.vectors).max(-1) > 1e-6)
    result = volume.data.copy()
    if not len(moving):
        return result
    to_voxel = np.linalg.inv(volume.T_pmr_voxel) @ pmr_from_now.T_pmr_grid
    ends = np.stack([moving.min(0) - 1, moving.max(0) + 1])
    corners = np.array([[ends[i, 0], ends[j, 1], ends[k, 2], 1] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) @ to_voxel[:3].T
    low = np.clip(np.floor(corners.min(0)).astype(int), 0, volume.data.shape)
    high = np.clip(np.ceil(corners.max(0)).astype(int) + 1, 0, volume.data.shape)
    linear = np.linalg.inv(volume.T_pmr_voxel)[:3, :3].astype(np.float32)
    back = np.diag(np.linalg.inv(to_voxel))   # the grid lies along the volume's axes, from the same corner
    in_voxels = pmr_from_now.vectors @ linear.T
    for axis in (2, 1):
        in_voxels = _between(in_voxels, np.arange(low[axis], high[axis]) * back[axis], axis)
    for i in range(low[0], high[0], 16):   # slabs: a whole head need not be held several times
        rows = np.arange(i, min(i + 16, high[0]))
        source = np.moveaxis(_between(in_voxels, rows * back[0], 0), -1, 0).copy()
        for axis, numbers in enumerate((rows, np.arange(low[1], high[1]), np.arange(low[2], high[2]))):
            source[axis] += numbers.astype(np.float32).reshape([-1 if n == axis else 1 for n in range(3)])
        result[rows[0]:rows[-1] + 1, low[1]:high[1], low[2]:high[2]] = ndimage.map_coordinates(volume.data, source, order=order, mode='nearest')
    return result


def _between(values, places, axis):
    """Values at places along an axis [grid points], linear between its own."""
    last = values.shape[axis] - 1
    first = np.clip(np.floor(places).astype(int), 0, last)
    share = (places - first).astype(np.float32).reshape([-1 if n == axis else 1 for n in range(values.ndim)])
    return np.take(values, first, axis) * (1 - share) + np.take(values, np.minimum(first + 1, last), axis) * share


def write_nrrd(warp, path, says):
    """Write a Warp as NRRD: vectors in LPS, millimetres, as ITK's and 3D Slicer's displacement fields. says: its direction in words."""
    lps = AXES_FROM_RAS['LPS'] @ np.linalg.inv(AXES_FROM_RAS[warp.axes])
    affine = lps @ warp.T_pmr_grid
    vectors = (warp.vectors.reshape(-1, 3) @ lps[:3, :3].T * 1000).astype('<f4').reshape(warp.vectors.shape)

    def triple(values):
        return '(' + ','.join(f'{1000 * value:.9g}' for value in values) + ')'
    header = ['NRRD0005', f'# {says}', 'type: float', 'dimension: 4', 'space: left-posterior-superior',
              'sizes: 3 ' + ' '.join(map(str, vectors.shape[:3])),
              'space directions: none ' + ' '.join(triple(affine[:3, n]) for n in range(3)), 'kinds: vector domain domain domain',
              'endian: little', 'encoding: gzip', 'space units: "mm" "mm" "mm"', f'space origin: {triple(affine[:3, 3])}',
              f'direction:={says}']
    data = np.ascontiguousarray(vectors.transpose(2, 1, 0, 3))
    write_durably(path, ('\n'.join(header) + '\n\n').encode() + gzip.compress(data.tobytes(), 1))


def hole_now(volume, pmr_from_now, resected):
    """Voxels (I, J, K) bool of the MR that are now where tissue was resected (Volume, > 0.5)."""
    before = (np.nan_to_num(_on_grid_of(volume, resected)) > 0.5).astype(np.float32)
    return warped(Volume(before, volume.T_pmr_voxel, volume.axes, volume.source), pmr_from_now, order=0) > 0.5


def labels_now(volume, pmr_from_now, labels, hole):
    """Volume of the labels as they are now: 1, 2 ... in the order of `labels` (name to Volume); where several are, by_precedence.

    hole (I, J, K): of hole_now, where none is any more, or None.
    """
    joined = np.zeros(volume.data.shape, np.float32)
    numbers = {name: number for number, name in enumerate(labels, 1)}
    for name in by_precedence(labels):
        joined[np.nan_to_num(_on_grid_of(volume, labels[name])) > 0.5] = numbers[name]
    now = warped(Volume(joined, volume.T_pmr_voxel, volume.axes, volume.source), pmr_from_now, order=0)
    if hole is not None:
        now[hole] = 0
    return Volume(now, volume.T_pmr_voxel, volume.axes, volume.source)


def _on_grid_of(volume, label):
    if label.data.shape == volume.data.shape and np.allclose(label.T_pmr_voxel, volume.T_pmr_voxel, atol=1e-7):
        return label.data
    index = np.stack(np.meshgrid(*[np.arange(n) for n in volume.data.shape], indexing='ij'), -1)
    return np.stack([label.sample(volume.to_pmr(plane), 1) for plane in index])
