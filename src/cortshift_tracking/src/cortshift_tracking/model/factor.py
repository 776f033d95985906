"""A Cholesky factor that is kept: multifrontal, nodes ordered by nested dissection of their places.

GetFEM's MUMPS keeps no factor between solutions and SciPy's SuperLU is slow in three dimensions (doc/brain_model.md); Debian has no Python
binding of CHOLMOD. The work is dense, so it is LAPACK's.
"""
import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.sparse import csr_matrix

LEAF = 80   # nodes that are not divided any further


class Factor:
    """L L^T = K of a symmetric positive definite matrix with `width` unknowns for each node; see `factorise`."""

    def __init__(self, fronts):
        self._fronts = fronts

    def solve(self, right):
        """K^-1 right, (n,) or (n, k)."""
        x = np.array(right, float, ndmin=2).T.copy() if np.ndim(right) == 1 else np.array(right, float)
        for own, rest, low, below in self._fronts:
            x[own] = solve_triangular(low, x[own], lower=True, check_finite=False)
            if len(rest):
                x[rest] -= below @ x[own]
        for own, rest, low, below in reversed(self._fronts):
            if len(rest):
                x[own] -= below.T @ x[rest]
            x[own] = solve_triangular(low, x[own], lower=True, trans='T', check_finite=False)
        return x[:, 0] if np.ndim(right) == 1 else x

    def arrays(self):
        """As few arrays, for a file."""
        own, rest = zip(*((front[0], front[1]) for front in self._fronts))
        return {'factor_sizes': np.array([[len(a), len(b)] for a, b in zip(own, rest)]),
                'factor_indices': np.concatenate([np.concatenate(pair) for pair in zip(own, rest)]).astype(np.int32),
                'factor_values': np.concatenate([np.concatenate([low[np.tril_indices(len(low))], below.ravel()])
                                                 for _, _, low, below in self._fronts])}

    @staticmethod
    def from_arrays(arrays):
        fronts, index, value = [], 0, 0
        indices, values = arrays['factor_indices'], arrays['factor_values']
        for own, rest in arrays['factor_sizes']:
            low = np.zeros((own, own))
            count = own * (own + 1) // 2
            low[np.tril_indices(own)] = values[value:value + count]
            below = values[value + count:value + count + own * rest].reshape(rest, own)
            fronts.append((indices[index:index + own], indices[index + own:index + own + rest], low, below))
            index, value = index + own + rest, value + count + own * rest
        return Factor(fronts)


def _dissected(places, neighbours):
    """Nodes in the order of elimination: groups, each with the numbers of the groups below it."""
    groups = []

    def divide(nodes):
        if len(nodes) <= LEAF:
            groups.append((nodes, []))
            return len(groups) - 1
        axis = np.ptp(places[nodes], axis=0).argmax()
        order = nodes[np.argsort(places[nodes, axis], kind='stable')]
        left, right = order[:len(order) // 2], order[len(order) // 2:]
        touching = neighbours[left][:, right].getnnz(1) > 0
        below = [divide(part) for part in (left[~touching], right) if len(part)]
        groups.append((left[touching], below))
        return len(groups) - 1
    divide(np.arange(len(places)))
    return groups


def factorise(matrix, places, width=3):
    """Factor of `matrix`, whose rows width*n ... belong to node n at places[n]. Raises LinAlgError where it is not positive definite."""
    matrix = matrix.tocsr()
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr)) // width
    graph = csr_matrix((np.ones(len(rows), np.int8), (rows, matrix.indices // width)), shape=(len(places),) * 2)
    position = np.zeros(matrix.shape[0], np.int64)   # of an unknown within the front at hand
    done = np.zeros(len(places), bool)
    fronts, waiting = [], {}
    for number, (nodes, below) in enumerate(_dissected(places, graph)):
        near = [waiting[child][0] for child in below] + [np.unique(graph[nodes].indices)]
        done[nodes] = True
        rest = np.unique(np.concatenate(near))
        rest = rest[~done[rest]]
        own_dofs, rest_dofs = ((width * part[:, None] + np.arange(width)).ravel() for part in (nodes, rest))
        dofs = np.concatenate([own_dofs, rest_dofs])
        position[dofs] = np.arange(len(dofs))
        front = np.zeros((len(dofs), len(dofs)))
        part = matrix[own_dofs].tocoo()
        alive = ~done[part.col // width] | np.isin(part.col // width, nodes)
        front[part.row[alive], position[part.col[alive]]] = part.data[alive]
        front[position[part.col[alive]], part.row[alive]] = part.data[alive]
        for child in below:
            left_nodes, complement = waiting.pop(child)
            at = position[(width * left_nodes[:, None] + np.arange(width)).ravel()]
            front[np.ix_(at, at)] += complement
        count = len(own_dofs)
        low = cholesky(front[:count, :count], lower=True, check_finite=False)
        lower = solve_triangular(low, front[count:, :count].T, lower=True, check_finite=False).T
        waiting[number] = rest, front[count:, count:] - lower @ lower.T
        fronts.append((own_dofs, rest_dofs, low, np.ascontiguousarray(lower)))
    return Factor(fronts)
