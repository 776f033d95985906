"""The cortex in the preoperative MR: where it is, and its intensity-encoded surface within a craniotomy.

Fan et al. 2012 (named in the paper's discussion) register such a surface to the first stereo surface. T1-weighted volumes
are meant: cerebrospinal fluid darker than brain; vessels may be bright (contrast agent) or dark.
"""
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from cortshift_tracking.errors import VolumeError
from cortshift_tracking.geometry import local_frame, median_spacing, normals, triangles
from cortshift_tracking.mr.volume import Volume

PROFILE_STEP = 0.0001  # along a search line [m]


@dataclass(frozen=True)
class CortexSettings:
    """How the cortex is looked for. Lengths [m]."""
    resolution: float = 0.0003      # of the surface's grid
    reach: float = 0.012            # the cortex is looked for up to this distance from the guiding surface
    mask_step: float = 0.0006       # of the grid on which brain is separated from skull and dura
    opening: float = 0.0012         # layers thinner than twice this (the dura) are removed from the brain
    brain_share: float = 0.45       # of the typical brain intensity; darker is cerebrospinal fluid, bone or air
    edge_reach: float = 0.0015      # around the outermost brain voxel, where the edge is then found to sub-voxel accuracy
    smoothing: float = 0.0003       # standard deviation of the final smoothing along the surface
    encode_depth: float = 0.0016    # intensity is taken over this depth below the surface


@dataclass(frozen=True)
class CortexSurface:
    """An organised surface over a local frame, like one from stereo. Invalid points are NaN.

    points (H, W, 3) in pmr [m]; rows go down and columns right as seen from outside. intensity (H, W), units of the MR:
    brightest over encode_depth. darkest (H, W): the same, darkest.
    """
    points: np.ndarray
    intensity: np.ndarray
    darkest: np.ndarray
    normal_pmr: np.ndarray


def edge_offsets(volume, points_pmr, outward, reach):
    """Signed distance along `outward` (N, 3) from points (N, 3) [m] to the nearest edge from bright inside to dark outside.

    The edge is where the intensity passes half between the darkest value outside of it and the plateau inside, so that
    bright vessels do not push it outwards. NaN where there is no clear edge within `reach` [m].
    """
    t = np.arange(-reach, reach + PROFILE_STEP / 2, PROFILE_STEP)
    profile = volume.sample(points_pmr[:, None] + outward[:, None] * t[:, None], order=3)
    return _edges(profile, t)


def _edges(profile, t):
    """Offsets of the falling edge nearest to t = 0 in profiles (N, T); NaN: none."""
    step = t[1] - t[0]
    slope = np.gradient(profile, step, axis=1)
    window = int(round(0.0008 / step))  # the plateau inside and the dip outside begin within this
    # The steepest fall counts; near the middle of the line it counts a little more.
    score = -slope * np.exp(-0.5 * (t / (0.6 * t[-1])) ** 2)
    score[~np.isfinite(score)] = -np.inf
    steepest = score.argmax(1)
    rows = np.arange(len(profile))
    inside = np.clip(steepest[:, None] + np.arange(-window, 1), 0, len(t) - 1)
    outside = np.clip(steepest[:, None] + np.arange(0, window + 1), 0, len(t) - 1)
    # Means over a third of each window: a single largest or smallest value would follow the noise.
    third = window // 3 + 1
    high = np.partition(profile[rows[:, None], inside], -third, axis=1)[:, -third:].mean(1)
    low = np.partition(profile[rows[:, None], outside], third - 1, axis=1)[:, :third].mean(1)
    level = 0.5 * (high + low)
    # Where the profile falls through that level, linear between samples; of several places the one nearest to the steepest fall.
    above = profile >= level[:, None]
    crossing = above[:, :-1] & ~above[:, 1:]
    distance = np.where(crossing, np.abs(np.arange(len(t) - 1) - steepest[:, None]), len(t))
    at = distance.argmin(1)
    found = (distance[rows, at] <= window) & np.isfinite(level)
    a, b = profile[rows, at], profile[rows, np.minimum(at + 1, len(t) - 1)]
    with np.errstate(invalid='ignore', divide='ignore'):
        offset = t[at] + step * (a - level) / (a - b)
    return np.where(found, offset, np.nan)


def extract_cortex(volume: Volume, guide_points, brain_mask=None, settings=CortexSettings()):
    """Intensity-encoded cortical surface of the MR below a reconstructed surface.

    guide_points: organised surface (H, W, 3) in pmr [m], usually of the first stage; it says where to look and from which
    side. brain_mask: Volume, > 0 inside the brain (from a skull-stripping program), where the automatic one fails.
    Raises VolumeError where no brain is found near the guide.
    """
    frame = local_frame(guide_points)
    guide = frame.to_local(guide_points[np.isfinite(guide_points).all(-1)])
    low, high = np.percentile(guide, 0.5, axis=0), np.percentile(guide, 99.5, axis=0)
    top, bottom = high[2] + settings.reach, low[2] - settings.reach
    corners = frame.to_pmr([[a, b, c] for a in (low[0], high[0]) for b in (low[1], high[1]) for c in (bottom - 0.012, top)])
    volume = volume.crop(corners.min(0) - 0.004, corners.max(0) + 0.004)
    inside = _brain_columns(volume, frame, low, high, top, bottom, brain_mask, settings)

    u = np.arange(low[0], high[0], settings.resolution)
    v = np.arange(low[1], high[1], settings.resolution)[::-1]  # rows go down as seen from outside
    coarse = _outermost(inside, low, top, settings.mask_step, u, v)
    grid = np.stack(np.broadcast_arrays(u[None, :], v[:, None], coarse), -1)
    found = np.isfinite(coarse)
    offsets = np.full(coarse.shape, np.nan)
    outward = np.broadcast_to(frame.normal_pmr, (int(found.sum()), 3))
    offsets[found] = edge_offsets(volume, frame.to_pmr(grid[found]), outward, settings.edge_reach)
    # Once more along the normals of the surface itself: on the walls of a sulcus the normal of the frame is oblique.
    grid[..., 2] = ndimage.median_filter(coarse + offsets, 3)
    rough = frame.to_pmr(grid)
    across = normals(_smooth(rough, 2.0), 2)
    usable = np.isfinite(across).all(-1) & np.isfinite(rough).all(-1)
    fine = np.full(coarse.shape, np.nan)
    fine[usable] = edge_offsets(volume, rough[usable], across[usable], settings.edge_reach)
    # What varies faster along the surface than the voxels can show is noise.
    fine = _smooth(ndimage.median_filter(fine, 5)[..., None], settings.smoothing / settings.resolution)[..., 0]
    points = rough + fine[..., None] * across
    valid = np.isfinite(points).all(-1)
    if valid.mean() < 0.2:
        raise VolumeError(f'{volume.source}: no cortex within {settings.reach * 1000:g} mm of the surface ({valid.mean():.0%} of '
                          'the area); check the patient registration, or give a brain mask')
    depth = np.arange(0.0002, settings.encode_depth, 0.0002)
    samples = volume.sample(points[valid][:, None] - across[valid][:, None] * depth[:, None], order=3)
    bright, dark = np.full(coarse.shape, np.nan), np.full(coarse.shape, np.nan)
    bright[valid], dark[valid] = samples.max(1), samples.min(1)
    points[~np.isfinite(bright)] = np.nan
    return CortexSurface(points, bright, dark, frame.normal_pmr)


def _smooth(points, sigma):
    """Gaussian over the valid points of an organised surface (H, W, N); sigma in grid steps."""
    valid = np.isfinite(points).all(-1)
    weight = ndimage.gaussian_filter(valid.astype(float), sigma)
    filled = np.where(valid[..., None], points, 0)
    with np.errstate(invalid='ignore', divide='ignore'):
        smooth = np.stack([ndimage.gaussian_filter(filled[..., n], sigma) / weight for n in range(points.shape[-1])], -1)
    smooth[~valid] = np.nan
    return smooth


def _brain_columns(volume, frame, low, high, top, bottom, brain_mask, settings):
    """Whether the brain fills the voxels of a block in the local frame: (z from the top down, y up, x) bool."""
    step = settings.mask_step
    depth_below = 0.010  # deep enough to be brain for sure
    z = np.arange(top, bottom - depth_below, -step)
    y, x = np.arange(low[1], high[1] + step, step), np.arange(low[0], high[0] + step, step)
    block = np.stack(np.broadcast_arrays(x, y[:, None], z[:, None, None]), -1)
    intensity = volume.sample(frame.to_pmr(block))
    deep = intensity[z < bottom]
    deep = deep[np.isfinite(deep)]
    if not len(deep):
        raise VolumeError(f'{volume.source}: the surface lies outside the volume; check the patient registration and the axes of '
                          f'pmr ({volume.axes})')
    if brain_mask is not None:
        inside = np.nan_to_num(brain_mask.sample(frame.to_pmr(block))) > 0.5
        if not inside.any():
            raise VolumeError(f'{brain_mask.source}: the brain mask is empty below the surface; give the mask of this MR')
        return inside
    level = settings.brain_share * np.median(deep)
    inside = np.nan_to_num(intensity) > level
    # Only thin bridges connect dura and skull with the brain: erode, keep what is connected with the deep part, dilate again.
    radius = max(1, int(round(settings.opening / step)))
    ball = np.linalg.norm(np.stack(np.meshgrid(*[np.arange(-radius, radius + 1)] * 3)), axis=0) <= radius
    eroded = ndimage.binary_erosion(inside, ball, border_value=1)
    labels, _ = ndimage.label(eroded)
    deep_labels = labels[-1][labels[-1] > 0]
    if not len(deep_labels):
        raise VolumeError(f'{volume.source}: no brain below the surface; check the patient registration, or give a brain mask')
    kept = labels == np.bincount(deep_labels).argmax()
    return ndimage.binary_dilation(kept, ball, iterations=1) & inside


def _outermost(inside, low, top, step, u, v):
    """Height of the outermost brain voxel over each grid point (v, u); NaN where there is none below air."""
    first = inside.argmax(0).astype(float)
    height = top - first * step
    height[~inside.any(0) | (first == 0)] = np.nan
    column = np.clip(np.round((u - low[0]) / step).astype(int), 0, height.shape[1] - 1)
    row = np.clip(np.round((v - low[1]) / step).astype(int), 0, height.shape[0] - 1)
    return height[row[:, None], column]


def distances_to_cortex(points_pmr, cortex):
    """Distance [m] of points (N, 3) from an extracted CortexSurface, positive outside; NaN beyond its border.

    To the nearest of the facets around the nearest vertex, so never less than the exact distance.
    """
    points = np.asarray(points_pmr, float)
    flat = cortex.points.reshape(-1, 3)
    spacing = median_spacing(cortex.points)
    corners = triangles(cortex.points, 6 * spacing)
    around = _facets_of_vertices(corners, len(flat))
    used = np.flatnonzero((around >= 0).any(1))
    nearest = used[cKDTree(flat[used]).query(points)[1]]
    best, signed, aside = np.full(len(points), np.inf), np.full(len(points), np.nan), np.full(len(points), np.inf)
    for column in around.T:
        rows = np.flatnonzero(column[nearest] >= 0)
        facet = flat[corners[column[nearest[rows]]]]
        foot = _nearest_on_triangles(points[rows], facet)
        gap = points[rows] - foot
        length = np.linalg.norm(gap, axis=-1)
        outward = np.cross(facet[:, 2] - facet[:, 0], facet[:, 1] - facet[:, 0])
        outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
        height = (gap * outward).sum(-1)
        closer = length < best[rows]
        best[rows[closer]] = length[closer]
        signed[rows[closer]] = np.where(height < 0, -length, length)[closer]
        aside[rows[closer]] = np.linalg.norm(gap - height[:, None] * outward, axis=-1)[closer]
    return np.where(aside < 3 * spacing, signed, np.nan)  # beyond the border the nearest point lies sideways, not below


def _facets_of_vertices(corners, count):
    """For each of `count` vertices the indices of the triangles (N, 3) it is a corner of, padded with -1."""
    vertex = corners.ravel()
    order = np.argsort(vertex, kind='stable')
    vertex = vertex[order]
    first = np.searchsorted(vertex, vertex)
    table = np.full((count, 6), -1)
    table[vertex, np.arange(len(vertex)) - first] = order // 3
    return table


def _nearest_on_triangles(points, facets):
    """Nearest point (N, 3) of each triangle (N, 3, 3) to each point (N, 3)."""
    a, b, c = facets[:, 0], facets[:, 1], facets[:, 2]
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-30)
    foot = points - ((points - a) * normal).sum(-1, keepdims=True) * normal
    inside = np.ones(len(points), bool)
    on_edge, shortest = a.copy(), np.full(len(points), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        along = q - p
        inside &= (np.cross(along, foot - p) * normal).sum(-1) >= 0
        share = np.clip(((points - p) * along).sum(-1) / np.maximum((along ** 2).sum(-1), 1e-30), 0, 1)
        candidate = p + share[:, None] * along
        length = np.linalg.norm(points - candidate, axis=-1)
        closer = length < shortest
        on_edge[closer], shortest[closer] = candidate[closer], length[closer]
    return np.where(inside[:, None], foot, on_edge)
