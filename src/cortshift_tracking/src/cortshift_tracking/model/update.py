"""The update: measured displacement at the exposed surface to displacement everywhere, with its standard deviation.

Displacement is w + the sum of loads theta: gravity where fluid has drained, more or less of it in each layer across gravity, and swelling of
all and of what is near the craniotomy. w is what the model does not know: its covariance is tau^2 K^-1 (K: the stiffness), so that what is most likely, given vectors d with standard deviation s, is the brain pulled by springs of tau^2 / s^2 (Ji et al. 2009,
PMC2749709): prescribed displacements would make forces of the measurement's noise. tau is that under which the vectors are most likely. The
skull holds a patch of the border that presses on it and lets go of one that does not. The standard deviation is from
draws of w, theta, the vectors' errors and other materials (an ensemble over published ranges) that go through the same solution.
"""
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve
from scipy.sparse import coo_matrix, csc_matrix, hstack, identity, vstack
from scipy.spatial import cKDTree

from cortshift_tracking.model.brain import ModelError
from cortshift_tracking.model.elasticity import (DENSITY, GRAVITY, MATERIALS, gather, gradients, random_forces, smooth_noise, stiffness,
                                                 swelling, weights_of_nodes)
from cortshift_tracking.model.prepare import ModelSettings, patches_of

BULGES = 0.0005     # mean motion outwards of the exposed brain [m]: above what a vector's error comes to
DRAWN = (0.125, 0.375, 0.625, 0.875)   # quantiles of tau that stand for all
IMPLAUSIBLE = 0.05   # volume strain: half of what the fluid in sulci and ventricles, which the mask holds, has of the whole


@dataclass(frozen=True)
class UpdateSettings:
    """Lengths [m]."""
    bin: float = 0.0035              # vectors this near to each other pull as one
    least_sd: float = 0.0001         # of a vector's error: the mesh does not show less
    unknown_sd: float = 0.0005       # where the field says none
    farthest: float = 0.010          # a field's start from the model's border
    least_near: float = 0.5          # share of the field that must be nearer
    drained: tuple = (0.7, 0.7)      # buoyancy that has gone, over softness: mean, standard deviation before anything is measured
    softest: float = 5.0             # softness of the brain over that of MATERIALS: 584 Pa, Taylor & Miller 2004 (J Biomech 37:1263)
    level: tuple = (0.0, 0.4)        # the same of a layer across gravity, beside the rest: how high the fluid stands is not known
    layers: int = 4
    swelling: tuple = (0.0, 0.005)   # volume strain, the same
    oedema: tuple = (0.0, 0.03)      # volume strain of the tissue near the craniotomy, beside the rest
    near: float = 0.04               # what is near the craniotomy [m]
    heterogeneity: float = 0.35      # of Young's modulus from place to place, relative: Budday et al. 2015 (JMBBM 46:318), grey and white matter
    alike: float = 0.02              # over which it is alike
    poisson: tuple = (0.35, 0.49)    # of the brain: Taylor & Miller 2004 to Wittek et al. 2007
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
    """Vectors binned. triangle (B,): of the border; weights (B, 3); displacement (B, 3), sd (B,) of each component [m].

    common: standard deviation of each component of an error that all of them share [m], beside sd.
    """
    triangle: np.ndarray
    weights: np.ndarray
    displacement: np.ndarray
    sd: np.ndarray
    common: float = 0.0


def bin_field(model, start, displacement, uncertainty, settings=UpdateSettings(), common=0.0):
    """Pulls of a field: start, displacement (N, 3), uncertainty (N,) or None: root mean square length of the error [m];
    common: of that part of it which all vectors share.

    Errors of neighbouring vectors are taken as common: a bin is no better than its vectors. Raises ModelError.
    """
    valid = np.isfinite(start).all(-1) & np.isfinite(displacement).all(-1)
    if valid.sum() < 30:
        raise ModelError(f'the field has only {int(valid.sum())} trusted vectors; compute it again between better stages')
    start, displacement = start[valid], displacement[valid]
    sd = np.full(len(start), settings.unknown_sd) if uncertainty is None else np.nan_to_num(uncertainty[valid], nan=settings.unknown_sd)
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


class _Condensed:
    """The model seen from what is kept of it, with tissue taken out.

    What is kept: the zone's unknowns, the patches of the skull, and patches of those nodes of the zone that turn out to be covered.
    """

    def __init__(self, model, names, gravity, resected, settings, covered):
        self.model, self.settings, self._left = model, settings, ~resected
        self._index = np.full(len(model.mesh.nodes), -1)
        self._index[model.zone] = np.arange(len(model.zone))
        self.columns = self._columns(names, gravity, resected)
        self.samples = np.asarray(model.samples, float)
        self._zone = (3 * model.zone[:, None] + np.arange(3)).ravel()
        cover = patches_of(model.mesh, covered, ModelSettings.patch)[0][self._zone] if len(covered) else csc_matrix((len(self._zone), 0))
        count = len(model.compliance)
        self._join = vstack([identity(count), hstack([cover.T, csc_matrix((cover.shape[1], count - len(self._zone)))])]).tocsr()
        self.compliance = self._join @ (self._join @ model.compliance).T
        self.correction = None
        if resected.any():
            self._take_out(names, gravity, resected)

    def _columns(self, names, gravity, resected):
        """Displacement (3N, n) of each load; what is resected weighs nothing and does not swell."""
        mesh, settings = self.model.mesh, self.settings
        if not names:
            return np.zeros((3 * len(mesh.nodes), 0))
        middles, left = mesh.nodes[mesh.tetrahedra].mean(1), ~resected
        forces = []
        if gravity is not None:
            height = middles @ gravity
            layer = np.clip((height - height.min()) / np.ptp(height) * settings.layers, 0, settings.layers - 1).astype(int)
            weights = [weights_of_nodes(mesh.nodes, mesh.tetrahedra, 1.0 * (left & (layer == n))) for n in range(settings.layers)]
            forces += [(DENSITY * GRAVITY * weight[:, None] * gravity).ravel() for weight in [sum(weights), *weights]]
        solid = left & (np.array(self.model.tissues)[self.model.tissue] != 'ventricles')
        near = np.linalg.norm(middles - self.model.craniotomy, axis=1) < settings.near
        forces += [swelling(mesh.nodes, mesh.tetrahedra, self.model.lame, 1.0 * part) for part in (solid, solid & near)]
        return self.model.factor.solve(np.stack(forces, -1))

    def kept(self, columns):
        """Of full displacements: at the zone's unknowns and on the patches."""
        return self._join @ np.concatenate([columns[self._zone], self.model.patches.T @ columns])

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
        # The prepared draws have stresses in what is gone, which would move its soft remains far: draws without them.
        left = model.lame * ~resected[:, None]
        forces = random_forces(model.mesh.nodes, model.mesh.tetrahedra, left, self.samples.shape[1], np.random.default_rng(ModelSettings.seed),
                               ModelSettings.coarsest)
        self.columns, self.samples = self._corrected(self.columns), self._corrected(model.factor.solve(forces))

    def _corrected(self, columns):
        if self.correction is None:
            return columns
        dofs, middle = self.correction
        force = np.zeros_like(columns)
        force[dofs] = middle @ columns[dofs]
        return columns + self.model.factor.solve(force)

    def other_materials(self, displacement, random):
        """First-order change (3N, S) of a displacement (3N,) by draws of other materials: where the brain is stiffer, and how compressible."""
        mesh, settings, count = self.model.mesh, self.settings, self.samples.shape[1]
        slopes, volume = gradients(mesh.nodes, mesh.tetrahedra), mesh.volumes
        slope = np.einsum('taj,tai->tij', slopes, displacement.reshape(-1, 3)[mesh.tetrahedra])
        strain = (slope + slope.transpose(0, 2, 1)) / 2
        first, second = (self.model.lame * self._left[:, None]).T[..., None, None]
        shape = 2 * second * strain
        pressure = first * np.trace(strain, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        stiffer = smooth_noise(mesh.nodes[mesh.tetrahedra].mean(1), settings.alike, count, random) * settings.heterogeneity
        poisson = random.uniform(*settings.poisson, count)
        usual = MATERIALS['brain'].lame
        other = poisson / ((1 + poisson) * (1 - 2 * poisson)) * MATERIALS['brain'].young
        forces = np.empty((3 * len(mesh.nodes), count))
        for n in range(count):
            stress = stiffer[:, n, None, None] * (shape + pressure) + (1 - usual[0] / other[n]) * pressure
            forces[:, n] = -gather(mesh.nodes, mesh.tetrahedra, np.einsum('tij,taj->tai', stress * volume[:, None, None], slopes))
        return self._corrected(self.model.factor.solve(forces))

    def everywhere(self, forces):
        """Displacement (3N, k) of forces on what is kept."""
        model = self.model
        forces = self._join.T @ forces
        full = np.zeros((3 * len(model.mesh.nodes), forces.shape[1]))
        full[self._zone] = forces[:len(self._zone)]
        full += model.patches @ forces[len(self._zone):]
        return self._corrected(model.factor.solve(full))


def update(model, pulls, gravity=None, resected=None, settings=UpdateSettings(), exposed=None):
    """Update of a model by Pulls. gravity: its direction in pmr, or None; resected: bool per tetrahedron, or None.

    exposed: of points (N, 3) in pmr, whether they are in the craniotomy's opening; the skull holds the rest. None: where the model says.
    """
    resected = np.zeros(len(model.tissue), bool) if resected is None else resected
    names = [] if gravity is None else ['gravity'] + ['level'] * settings.layers
    names += ['swelling', 'oedema']
    border = np.intersect1d(model.zone, model.mesh.border)
    covered = border[~exposed(model.mesh.nodes[border])] if exposed is not None else border[:0]
    known = _Condensed(model, names, gravity, resected, settings, covered)
    gone = np.isin(model.mesh.border, np.setdiff1d(np.unique(model.mesh.tetrahedra[resected]),
                                                   np.unique(model.mesh.tetrahedra[~resected]))).any(1)
    used = ~gone[pulls.triangle]
    pick, vectors, sd = _rows(known, model, pulls, used), pulls.displacement[used].ravel(), np.repeat(pulls.sd[used], 3)
    system = _System(known, pick, vectors, sd, names)
    taus = system.fit()
    spread, tau, random = [], float(np.sqrt((taus ** 2).mean())), np.random.default_rng(settings.seed)
    theta, displacement = system.displacement(tau)
    pressing = float(system.active.mean())
    other = np.array_split(known.other_materials(displacement, random), len(taus), 1)
    for one, part, samples in zip(taus, other, np.array_split(known.samples, len(taus), 1)):
        at, mean = system.displacement(one)
        spread.append(system.draws(one, at, random, one * samples + part, pulls.common) + (mean - displacement)[:, None])
    spread = np.concatenate(spread, 1)
    sd_nodes = np.sqrt((spread ** 2).mean(1).reshape(-1, 3).sum(1))
    at = np.full(2, np.nan)
    at[1] = theta[names.index('swelling')]
    if gravity is not None:
        at[0] = theta[0]
    warnings = [] if gravity is not None else ['gravity is not known, so that sagging is from the measured vectors alone']
    if abs(at[1]) > IMPLAUSIBLE:
        warnings.append(f'the vectors ask for a swelling of {at[1]:.1%}, more than tissue does: the model explains them badly, and the standard '
                        'deviations are too small')
    corners = model.mesh.nodes[model.mesh.border[pulls.triangle]]
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    if (pulls.displacement * outwards).sum(1).mean() > BULGES:
        warnings.append('the exposed brain bulges: what swells below it cannot be told from the surface, and displacement at depth and its standard '
                        'deviation are less sure than after sagging (doc/brain_model.md)')
    left = vectors - pick @ known.kept(displacement[:, None])[:, 0]
    return Update(displacement.reshape(-1, 3), sd_nodes, at[0], at[1], tau, pressing, resected,
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

    def __init__(self, known, pick, vectors, sd, names):
        settings = known.settings
        self.known, self.pick, self.vectors, self.sd = known, pick, vectors, sd
        self._first = 3 * len(known.model.zone)
        patches = len(known.compliance) - self._first
        pulled = pick @ known.compliance
        self.pulled, self.at_skull = np.asarray(pick @ pulled.T), pulled[:, self._first:]
        self.skull = known.compliance[self._first:, self._first:].copy()
        self.skull[np.diag_indices(patches)] *= 1 + settings.contact
        loads = known.kept(known.columns)
        self.load_pulled, self.load_skull = pick @ loads, loads[self._first:]
        prior = {'gravity': settings.drained, 'level': settings.level, 'swelling': settings.swelling, 'oedema': settings.oedema}
        self.mean, self.prior_sd = np.array([prior[name] for name in names]).T
        self.limits = np.array([(0.0, settings.softest) if name == 'gravity' else (-np.inf, np.inf) for name in names])
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
        """Draws of tau [sqrt(J)] by how likely the vectors are under it, each with the patches that press then: DRAWN quantiles.

        Errors of neighbours are alike, so that the vectors count as fewer than they are.
        """
        scale = np.sqrt(np.trace(self.pulled) / len(self.vectors))
        settings, found = self.known.settings, []
        taus = np.geomspace(0.03, 0.0003, 17) / scale
        for tau in taus:
            self.fixed[:] = np.nan
            self.solution(tau)
            self.fixed[:] = np.nan
            a = self.active
            held = np.linalg.solve(self.skull[np.ix_(a, a)], np.concatenate([self.at_skull[:, a].T, self.load_skull[a]], 1))
            free = self.pulled - self.at_skull[:, a] @ held[:, :len(self.vectors)]
            loads = self.load_pulled - self.at_skull[:, a] @ held[:, len(self.vectors):]
            covariance = tau ** 2 * free + np.diag(self.sd ** 2) + (loads * self.prior_sd ** 2) @ loads.T
            factor = cho_factor(covariance, lower=True)
            miss = self.vectors - loads @ self.mean
            found.append(-0.5 * miss @ cho_solve(factor, miss) - np.log(np.diag(factor[0])).sum())
            if found[-1] < max(found) - 200:   # smaller ones are less likely still
                break
        weight = np.exp((np.array(found) - max(found)) * (settings.bin / settings.alike) ** 2)
        share = (np.cumsum(weight[::-1]) - weight[::-1] / 2) / weight.sum()
        return np.exp(np.interp(DRAWN, share, np.log(taus[:len(found)][::-1])))

    def displacement(self, tau):
        """Loads, and displacement (3N,)."""
        self.fixed[:] = np.nan
        theta, forces = self.solution(tau)
        return theta, self.known.columns @ theta + self.known.everywhere(forces[:, None])[:, 0]

    def draws(self, tau, theta, random, prior, common):
        """Differences (3N, S) of draws of the posterior from its mean, with the patches that press held; prior (3N, S): before measuring.

        common: see Pulls.
        """
        count = prior.shape[1]
        loads = np.where(np.isnan(self.fixed)[:, None], self.prior_sd[:, None] * random.standard_normal((len(theta), count)), 0.0)
        kept = self.known.kept(prior)
        errors = self.sd[:, None] * random.standard_normal((len(self.vectors), count))
        errors += common * np.tile(random.standard_normal((3, count)), (len(self.vectors) // 3, 1))   # no spring knows of it
        here = -(self.pick @ kept + self.load_pulled @ loads + errors)
        gaps = -(kept[self._first:] + self.load_skull @ loads)
        held, self.fixed = self.fixed, np.where(np.isnan(self.fixed), np.nan, 0.0)
        x = solve(self._matrix(tau), self._right(tau, here, gaps, np.zeros((len(theta), count))), assume_a='sym')
        change, force = self._parts(x)
        self.fixed = held
        return prior + self.known.columns @ (loads + change) + self.known.everywhere(force)
