"""Geometry of organised surfaces: spacing, triangles, normals, and the local frame of the projection (paper 2.5)."""
from dataclasses import dataclass

import numpy as np

from cortshift_tracking.errors import CaseError


LEAST_POINTS = 100  # of a surface: fewer do not say which way it faces


def median_spacing(points):
    """Median distance of neighbouring valid points of an organised surface (H, W, 3), in its unit; NaN if none."""
    lengths = [np.linalg.norm(np.diff(points, axis=axis), axis=-1).ravel() for axis in (0, 1)]
    lengths = np.concatenate(lengths)
    lengths = lengths[np.isfinite(lengths)]
    return float(np.median(lengths)) if len(lengths) else float('nan')


def triangles(points, max_edge):
    """Indices (N, 3) into points.reshape(-1, 3) of the triangles of an organised surface; longer edges are steps, cut."""
    height, width = points.shape[:2]
    index = np.arange(height * width).reshape(height, width)
    a, b, c, d = (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:])
    corners = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([d, c, b], -1).reshape(-1, 3)])
    p = points.reshape(-1, 3)[corners]
    edges = np.linalg.norm(p - np.roll(p, 1, axis=1), axis=-1)
    return corners[(edges <= max_edge).all(1)]  # NaN compares false


def normals(points, stride=1):
    """Unit normals (H, W, 3) of an organised surface from central differences; NaN at holes.

    They point to the side that a camera whose image is organised like the surface looks from (rows down, columns right).
    """
    p = np.asarray(points, float)
    along = np.full(p.shape, np.nan)
    down = np.full(p.shape, np.nan)
    along[:, stride:-stride] = p[:, 2 * stride:] - p[:, :-2 * stride]
    down[stride:-stride] = p[2 * stride:] - p[:-2 * stride]
    n = np.cross(down, along)
    with np.errstate(invalid='ignore', divide='ignore'):
        return n / np.linalg.norm(n, axis=-1, keepdims=True)


@dataclass(frozen=True)
class LocalFrame:
    """z along the average normal, x along the image's columns as far as it can be. T_pmr_local: (4, 4) [m]."""
    T_pmr_local: np.ndarray

    def to_local(self, points_pmr):
        return (np.asarray(points_pmr) - self.T_pmr_local[:3, 3]) @ self.T_pmr_local[:3, :3]

    def to_pmr(self, points_local):
        return np.asarray(points_local) @ self.T_pmr_local[:3, :3].T + self.T_pmr_local[:3, 3]

    @property
    def normal_pmr(self):
        return self.T_pmr_local[:3, 2]


def local_frame(points):
    """LocalFrame of an organised surface (H, W, 3) in pmr; origin at its median point."""
    p = np.asarray(points, float)
    max_edge = 6 * median_spacing(p)
    along, down = np.diff(p, axis=1)[:-1], np.diff(p, axis=0)[:, :-1]
    facet = np.cross(down, along)
    with np.errstate(invalid='ignore'):
        good = (np.linalg.norm(along, axis=-1) < max_edge) & (np.linalg.norm(down, axis=-1) < max_edge)
    if good.sum() < LEAST_POINTS:
        raise CaseError(f'the surface has only {int(good.sum())} connected points; capture the stage again')
    z = facet[good].sum(0)
    z /= np.linalg.norm(z)
    x = along[good].sum(0)
    x -= z * (x @ z)
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    T[:3, 3] = np.median(p[np.isfinite(p).all(-1)], axis=0)
    return LocalFrame(T)
