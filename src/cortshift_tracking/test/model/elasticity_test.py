"""The linear model against what is known in closed form: a patch, a column under its weight, and its own factor."""
import numpy as np
import pytest
from cortshift_tracking.model.elasticity import (DENSITY, GRAVITY, MATERIALS, Material, random_forces, stiffness, swelling,
                                                 weights_of_nodes)
from cortshift_tracking.model.factor import Factor, factorise
from cortshift_tracking.model.mesh import _lattice, border_of, volumes
from scipy.sparse import diags
from scipy.sparse.linalg import spsolve

BRAIN = MATERIALS['brain']


def block(size, spacing):
    """Nodes and tetrahedra of a lattice over a box of `size` [m]."""
    nodes, tetrahedra = _lattice(np.zeros(3), np.asarray(size, float), spacing)
    used = np.unique(tetrahedra)
    number = np.full(len(nodes), -1)
    number[used] = np.arange(len(used))
    return nodes[used], number[tetrahedra]


def flat_box(count=(6, 6, 24), size=(0.02, 0.02, 0.06)):
    """A box with flat faces, each cube of six tetrahedra."""
    axes = [np.linspace(0, s, n + 1) for s, n in zip(size, count)]
    nodes = np.stack(np.meshgrid(*axes, indexing='ij'), -1).reshape(-1, 3)
    number = np.arange(len(nodes)).reshape(np.array(count) + 1)
    corner = {(i, j, k): number[i:count[0] + i, j:count[1] + j, k:count[2] + k].ravel()
              for i in (0, 1) for j in (0, 1) for k in (0, 1)}
    tetrahedra = []
    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        at, path = [0, 0, 0], [corner[0, 0, 0]]
        for axis in order:
            at[axis] = 1
            path.append(corner[tuple(at)])
        tetrahedra.append(np.stack(path, -1))
    tetrahedra = np.concatenate(tetrahedra)
    flipped = volumes(nodes, tetrahedra) < 0
    tetrahedra[flipped] = tetrahedra[flipped][:, [1, 0, 2, 3]]
    return nodes, tetrahedra


def lame_of(material, tetrahedra):
    return np.tile(material.lame, (len(tetrahedra), 1))


def with_fixed(matrix, right, fixed, values):
    """Solution where the unknowns `fixed` have `values`."""
    free = np.setdiff1d(np.arange(matrix.shape[0]), fixed)
    result = np.zeros(matrix.shape[0])
    result[fixed] = values
    matrix = matrix.tocsr()
    result[free] = spsolve(matrix[free][:, free].tocsc(), right[free] - matrix[free][:, fixed] @ values)
    return result


def test_a_patch_that_is_strained_evenly_stays_so():
    nodes, tetrahedra = block((0.03, 0.03, 0.03), 0.01)
    random = np.random.default_rng(3)
    inner = np.setdiff1d(np.arange(len(nodes)), border_of(tetrahedra))
    nodes[inner] += random.uniform(-0.001, 0.001, (len(inner), 3))   # no two tetrahedra alike
    wanted = (nodes @ random.uniform(-0.05, 0.05, (3, 3)).T + [0.001, -0.002, 0.003])
    border = np.unique(border_of(tetrahedra))
    fixed = (3 * border[:, None] + np.arange(3)).ravel()
    matrix = stiffness(nodes, tetrahedra, lame_of(BRAIN, tetrahedra))
    found = with_fixed(matrix, np.zeros(matrix.shape[0]), fixed, wanted[border].ravel()).reshape(-1, 3)
    assert len(inner) > 10
    assert np.abs(found - wanted).max() < 1e-10


def test_a_column_under_its_weight_is_the_formula():
    """Between walls that it slides along: u = -rho g (H z - z^2 / 2) / M, M the modulus of confined compression."""
    nodes, tetrahedra = flat_box()
    height = nodes[:, 2].max()
    matrix = stiffness(nodes, tetrahedra, lame_of(BRAIN, tetrahedra))
    force = np.zeros((len(nodes), 3))
    force[:, 2] = -DENSITY * GRAVITY * weights_of_nodes(nodes, tetrahedra)
    fixed = [3 * np.flatnonzero(np.isclose(nodes[:, n], nodes[:, n].min()) | (np.isclose(nodes[:, n], nodes[:, n].max()) & (n < 2))) + n
             for n in range(3)]
    fixed = np.concatenate(fixed)
    found = with_fixed(matrix, force.ravel(), fixed, np.zeros(len(fixed))).reshape(-1, 3)[:, 2]
    first, second = BRAIN.lame
    wanted = -DENSITY * GRAVITY * (height * nodes[:, 2] - nodes[:, 2] ** 2 / 2) / (first + 2 * second)
    assert np.abs(found - wanted).max() < 0.01 * np.abs(wanted).max()


def test_a_free_body_swells_by_a_third_of_the_volume_strain():
    nodes, tetrahedra = flat_box()
    lame = lame_of(BRAIN, tetrahedra)
    matrix = stiffness(nodes, tetrahedra, lame)
    held = [3 * 0, 3 * 0 + 1, 3 * 0 + 2]
    on_axes = [int(np.flatnonzero((np.abs(nodes - np.array(place)) < 1e-9).all(1))[0]) for place in ((0.02, 0, 0), (0, 0.02, 0))]
    fixed = np.array(held + [3 * on_axes[0] + 1, 3 * on_axes[0] + 2, 3 * on_axes[1] + 2])
    found = with_fixed(matrix, swelling(nodes, tetrahedra, lame, 0.03 * np.ones(len(tetrahedra))), fixed, np.zeros(6)).reshape(-1, 3)
    assert np.allclose(found, 0.01 * nodes, atol=1e-8)


def test_random_forces_have_the_covariance_of_the_stiffness():
    nodes, tetrahedra = block((0.01, 0.01, 0.01), 0.01)
    lame = lame_of(Material(2000.0, 0.4), tetrahedra)
    matrix = stiffness(nodes, tetrahedra, lame).toarray()
    forces = random_forces(nodes, tetrahedra, lame, 20000, np.random.default_rng(0))
    assert np.linalg.norm(forces @ forces.T / 20000 - matrix) < 0.05 * np.linalg.norm(matrix)


def test_the_factor_solves_and_survives_a_file():
    nodes, tetrahedra = block((0.06, 0.05, 0.04), 0.006)
    matrix = stiffness(nodes, tetrahedra, lame_of(BRAIN, tetrahedra)) + diags(np.full(3 * len(nodes), 0.5))
    right = np.random.default_rng(1).standard_normal((3 * len(nodes), 5))
    factor = factorise(matrix, nodes)
    wanted = spsolve(matrix.tocsc(), right)
    assert np.allclose(factor.solve(right), wanted, rtol=1e-8, atol=1e-10)
    assert np.allclose(Factor.from_arrays(factor.arrays()).solve(right[:, 0]), wanted[:, 0], rtol=1e-8, atol=1e-10)


def test_a_matrix_that_is_not_positive_is_told():
    nodes, tetrahedra = block((0.02, 0.02, 0.02), 0.01)
    with pytest.raises(np.linalg.LinAlgError):
        factorise(stiffness(nodes, tetrahedra, lame_of(BRAIN, tetrahedra)) - diags(np.full(3 * len(nodes), 1.0)), nodes)
