"""Linear elasticity on linear tetrahedra; the stiffness is GetFEM's."""
from dataclasses import dataclass

import getfem
import numpy as np
from scipy.ndimage import map_coordinates
from scipy.sparse import coo_matrix, csc_matrix
from scipy.spatial import cKDTree

from cortshift_tracking.model.mesh import volumes


@dataclass(frozen=True)
class Material:
    """Young's modulus [Pa] and Poisson's ratio of an isotropic tissue."""
    young: float
    poisson: float

    @property
    def lame(self):
        """First and second Lame parameters [Pa]."""
        return (self.young * self.poisson / ((1 + self.poisson) * (1 - 2 * self.poisson)), self.young / (2 * (1 + self.poisson)))


#: Small strains. Sources: parenchyma, tumour and ventricles as Wittek et al. 2007 (J Biomech 40:919), where ventricles are very soft and
#: compressible and a tumour is three times as stiff; falx and tentorium of the order of Ferrant et al. 2002 (Med Image Anal 6:337).
MATERIALS = {'brain': Material(3000.0, 0.45), 'tumour': Material(9000.0, 0.45), 'ventricles': Material(10.0, 0.1),
             'falx': Material(200000.0, 0.45), 'tentorium': Material(200000.0, 0.45)}
DENSITY = 1000.0       # of the tissue, as of the fluid that bears it [kg/m^3]; what drains no longer bears
GRAVITY = 9.81         # [m/s^2]


def stiffness(nodes, tetrahedra, lame):
    """Stiffness (3N, 3N) [N/m], unknowns x y z of node 0, 1, ...; lame: (T, 2) [Pa]."""
    mesh = getfem.Mesh('empty', 3)
    mesh.add_point(nodes.T)
    mesh.add_convex(getfem.GeoTrans('GT_PK(3,1)'), nodes[tetrahedra].transpose(2, 1, 0))
    displacement, constant = getfem.MeshFem(mesh, 3), getfem.MeshFem(mesh, 1)
    displacement.set_fem(getfem.Fem('FEM_PK(3,1)'))
    constant.set_fem(getfem.Fem('FEM_PK(3,0)'))
    first, second = (np.empty(constant.nbdof()) for _ in range(2))
    # GetFEM numbers elements and unknowns its own way: both are found again by their places.
    middle = constant.basic_dof_nodes().T
    element = cKDTree(nodes[tetrahedra].mean(1)).query(middle)[1]
    first[:], second[:] = lame[element].T
    matrix = getfem.asm_linear_elasticity(getfem.MeshIm(mesh, getfem.Integ('IM_TETRAHEDRON(2)')), displacement, constant, first, second)
    matrix.to_csc()
    index = matrix.csc_ind()
    matrix = csc_matrix((matrix.csc_val(), index[1], index[0])).tocoo()
    node = cKDTree(nodes).query(displacement.basic_dof_nodes().T[::3])[1]
    return coo_matrix((matrix.data, (3 * node[matrix.row // 3] + matrix.row % 3, 3 * node[matrix.col // 3] + matrix.col % 3)),
                      matrix.shape).tocsr()


def gradients(nodes, tetrahedra):
    """Of the four shape functions in each tetrahedron, (T, 4, 3) [1/m]."""
    corners = nodes[tetrahedra]
    inverse = np.linalg.inv(corners[:, 1:] - corners[:, :1])
    return np.concatenate([-inverse.sum(2)[:, None], inverse.transpose(0, 2, 1)], 1)


def weights_of_nodes(nodes, tetrahedra, share=1.0):
    """Volume [m^3] that belongs to each node; share: of each tetrahedron that counts."""
    volume = np.broadcast_to(volumes(nodes, tetrahedra) * share / 4, (4, len(tetrahedra))).T
    return np.bincount(tetrahedra.ravel(), volume.ravel(), len(nodes))


def swelling(nodes, tetrahedra, lame, share):
    """Nodal forces (3N,) [N] of a volume strain of 1 in the given share of each tetrahedron."""
    pressure = (lame[:, 0] + 2 / 3 * lame[:, 1]) * share * volumes(nodes, tetrahedra)
    return gather(nodes, tetrahedra, gradients(nodes, tetrahedra) * pressure[:, None, None])


def smooth_noise(places, length, count, random):
    """Draws (N, count) at places (N, 3) that are alike over `length`; their variance at one place, averaged over places, is 1."""
    index = ((places - places.min(0)) / length + random.uniform(0, 1, 3)).T
    coarse = random.standard_normal((count, *np.ceil(index.max(1) + 2).astype(int)))
    return np.stack([map_coordinates(grid, index, order=1) for grid in coarse], -1) * 1.5 ** 1.5


def random_forces(nodes, tetrahedra, lame, count, random, length=None):
    """Nodal forces (3N, count) whose covariance is the stiffness: K^-1 times them has the covariance K^-1.

    length [m]: what is finer is left out. With nothing left out the variance of a point is that of the tetrahedra's size, not the brain's.
    """
    slopes, volume = gradients(nodes, tetrahedra), volumes(nodes, tetrahedra)
    middles = nodes[tetrahedra].mean(1)

    def draw(shape):
        if length is None:
            return random.standard_normal((len(volume), *shape)) / np.sqrt(volume).reshape(-1, *[1] * len(shape))
        index = (middles - middles.min(0)) / length + 1
        coarse = random.standard_normal((*shape, *np.ceil(index.max(0) + 2).astype(int))) / length ** 1.5
        flat = np.stack([map_coordinates(grid, index.T, order=1) for grid in coarse.reshape(-1, *coarse.shape[-3:])], -1)
        return flat.reshape(len(volume), *shape)
    forces = np.empty((3 * len(nodes), count))
    for n in range(count):
        noise, pressure = draw((3, 3)), draw(())
        stress = np.sqrt(lame[:, 1] / 2)[:, None, None] * (noise + noise.transpose(0, 2, 1))
        stress += (np.sqrt(lame[:, 0]) * pressure)[:, None, None] * np.eye(3)
        forces[:, n] = gather(nodes, tetrahedra, np.einsum('tij,taj->tai', stress * volume[:, None, None], slopes))
    return forces


def gather(nodes, tetrahedra, parts):
    """Sum of (T, 4, 3) at the nodes, (3N,)."""
    return np.stack([np.bincount(tetrahedra.ravel(), parts[..., n].ravel(), len(nodes)) for n in range(3)], -1).ravel()
