"""The volume mesh of the brain: a body-centred lattice, finer below the craniotomy, whose border is drawn onto the mask's.

Tetrahedra of a body-centred lattice are the nearest to regular that fill space, and need no mesher: CGAL's, the first choice, lost
ventricles whose labels it did not hit with its first points, and took minutes (doc/brain_model.md).
"""
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from cortshift_tracking.errors import VolumeError

GRID_STEP = 0.0015     # of the grid on which the distance to the mask's border is held [m]
FINEST = 0.5           # spacing at the craniotomy over that far away
FINE_RADIUS = 0.045    # half of the way from the finest to the coarsest spacing [m]
LEAST_QUALITY = 0.06   # 6 sqrt(2) volume / (root mean square edge)^3: 1 for a regular tetrahedron, 0 for a flat one


@dataclass(frozen=True)
class Distance:
    """Signed distance [m] to the border of a mask, negative inside, on a grid along the axes of pmr."""
    values: np.ndarray
    origin: np.ndarray
    step: float

    def at(self, points):
        """Distance (...) at points (..., 3) in pmr. Beyond the grid: that at its nearest place, and the way from there."""
        index = (np.asarray(points) - self.origin) / self.step
        held = np.clip(index, 0, np.subtract(self.values.shape, 1))
        inside = ndimage.map_coordinates(self.values, np.moveaxis(held, -1, 0), order=1, mode='nearest')
        return inside + np.linalg.norm(index - held, axis=-1) * self.step

    def gradient(self, points):
        offsets = np.eye(3) * self.step
        slope = np.stack([self.at(points + offset) - self.at(points - offset) for offset in offsets], -1)
        return slope / np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-12)


@dataclass(frozen=True)
class Mesh:
    """nodes (N, 3) in pmr [m]; tetrahedra (T, 4), positive volume; border (F, 3): triangles, normals outwards."""
    nodes: np.ndarray
    tetrahedra: np.ndarray
    border: np.ndarray

    @property
    def volumes(self):
        return volumes(self.nodes, self.tetrahedra)

    def node_normals(self):
        """Outward area vectors (N, 3) [m^2]; zero inside."""
        corners = self.nodes[self.border]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 6
        total = np.zeros_like(self.nodes)
        for n in range(3):
            np.add.at(total, self.border[:, n], area)
        return total


def volumes(nodes, tetrahedra):
    a, b, c, d = np.moveaxis(nodes[tetrahedra], 1, 0)
    return np.einsum('ij,ij->i', np.cross(b - a, c - a), d - a) / 6


def quality(nodes, tetrahedra):
    corners = nodes[tetrahedra]
    edges = np.stack([corners[:, a] - corners[:, b] for a, b in ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))], 1)
    length = np.sqrt((edges ** 2).sum(-1).mean(-1))
    return 6 * np.sqrt(2) * volumes(nodes, tetrahedra) / length ** 3


def distance_to(mask):
    """Distance of a Volume that is > 0.5 inside; its voxels may lie obliquely."""
    inside = mask.data > 0.5
    if not inside.any():
        raise VolumeError(f'{mask.source}: the brain mask is empty; give the mask of this MR')
    voxels = np.argwhere(inside)
    ends = mask.to_pmr([[voxels[:, n].min() if m >> n & 1 else voxels[:, n].max() for n in range(3)] for m in range(8)])
    low, high = ends.min(0) - 0.012, ends.max(0) + 0.012
    size = np.ceil((high - low) / GRID_STEP).astype(int) + 1
    axes = [low[n] + GRID_STEP * np.arange(size[n]) for n in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing='ij'), -1)
    index = np.moveaxis(mask.to_voxel(grid), -1, 0)
    filled = ndimage.map_coordinates(inside.astype(np.float32), index, order=1, mode='constant') > 0.5
    outside_distance = ndimage.distance_transform_edt(~filled) - ndimage.distance_transform_edt(filled)
    values = ndimage.gaussian_filter((outside_distance - np.sign(outside_distance) * 0.5) * GRID_STEP, 1.0)
    return Distance(values.astype(np.float32), low, GRID_STEP)


def _radius(rho):
    """Distance from the craniotomy that a lattice point at rho is moved to."""
    return rho * (FINEST + (1 - FINEST) * rho ** 2 / (rho ** 2 + FINE_RADIUS ** 2))


def brain_mesh(distance, craniotomy, elements):
    """Mesh of about `elements` tetrahedra. craniotomy: its middle in pmr [m]."""
    craniotomy = np.asarray(craniotomy, float)
    inside = np.argwhere(distance.values < 0)
    points = distance.origin + distance.step * inside
    rho = np.linspace(1e-6, 1.0, 20001)
    reached = _radius(rho)
    away = np.interp(np.linalg.norm(points - craniotomy, axis=1), reached, rho)
    shrink = np.interp(away, rho, np.gradient(reached, rho) * (reached / rho) ** 2)
    spacing = (12 * (distance.step ** 3 / shrink).sum() / elements) ** (1 / 3)
    # Lattice coordinates that cover the brain: those of its border, taken back.
    scale = np.interp(np.linalg.norm(points - craniotomy, axis=1), reached, rho / reached)
    back = (points - craniotomy) * scale[:, None]
    lattice, tetrahedra = _lattice(back.min(0) - 2 * spacing, back.max(0) + 2 * spacing, spacing)
    rho_of = np.linalg.norm(lattice, axis=1)
    nodes = craniotomy + lattice * (_radius(rho_of) / np.maximum(rho_of, 1e-12))[:, None]
    local = spacing * _radius(np.maximum(rho_of, 1e-6)) / np.maximum(rho_of, 1e-6)
    kept = distance.at(nodes[tetrahedra].mean(1)) < 0
    return _fitted(nodes, tetrahedra[kept], local, distance)


def _lattice(low, high, spacing):
    count = np.ceil((high - low) / spacing).astype(int) + 1
    corner = np.stack(np.meshgrid(*[np.arange(n) for n in count], indexing='ij'), -1).reshape(-1, 3)
    nodes = np.concatenate([low + spacing * corner, low + spacing * (corner + 0.5)])
    number = np.arange(len(corner)).reshape(count)
    middle = number + len(corner)
    tetrahedra = []
    for axis in range(3):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        first = np.moveaxis(middle, (axis, b, c), (0, 1, 2))[:-1, :-1, :-1]
        second = np.moveaxis(middle, (axis, b, c), (0, 1, 2))[1:, :-1, :-1]
        face = np.moveaxis(number, (axis, b, c), (0, 1, 2))[1:]
        ring = [face[:, :-1, :-1], face[:, 1:, :-1], face[:, 1:, 1:], face[:, :-1, 1:]]
        for n in range(4):
            tetrahedra.append(np.stack([first, second, ring[n], ring[(n + 1) % 4]], -1).reshape(-1, 4))
    tetrahedra = np.concatenate(tetrahedra)
    flipped = volumes(nodes, tetrahedra) < 0
    tetrahedra[flipped] = tetrahedra[flipped][:, [1, 0, 2, 3]]
    return nodes, tetrahedra


def border_of(tetrahedra):
    """Triangles of the border, normals outwards, for tetrahedra of positive volume."""
    faces = np.concatenate([tetrahedra[:, order] for order in ([1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1])])
    key = np.sort(faces, axis=1)
    _, index, count = np.unique(key, axis=0, return_index=True, return_counts=True)
    return faces[index[count == 1]]


def _fitted(nodes, tetrahedra, spacing, distance):
    """Border nodes onto the mask's border as far as no tetrahedron is squashed; what remains flat on the border is dropped."""
    for _ in range(3):
        border = np.unique(border_of(tetrahedra))
        target = nodes.copy()
        for _ in range(3):
            gap = distance.at(target[border])
            target[border] -= np.clip(gap, -0.6 * spacing[border], 0.6 * spacing[border])[:, None] * distance.gradient(target[border])
        share = np.ones(len(nodes))
        for _ in range(8):
            moved = nodes + share[:, None] * (target - nodes)
            bad = quality(moved, tetrahedra) < LEAST_QUALITY
            if not bad.any():
                break
            share[np.unique(tetrahedra[bad])] *= 0.6
        nodes = moved
        on_border = np.isin(tetrahedra, border_of(tetrahedra)).sum(1) == 4
        tetrahedra = tetrahedra[~(on_border & (quality(nodes, tetrahedra) < 2 * LEAST_QUALITY))]
    tetrahedra = _in_one_piece(tetrahedra, len(nodes))
    used = np.unique(tetrahedra)
    number = np.full(len(nodes), -1)
    number[used] = np.arange(len(used))
    tetrahedra = number[tetrahedra]
    return Mesh(nodes[used], tetrahedra, border_of(tetrahedra))


def _in_one_piece(tetrahedra, count):
    """The largest part whose tetrahedra hang together."""
    a, b = tetrahedra[:, [0, 0, 0]].ravel(), tetrahedra[:, 1:].ravel()
    _, part = connected_components(coo_matrix((np.ones(len(a)), (a, b)), (count, count)), directed=False)
    of = part[tetrahedra[:, 0]]
    return tetrahedra[of == np.bincount(of).argmax()]
