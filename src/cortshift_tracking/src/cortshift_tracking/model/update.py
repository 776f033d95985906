"""The update: measured displacement at the exposed surface to displacement everywhere, with its standard deviation.

Displacement is w + theta_1 gravity + theta_2 swelling, where w is what the model does not know: its covariance is tau^2 K^-1 (K: the stiffness),
so that what is most likely, given vectors d with standard deviation s, is the brain pulled by springs of tau^2 / s^2 (Ji et al. 2009,
PMC2749709): prescribed displacements would make forces of the measurement's noise. tau is that under which the vectors are most likely. The
skull holds a patch of the border that presses on it and lets go of one that does not. The standard deviation is the posterior's, from
draws of w, theta and the vectors' errors that go through the same solution.
"""
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree

from cortshift_tracking.model.brain import ModelError
from cortshift_tracking.model.elasticity import DENSITY, GRAVITY, stiffness, weights_of_nodes

IMPLAUSIBLE = 3   # standard deviations of what was expected of a load: one in 370 is further away


@dataclass(frozen=True)
class UpdateSettings:
    """Lengths [m]."""
    bin: float = 0.0035              # vectors this near to each other pull as one
    least_sd: float = 0.0001         # of a vector's error: the mesh does not show less
    unknown_sd: float = 0.0005       # where the field says none
    farthest: float = 0.010          # a field's start from the model's border
    least_near: float = 0.5          # share of the field that must be nearer
    drained: tuple = (0.5, 0.5)      # fraction of the buoyancy that has gone: mean, standard deviation before anything is measured
    swelling: tuple = (0.0, 0.01)    # volume strain, the same
    contact: float = 1e-3            # of the skull's patches: compliance, as a share of that of the brain there
    left: float = 1e-3               # of the stiffness of resected tissue, for the numbers' sake
    seed: int = 2


@dataclass(frozen=True)
class Update:
    """Displacement (N, 3) [m] and sd (N,) [m]: root mean square length of its error, at the mesh's nodes.

    drained, swelling: as fitted, NaN where not. tau: [sqrt(J)]. pressing: share of the skull's patches that hold. resected (T,) bool.
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
    """Vectors binned. triangle (B,): of the border; weights (B, 3); displacement (B, 3), sd (B,) of each component [m]."""
    triangle: np.ndarray
    weights: np.ndarray
    displacement: np.ndarray
    sd: np.ndarray


def bin_field(model, start, displacement, uncertainty, settings=UpdateSettings()):
    """Pulls of a field: start, displacement (N, 3), uncertainty (N,) or None: root mean square length of the error [m].

    Errors of neighbouring vectors are taken as common: a bin is no better than its vectors. Raises ModelError.
    """
    valid = np.isfinite(start).all(-1) & np.isfinite(displacement).all(-1)
    if valid.sum() < 30:
        raise ModelError(f'the field has only {int(valid.sum())} trusted vectors; compute it again between better stages')
    start, displacement = start[valid], displacement[valid]
    sd = np.full(len(start), settings.unknown_sd) if uncertainty is None else np.nan_to_num(uncertainty[valid], nan=settings.unknown_sd)
    sd = np.maximum(sd / np.sqrt(3), settings.least_sd)
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
    return Pulls(triangles[nearest][enough], _on_triangles(place, corners[nearest])[enough], vector[enough], sd[enough])


def _on_triangles(points, corners):
    """Barycentric weights of points dropped onto triangles, inside them."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = points - corners[:, 0]
    aa, bb, ab, pa, pb = ((x * y).sum(-1) for x, y in ((a, a), (b, b), (a, b), (p, a), (p, b)))
    det = aa * bb - ab * ab
    u, v = (bb * pa - ab * pb) / det, (aa * pb - ab * pa) / det
    weights = np.clip(np.stack([1 - u - v, u, v], -1), 0, None)
    return weights / weights.sum(-1, keepdims=True)


class _Condensed:
    """The model seen from what is kept of it, with tissue taken out."""

    def __init__(self, model, names, gravity, resected, settings):
        self.model, self.settings = model, settings
        self._index = np.full(len(model.mesh.nodes), -1)
        self._index[model.zone] = np.arange(len(model.zone))
        unit = {'gravity': lambda: sum(gravity[n] * model.loads[f'gravity_{axis}'] for n, axis in enumerate('xyz')),
                'swelling': lambda: model.loads['swelling']}
        self.columns = np.stack([unit[name]() for name in names], -1) if names else np.zeros((3 * len(model.mesh.nodes), 0))
        self.samples = np.asarray(model.samples, float)
        self.compliance = model.compliance
        self.correction = None
        if resected.any():
            self._take_out(names, gravity, resected)

    def kept(self, columns):
        """Of full displacements: at the zone's unknowns and on the patches."""
        zone = (3 * self.model.zone[:, None] + np.arange(3)).ravel()
        return np.concatenate([columns[zone], self.model.patches.T @ columns])

    def _take_out(self, names, gravity, resected):
        """Woodbury: the stiffness without the resected tetrahedra, from the inverse of the one with them."""
        model = self.model
        nodes = np.unique(model.mesh.tetrahedra[resected])
        number = np.full(len(model.mesh.nodes), -1)
        number[nodes] = np.arange(len(nodes))
        gone = (1 - self.settings.left) * stiffness(model.mesh.nodes[nodes], number[model.mesh.tetrahedra[resected]], model.lame[resected]).toarray()
        dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
        known = self._index[nodes]
        if (known >= 0).all():
            rows = (3 * known[:, None] + np.arange(3)).ravel()
            kept_by_dofs, inner = self.compliance[:, rows], self.compliance[np.ix_(rows, rows)]
        else:
            unit = np.zeros((3 * len(model.mesh.nodes), len(dofs)))
            unit[dofs, np.arange(len(dofs))] = 1
            full = model.factor.solve(unit)
            kept_by_dofs, inner = self.kept(full), full[dofs]
        middle = solve(np.eye(len(dofs)) - gone @ inner, gone)
        self.compliance = self.compliance + kept_by_dofs @ middle @ kept_by_dofs.T
        self.correction = dofs, middle
        if 'gravity' in names:   # what is gone weighs nothing
            lost = np.zeros((len(model.mesh.nodes), 3))
            lost[:] = -DENSITY * GRAVITY * weights_of_nodes(model.mesh.nodes, model.mesh.tetrahedra, resected.astype(float))[:, None] * gravity
            self.columns[:, names.index('gravity')] += model.factor.solve(lost.ravel())
        self.columns, self.samples = self._corrected(self.columns), self._corrected(self.samples)

    def _corrected(self, columns):
        if self.correction is None:
            return columns
        dofs, middle = self.correction
        force = np.zeros_like(columns)
        force[dofs] = middle @ columns[dofs]
        return columns + self.model.factor.solve(force)

    def everywhere(self, forces):
        """Displacement (3N, k) of forces on what is kept, (3Z + P, k)."""
        model = self.model
        full = np.zeros((3 * len(model.mesh.nodes), forces.shape[1]))
        full[(3 * model.zone[:, None] + np.arange(3)).ravel()] = forces[:3 * len(model.zone)]
        full += model.patches @ forces[3 * len(model.zone):]
        return self._corrected(model.factor.solve(full))


def update(model, pulls, gravity=None, resected=None, settings=UpdateSettings()):
    """Update of a model by Pulls. gravity: its direction in pmr, or None; resected: bool per tetrahedron, or None."""
    resected = np.zeros(len(model.tissue), bool) if resected is None else resected
    names = (['gravity'] if gravity is not None else []) + ['swelling']
    known = _Condensed(model, names, gravity, resected, settings)
    gone = np.isin(model.mesh.border, np.setdiff1d(np.unique(model.mesh.tetrahedra[resected]),
                                                   np.unique(model.mesh.tetrahedra[~resected]))).any(1)
    used = ~gone[pulls.triangle]
    pick, vectors, sd = _rows(known, model, pulls, used), pulls.displacement[used].ravel(), np.repeat(pulls.sd[used], 3)
    system = _System(known, pick, vectors, sd, names, settings)
    tau = system.fit()
    theta, forces = system.solution(tau)
    displacement = known.columns @ theta + known.everywhere(forces[:, None])[:, 0]
    spread = system.draws(tau, theta, np.random.default_rng(settings.seed))
    sd_nodes = np.sqrt((spread ** 2).mean(1).reshape(-1, 3).sum(1))
    at = np.full(2, np.nan)
    at[-1] = theta[-1]
    if gravity is not None:
        at[0] = theta[0]
    warnings = [] if gravity is not None else ['gravity is not known, so that sagging is from the measured vectors alone']
    if abs(at[1] - settings.swelling[0]) > IMPLAUSIBLE * settings.swelling[1]:
        warnings.append(f'the vectors ask for a swelling of {at[1]:.1%}, more than tissue does: the model explains them badly, and the standard '
                        'deviations are too small')
    left = vectors - pick @ known.kept(displacement[:, None])[:, 0]
    return Update(displacement.reshape(-1, 3), sd_nodes, at[0], at[1], tau, float(system.active.mean()), resected,
                  float(np.sqrt((left ** 2).mean() * 3)), warnings)


def _rows(known, model, pulls, used):
    """(3B, kept): from what is kept to the displacement at each pull."""
    nodes = known._index[model.mesh.border[pulls.triangle[used]]]
    count = len(nodes)
    rows = np.broadcast_to((3 * np.arange(count)[:, None] + np.arange(3))[:, None], (count, 3, 3))
    columns = 3 * nodes[:, :, None] + np.arange(3)
    values = np.broadcast_to(pulls.weights[used][:, :, None], (count, 3, 3))
    return coo_matrix((values.ravel(), (rows.ravel(), columns.ravel())), (3 * count, len(known.compliance))).tocsr()


class _System:
    """Springs, skull and loads: one linear system for those patches of the skull that press."""

    def __init__(self, known, pick, vectors, sd, names, settings):
        self.known, self.pick, self.vectors, self.sd = known, pick, vectors, sd
        patches = known.model.patches.shape[1]
        self._first = len(known.compliance) - patches
        pulled = pick @ known.compliance
        self.pulled, self.at_skull = np.asarray(pick @ pulled.T), pulled[:, self._first:]
        self.skull = known.compliance[self._first:, self._first:].copy()
        self.skull[np.diag_indices(patches)] *= 1 + settings.contact
        loads = known.kept(known.columns)
        self.load_pulled, self.load_skull = pick @ loads, loads[self._first:]
        prior = {'gravity': settings.drained, 'swelling': settings.swelling}
        self.mean, self.prior_sd = np.array([prior[name] for name in names]).T
        self.limits = np.array([(0.0, 1.0) if name == 'gravity' else (-np.inf, np.inf) for name in names])
        self.active = np.ones(patches, bool)
        self.fixed = np.full(len(names), np.nan)

    def _matrix(self, tau):
        """System over vectors, pressing patches and loads that are free, scaled by tau^2."""
        a, free = self.active, np.isnan(self.fixed)
        left = np.concatenate([self.pulled + np.diag((self.sd / tau) ** 2), self.at_skull[:, a].T])
        middle = np.concatenate([self.at_skull[:, a], self.skull[np.ix_(a, a)]])
        loads = np.concatenate([self.load_pulled, self.load_skull[a]])[:, free]
        bottom = np.concatenate([loads.T, -np.diag((tau / self.prior_sd[free]) ** 2)], 1)
        return np.concatenate([np.concatenate([left, middle, loads], 1), bottom])

    def _right(self, tau, vectors, gaps, mean):
        """Right side: vectors, where the patches' zero is, and the loads before measuring; (n, k)."""
        free = np.isnan(self.fixed)
        fixed = np.where(free, 0, np.nan_to_num(self.fixed))
        return np.concatenate([vectors - (self.load_pulled @ fixed)[:, None], gaps[self.active] - (self.load_skull[self.active] @ fixed)[:, None],
                               -(tau / self.prior_sd[free])[:, None] ** 2 * mean[free]])

    def _parts(self, x):
        count, press = len(self.vectors), int(self.active.sum())
        theta = np.where(np.isnan(self.fixed)[:, None], 0.0, np.nan_to_num(self.fixed)[:, None]) * np.ones(x.shape[1])
        theta[np.isnan(self.fixed)] = x[count + press:]
        force = np.asarray(self.pick.T @ x[:count])
        force[self._first:][self.active] += x[count:count + press]
        return theta, force

    def solution(self, tau):
        """Loads and forces (kept,), with the patches that press found."""
        for _ in range(40):
            x = solve(self._matrix(tau), self._right(tau, self.vectors[:, None], np.zeros((len(self.active), 1)), self.mean[:, None]),
                      assume_a='sym')
            theta, force = (part[:, 0] for part in self._parts(x))
            gap = self.known.compliance[self._first:] @ force + self.load_skull @ theta
            pulling = self.active & (force[self._first:] > 0)      # the skull would have to pull
            inside = ~self.active & (gap > 0)                      # the brain would be in the skull
            outside = np.isnan(self.fixed) & ((theta < self.limits[:, 0]) | (theta > self.limits[:, 1]))
            if outside.any():
                self.fixed = np.where(outside, np.clip(theta, *self.limits.T), self.fixed)
            elif pulling.any() or inside.any():
                self.active = (self.active & ~pulling) | inside
            else:
                break
        return theta, force

    def fit(self):
        """tau [sqrt(J)] under which the vectors are most likely, with the patches that press then."""
        scale = np.sqrt(np.trace(self.pulled) / len(self.vectors))
        best = None
        for tau in np.geomspace(0.0003, 0.03, 9) / scale:
            self.fixed[:] = np.nan
            if best is None:
                self.solution(tau)
            a = self.active
            held = np.linalg.solve(self.skull[np.ix_(a, a)], np.concatenate([self.at_skull[:, a].T, self.load_skull[a]], 1))
            free = self.pulled - self.at_skull[:, a] @ held[:, :len(self.vectors)]
            loads = self.load_pulled - self.at_skull[:, a] @ held[:, len(self.vectors):]
            covariance = tau ** 2 * free + np.diag(self.sd ** 2) + (loads * self.prior_sd ** 2) @ loads.T
            factor = cho_factor(covariance, lower=True)
            miss = self.vectors - loads @ self.mean
            likely = -0.5 * miss @ cho_solve(factor, miss) - np.log(np.diag(factor[0])).sum()
            if best is None or likely > best[0]:
                best = likely, tau
        self.fixed[:] = np.nan
        return best[1]

    def draws(self, tau, theta, random):
        """Differences (3N, S) of draws of the posterior from its mean, with the patches that press held."""
        prior = tau * self.known.samples
        count = prior.shape[1]
        loads = np.where(np.isnan(self.fixed)[:, None], self.prior_sd[:, None] * random.standard_normal((len(theta), count)), 0.0)
        kept = self.known.kept(prior)
        errors = self.sd[:, None] * random.standard_normal((len(self.vectors), count))
        here = -(self.pick @ kept + self.load_pulled @ loads + errors)
        gaps = -(kept[self._first:] + self.load_skull @ loads)
        held, self.fixed = self.fixed, np.where(np.isnan(self.fixed), np.nan, 0.0)
        x = solve(self._matrix(tau), self._right(tau, here, gaps, np.zeros((len(theta), count))), assume_a='sym')
        change, force = self._parts(x)
        self.fixed = held
        return prior + self.known.columns @ (loads + change) + self.known.everywhere(force)
