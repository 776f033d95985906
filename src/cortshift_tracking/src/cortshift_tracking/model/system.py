"""The linear system of the update: what the model does not know, the springs of the vectors, the skull and the loads."""
import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve
from scipy.sparse import coo_matrix, csc_matrix, hstack, identity, vstack

from cortshift_tracking.model.elasticity import MATERIALS, gather, gradients, random_forces, smooth_noise, stiffness
from cortshift_tracking.model.prepare import ModelSettings, patches_of

AT_ONCE = 256   # right sides [columns of 3N], so that memory stays small
DRAWN = (0.125, 0.375, 0.625, 0.875)   # quantiles of tau that stand for all


class Condensed:
    """The model seen from what is kept of it, with tissue taken out.

    What is kept: the zone's unknowns, the patches of the skull, and patches of those nodes of the zone that turn out to be covered.
    """

    def __init__(self, model, forces, resected, settings, covered):
        """forces (3N, n): of the loads. covered: border nodes of the zone that the skull holds."""
        self.model, self.settings, self._left = model, settings, ~resected
        self.index = np.full(len(model.mesh.nodes), -1)
        self.index[model.zone] = np.arange(len(model.zone))
        self.columns = model.factor.solve(forces)
        self.samples = np.asarray(model.samples, float)
        self._zone = (3 * model.zone[:, None] + np.arange(3)).ravel()
        cover = patches_of(model.mesh, covered, ModelSettings.patch)[self._zone] if len(covered) else csc_matrix((len(self._zone), 0))
        count = len(model.compliance)
        self._join = vstack([identity(count), hstack([cover.T, csc_matrix((cover.shape[1], count - len(self._zone)))])]).tocsr()
        self.compliance = self._join @ (self._join @ model.compliance).T
        self.correction = None
        if resected.any():
            self._take_out(resected)

    def kept(self, columns):
        """Of full displacements: at the zone's unknowns and on the patches."""
        return self._join @ np.concatenate([columns[self._zone], self.model.patches.T @ columns])

    def _take_out(self, resected):
        """Woodbury: the stiffness without the resected tetrahedra, from the inverse of the one with them."""
        model = self.model
        nodes = np.unique(model.mesh.tetrahedra[resected])
        number = np.full(len(model.mesh.nodes), -1)
        number[nodes] = np.arange(len(nodes))
        gone = (1 - self.settings.left) * stiffness(model.mesh.nodes[nodes], number[model.mesh.tetrahedra[resected]], model.lame[resected]).toarray()
        dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
        known = self.index[nodes]
        if (known >= 0).all():
            rows = (3 * known[:, None] + np.arange(3)).ravel()
            kept_by_dofs, inner = self.compliance[:, rows], self.compliance[np.ix_(rows, rows)]
        else:
            kept_by_dofs, inner = np.empty((len(self.compliance), len(dofs))), np.empty((len(dofs),) * 2)
            for first in range(0, len(dofs), AT_ONCE):
                part = slice(first, first + AT_ONCE)
                unit = np.zeros((3 * len(model.mesh.nodes), len(dofs[part])))
                unit[dofs[part], np.arange(unit.shape[1])] = 1
                full = model.factor.solve(unit)
                kept_by_dofs[:, part], inner[:, part] = self.kept(full), full[dofs]
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


def rows_of(known, model, pulls, used):
    """(3B, kept): from what is kept to the displacement at each pull."""
    nodes = known.index[model.mesh.border[pulls.triangle[used]]]
    count = len(nodes)
    rows = np.broadcast_to((3 * np.arange(count)[:, None] + np.arange(3))[:, None], (count, 3, 3))
    columns = 3 * nodes[:, :, None] + np.arange(3)
    values = np.broadcast_to(pulls.weights[used][:, :, None], (count, 3, 3))
    return coo_matrix((values.ravel(), (rows.ravel(), columns.ravel())), (3 * count, len(known.compliance))).tocsr()


class System:
    """Springs, skull and loads: one linear system for those patches of the skull that press."""

    def __init__(self, known, pick, vectors, sd, loads):
        settings = known.settings
        self.known, self.pick, self.vectors, self.sd = known, pick, vectors, sd
        self._first = 3 * len(known.model.zone)
        patches = len(known.compliance) - self._first
        pulled = pick @ known.compliance
        self.pulled, self.at_skull = np.asarray(pick @ pulled.T), pulled[:, self._first:]
        self.skull = known.compliance[self._first:, self._first:].copy()
        self.skull[np.diag_indices(patches)] *= 1 + settings.contact
        columns = known.kept(known.columns)
        self.load_pulled, self.load_skull = pick @ columns, columns[self._first:]
        self.mean, self.limits = loads.mean, loads.limits
        self.precision = np.linalg.inv(loads.covariance)
        self.active = np.ones(patches, bool)
        self.fixed = np.full(len(loads.mean), np.nan)

    def _hold(self, gaps):
        """What the patches that press make of all else: force on them per pull, per load and for `gaps`; pulled, loads and vectors as they leave them.

        The skull's reaction to a load is mechanics. It says nothing of how large the load is, as a w that keeps still there would.
        """
        a, pulls, loads = self.active, len(self.vectors), len(self.mean)
        force = np.linalg.solve(self.skull[np.ix_(a, a)], np.concatenate([self.at_skull[:, a].T, self.load_skull[a], gaps[a]], 1))
        moved = self.at_skull[:, a] @ force
        return (np.split(force, [pulls, pulls + loads], 1),
                (self.pulled - moved[:, :pulls], self.load_pulled - moved[:, pulls:pulls + loads], moved[:, pulls + loads:]))

    def _solve(self, tau, vectors, gaps, mean):
        """Loads (n, k) and forces (kept, k) for vectors (3B, k), where the patches' zero is, and the loads before measuring; and how much
        the likelihood would gain by more of each load (n, k)."""
        a, free = self.active, np.isnan(self.fixed)
        (of_pull, of_load, at_gaps), (pulled, loads, by_gaps) = self._hold(gaps)
        fixed = np.where(free, 0, np.nan_to_num(self.fixed))
        precision = tau ** 2 * self.precision
        matrix = np.block([[pulled + np.diag((self.sd / tau) ** 2), loads[:, free]], [loads[:, free].T, -precision[np.ix_(free, free)]]])
        x = solve(matrix, np.concatenate([vectors - by_gaps - (loads @ fixed)[:, None],
                                          (precision[np.ix_(free, ~free)] @ fixed[~free])[:, None] - precision[free] @ mean]), assume_a='sym')
        pull, theta = x[:len(vectors)], np.where(free, 0, fixed)[:, None] * np.ones(x.shape[1])
        theta[free] = x[len(vectors):]
        force = np.asarray(self.pick.T @ pull)
        force[self._first:][a] += at_gaps - of_pull @ pull - of_load @ theta
        return theta, force, loads.T @ pull - precision @ (theta - mean)

    def solution(self, tau):
        """Loads and forces (kept,), with the patches that press and the loads at their limits found."""
        for _ in range(60):
            theta, force, gain = (part[:, 0] for part in self._solve(tau, self.vectors[:, None], np.zeros((len(self.active), 1)), self.mean[:, None]))
            gap = self.known.compliance[self._first:] @ force + self.load_skull @ theta
            pulling = self.active & (force[self._first:] > 0)      # the skull would have to pull
            inside = ~self.active & (gap > 0)                      # the brain would be in the skull
            outside = np.isnan(self.fixed) & ((theta < self.limits[:, 0]) | (theta > self.limits[:, 1]))
            held = ~np.isnan(self.fixed)
            wanted = held * np.where(theta <= self.limits[:, 0], gain, -gain)   # to leave a limit that holds it
            if outside.any():
                self.fixed = np.where(outside, np.clip(theta, *self.limits.T), self.fixed)
            elif pulling.any() or inside.any():
                self.active = (self.active & ~pulling) | inside
            elif held.any() and wanted.max() > 1e-6 * np.abs(gain).max():
                self.fixed[wanted.argmax()] = np.nan
            else:
                break
        return theta, force

    def _prior_of_free(self):
        """Of the loads before measuring, those at their limits given: mean (n,), and a root of the covariance (n, n)."""
        free = np.isnan(self.fixed)
        mean, root = np.where(free, 0.0, self.fixed), np.zeros_like(self.precision)
        if free.any():
            inverse = np.linalg.inv(self.precision[np.ix_(free, free)])
            mean[free] = self.mean[free] - inverse @ self.precision[np.ix_(free, ~free)] @ (mean - self.mean)[~free]
            root[np.ix_(free, free)] = np.linalg.cholesky(inverse)
        return mean, root

    def fit(self):
        """DRAWN quantiles of tau [sqrt(J)] by how likely the vectors are under it, each with the patches that press then; the same at depth.

        Errors of neighbours are alike, so that the vectors count as fewer than they are; and fewer still tell how large w is at depth, where
        it is alike over lobes.
        """
        scale = np.sqrt(np.trace(self.pulled) / len(self.vectors))
        settings, found = self.known.settings, []
        taus = np.geomspace(0.03, 0.0003, 17) / scale
        for tau in taus:
            self.fixed[:] = np.nan
            self.solution(tau)
            pulled, loads, _ = self._hold(np.zeros((len(self.active), 0)))[1]
            mean, prior = self._prior_of_free()
            covariance = tau ** 2 * pulled + np.diag(self.sd ** 2) + (loads @ prior) @ (loads @ prior).T
            factor = cho_factor(covariance, lower=True)
            miss = self.vectors - loads @ mean
            found.append(-0.5 * miss @ cho_solve(factor, miss) - np.log(np.diag(factor[0])).sum())
            if found[-1] < max(found) - 6 * (settings.alike / settings.bin) ** 2:   # smaller ones have less than e^-6 of its weight
                break
        def quantiles(alike):
            weight = np.exp((np.array(found) - max(found)) * (settings.bin / alike) ** 2)
            share = (np.cumsum(weight[::-1]) - weight[::-1] / 2) / weight.sum()
            return np.exp(np.interp(DRAWN, share, np.log(taus[:len(found)][::-1])))
        return quantiles(settings.neighbours), quantiles(settings.alike)

    def displacement(self, tau):
        """Loads, and displacement (3N,)."""
        self.fixed[:] = np.nan
        theta, forces = self.solution(tau)
        return theta, self.known.columns @ theta + self.known.everywhere(forces[:, None])[:, 0]

    def draws(self, tau, random, prior, common):
        """Differences (3N, S) of draws of the posterior from its mean, with the patches that press held; prior (3N, S): before measuring.

        common: see Pulls.
        """
        count = prior.shape[1]
        held, self.fixed = self.fixed, np.full_like(self.fixed, np.nan)   # one at its limit may as well be somewhat off it
        loads = self._prior_of_free()[1] @ random.standard_normal((len(self.mean), count))
        kept = self.known.kept(prior)
        errors = self.sd[:, None] * random.standard_normal((len(self.vectors), count))
        errors += common * np.tile(random.standard_normal((3, count)), (len(self.vectors) // 3, 1))   # no spring knows of it
        here = -(self.pick @ kept + self.load_pulled @ loads + errors)
        gaps = -(kept[self._first:] + self.load_skull @ loads)
        change, force, _ = self._solve(tau, here, gaps, np.zeros((len(self.mean), count)))
        self.fixed = held
        return prior + self.known.columns @ (loads + change) + self.known.everywhere(force)
