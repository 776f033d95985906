"""The update: measured displacement at the exposed surface to displacement everywhere, with its standard deviation.

Displacement is w + the sum of loads theta (loads.py), as the skull leaves them. w is what the model does not know: its covariance is
tau^2 K^-1 (K: the stiffness), so that what is most likely, given vectors d with standard deviation s, is the brain pulled by springs of
tau^2 / s^2 (Ji et al. 2009, PMC2749709): prescribed displacements would make forces of the measurement's noise. tau is one under which the
vectors are likely, the displacement the mean over four. The skull holds a patch of the border that presses on it and lets go of one that does not. The standard deviation is
from draws of w, theta, the vectors' errors and other materials (an ensemble over published ranges) that go through the same solution.
"""
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from cortshift_tracking.model.brain import ModelError
from cortshift_tracking.model.loads import LoadSettings, loads_of
from cortshift_tracking.model.system import Condensed, System, rows_of

BULGES = 0.0005     # mean motion outwards of the exposed brain [m]: above what a vector's error comes to
IMPLAUSIBLE = 0.5   # volume strain: white matter with 80 % of water for 70 %, more than oedema brings


@dataclass(frozen=True)
class UpdateSettings:
    """Lengths [m]."""
    bin: float = 0.0035              # vectors this near to each other pull as one
    least_sd: float = 0.0001         # of a vector's error: the mesh does not show less
    unknown_sd: float = 0.0005       # where the field says none
    farthest: float = 0.010          # a field's start from the model's border
    least_near: float = 0.5          # share of the field that must be nearer
    loads: LoadSettings = LoadSettings()
    heterogeneity: float = 0.35      # of Young's modulus from place to place, relative: Budday et al. 2015 (JMBBM 46:318), grey and white matter
    alike: float = 0.05              # over which that, and what the model does not know, is alike at depth: a lobe
    neighbours: float = 0.02         # over which the vectors' errors are
    poisson: tuple = (0.35, 0.49)    # of the brain: Taylor & Miller 2004 to Wittek et al. 2007
    contact: float = 1e-3            # of the skull's patches: compliance, as a share of that of the brain there
    left: float = 1e-3               # of the stiffness of resected tissue, for the numbers' sake
    seed: int = 2


@dataclass(frozen=True)
class Update:
    """Displacement (N, 3) [m] and sd (N,) [m]: root mean square length of its error, at the mesh's nodes.

    drained: mean over the layers; swelling: volume strain of what swells most, below 0 where fluid was lost. The one that is not fitted is NaN.
    tau: mean [sqrt(J)]. pressing: share of the skull's patches that hold, under the largest. resected (T,) bool.
    residual: root mean square of what the springs leave of the vectors [m].
    """
    displacement: np.ndarray
    sd: np.ndarray
    drained: float
    swelling: float
    tau: float
    pressing: float
    resected: np.ndarray
    residual: float
    warnings: list = field(default_factory=list)

    def __post_init__(self):
        if not np.isfinite(self.displacement).all():
            raise ModelError('the update gave displacements that are not numbers; report the case')


@dataclass(frozen=True)
class Pulls:
    """Vectors binned. triangle (B,): of the border; weights (B, 3); displacement (B, 3), sd (B,) of each component [m].

    common: standard deviation of each component of an error that all of them share [m], beside sd.
    """
    triangle: np.ndarray
    weights: np.ndarray
    displacement: np.ndarray
    sd: np.ndarray
    common: float = 0.0


def bin_field(model, start, displacement, uncertainty, settings=UpdateSettings(), common=0.0):
    """Pulls of a field: start, displacement (N, 3), uncertainty (N,) or None: root mean square length of the error [m], not known
    where it is not finite; common: of that part of it which all vectors share.

    Errors of neighbouring vectors are taken as common: a bin is no better than its vectors. Raises ModelError.
    """
    valid = np.isfinite(start).all(-1) & np.isfinite(displacement).all(-1)
    if valid.sum() < 30:
        raise ModelError(f'the field has only {int(valid.sum())} trusted vectors; compute it again between better stages')
    start, displacement = start[valid], displacement[valid]
    sd = np.full(len(start), settings.unknown_sd)
    if uncertainty is not None:
        sd = np.where(np.isfinite(uncertainty[valid]), uncertainty[valid], sd)
    sd = np.maximum(np.sqrt(np.maximum(sd ** 2 - common ** 2, 0) / 3), settings.least_sd)
    in_zone = np.isin(model.mesh.border, model.zone).all(1)
    triangles = np.flatnonzero(in_zone)
    corners = model.mesh.nodes[model.mesh.border[triangles]]
    near, at = cKDTree(corners.mean(1)).query(start)
    size = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)[at]
    good = near < settings.farthest + size
    if good.mean() < settings.least_near:
        raise ModelError(f'only {good.mean():.0%} of the field lies within {settings.farthest * 1000:g} mm of the model\'s surface at the craniotomy '
                         f'(median {np.median(near) * 1000:.1f} mm); the model is of another craniotomy or the patient registration is wrong')
    cell = np.unique(np.floor(start[good] / settings.bin).astype(int), axis=0, return_inverse=True)[1]
    count = np.bincount(cell)

    def mean(values):
        return np.bincount(cell, values) / count
    place, vector = (np.stack([mean(values[good, n]) for n in range(3)], -1) for values in (start, displacement))
    sd = np.sqrt(mean(sd[good] ** 2))
    enough = count >= 0.1 * np.median(count)
    nearest = cKDTree(corners.mean(1)).query(place)[1]
    return Pulls(triangles[nearest][enough], _on_triangles(place, corners[nearest])[enough], vector[enough], sd[enough], common / np.sqrt(3))


def _on_triangles(points, corners):
    """Barycentric weights of points dropped onto triangles, inside them."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = points - corners[:, 0]
    aa, bb, ab, pa, pb = ((x * y).sum(-1) for x, y in ((a, a), (b, b), (a, b), (p, a), (p, b)))
    det = aa * bb - ab * ab
    u, v = (bb * pa - ab * pb) / det, (aa * pb - ab * pa) / det
    weights = np.clip(np.stack([1 - u - v, u, v], -1), 0, None)
    return weights / weights.sum(-1, keepdims=True)


def update(model, pulls, gravity=None, resected=None, settings=UpdateSettings(), exposed=None):
    """Update of a model by Pulls. gravity: its direction in pmr, or None; resected: bool per tetrahedron, or None.

    exposed: of points (N, 3) in pmr, whether they are in the craniotomy's opening; the skull holds the rest. None: where the model says.
    """
    resected = np.zeros(len(model.tissue), bool) if resected is None else resected
    border = np.intersect1d(model.zone, model.mesh.border)
    covered = border[~exposed(model.mesh.nodes[border])] if exposed is not None else border[:0]
    gone = np.isin(model.mesh.border, np.setdiff1d(np.unique(model.mesh.tetrahedra[resected]),
                                                   np.unique(model.mesh.tetrahedra[~resected]))).any(1)
    used = ~gone[pulls.triangle]
    if not used.any():
        raise ModelError('every vector lies on tissue that was resected, so that none says how the rest moved; give the resected part as it is, '
                         'or compute the field to a stage that shows brain beside it')
    corners = model.mesh.nodes[model.mesh.border[pulls.triangle]]
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    bulges = bool((pulls.displacement * outwards).sum(1)[used].mean() > BULGES)
    loads = loads_of(model, gravity, bulges, ~resected, settings.loads)
    known = Condensed(model, loads.forces, resected, settings, covered)
    pick, vectors, sd = rows_of(known, model, pulls, used), pulls.displacement[used].ravel(), np.repeat(pulls.sd[used], 3)
    system = System(known, pick, vectors, sd, loads)
    likely, taus = system.fit()
    spread, random = [], np.random.default_rng(settings.seed)
    theta, displacement = (np.mean(values, 0) for values in zip(*map(system.displacement, likely)))
    pressing = float(system.active.mean())
    other = np.array_split(known.other_materials(displacement, random), len(taus), 1)
    for one, part, samples in zip(taus, other, np.array_split(known.samples, len(taus), 1)):
        _, mean = system.displacement(one)
        spread.append(system.draws(one, random, one * samples + part, pulls.common) + (mean - displacement)[:, None])
    spread = np.concatenate(spread, 1)
    sd_nodes = np.sqrt((spread ** 2).mean(1).reshape(-1, 3).sum(1))
    drained, swollen = (theta.mean(), np.nan) if loads.gravity else (np.nan, theta.sum())
    warnings = [] if bulges or gravity is not None else ['gravity is not known, so that sagging is taken as a loss of fluid everywhere']
    if abs(swollen) > IMPLAUSIBLE:
        warnings.append(f'the vectors ask for a swelling of {swollen:.0%}, more than tissue does: the model explains them badly, and the standard '
                        'deviations are too small')
    if bulges:
        warnings.append(f'the exposed brain bulges: what swells below it cannot be told from the surface; {loads.swells} is taken to, and '
                        'displacement at depth is less sure than after sagging (doc/brain_model.md)')
    left = vectors - pick @ known.kept(displacement[:, None])[:, 0]
    return Update(displacement.reshape(-1, 3), sd_nodes, drained, swollen, float(likely.mean()), pressing, resected,
                  float(np.sqrt((left ** 2).mean() * 3)), warnings)
