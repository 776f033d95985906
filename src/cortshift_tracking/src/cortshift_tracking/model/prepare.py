"""From the preoperative MR to the prepared brain model: mesh, materials, factor, and what the update needs of it."""
import time
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix, csc_matrix, diags, hstack
from scipy.spatial import cKDTree

from cortshift_tracking.model.brain import BrainModel, ModelError, identity_of
from cortshift_tracking.model.elasticity import MATERIALS, random_forces, stiffness, weights_of_nodes
from cortshift_tracking.model.factor import factorise
from cortshift_tracking.model.mesh import brain_mesh, distance_to
from cortshift_tracking.model.structures import by_precedence
from cortshift_tracking.mr.volume import AXES_FROM_RAS


@dataclass(frozen=True)
class ModelSettings:
    """How a model is prepared. Lengths [m]."""
    elements: int = 80000
    opening: float = 0.035        # radius of the craniotomy where no surface says it
    reach: float = 0.02           # of the middle of the craniotomy from the border of the brain
    margin: float = 0.008         # around the surface that may be exposed
    patch: float = 0.011          # spacing of the patches by which the skull holds the brain
    stem: float = 0.012           # height of the lowest part, the brain stem, that stays where it is
    stem_spring: float = 3e9      # that holds it [N/m of each m^3 of its tissue]: it moves a tenth of a millimetre at most
    rest: float = 1e5             # of springs at the skull, where vessels and arachnoid tether a brain [N/m of each m^2]: as 3 cm of its tissue
    samples: int = 40
    coarsest: float = 0.012       # what the model does not know is drawn no finer than this: the distance over which a lobe's tissue is alike
    least_part: float = 0.02      # of a mask's voxels: a second part this large is no speck
    seed: int = 1


def check_mask(mask):
    """Raises ModelError where the mask is of more than one piece."""
    labels, count = ndimage.label(mask.data > 0.5)
    if not count:
        raise ModelError(f'{mask.source}: the brain mask is empty; give the mask of this MR')
    sizes = np.sort(np.bincount(labels.ravel())[1:])[::-1]
    large = sizes[sizes > ModelSettings.least_part * sizes.sum()]
    if len(large) > 1:
        raise ModelError(f'{mask.source}: the brain mask has {len(large)} parts (of {large[0]} and {large[1]} voxels); a brain is one: '
                         'correct the mask')


def tissues_of(middles, labels):
    """Index of the tissue of each tetrahedron, and the names; 0 is brain. labels: name to Volume, > 0.5 inside; see by_precedence."""
    tissue, names = np.zeros(len(middles), np.uint8), ('brain', *labels)
    held = {name: np.nan_to_num(labels[name].sample(middles)) > 0.5 for name in by_precedence(labels)}
    for name, inside in held.items():
        if not inside.any():
            raise ModelError(f'label "{name}" ({labels[name].source}) holds no part of the brain; give the labels of this MR')
        tissue[inside] = names.index(name)
    for name, inside in held.items():
        if name in (*MATERIALS, 'oedema') and not (tissue == names.index(name)).any():   # others are only followed
            above = names[np.bincount(tissue[inside]).argmax()]
            raise ModelError(f'label "{name}" ({labels[name].source}) lies whole below label "{above}" ({labels[above].source}), which counts '
                             f'where both are; take "{name}" out of "{above}", or leave one of them out')
    return tissue, names


def material_of(name):
    """Of a label whose name is none of MATERIALS: that of the brain, for it is only to be followed."""
    return MATERIALS.get(name, MATERIALS['brain'])


def patches_of(mesh, held, spacing):
    """(3N, P): shares of the outward normal displacement over patches of the border nodes `held`."""
    normal = mesh.node_normals()
    area = np.linalg.norm(normal, axis=1)
    places = mesh.nodes[held]
    # Every cell of a coarse grid is a patch.
    cell = np.unique(np.floor(places / spacing).astype(int), axis=0, return_inverse=True)[1]
    total = np.bincount(cell, area[held])
    share = normal[held] / np.maximum(total[cell], 1e-30)[:, None]
    rows = (3 * held[:, None] + np.arange(3)).ravel()
    return coo_matrix((share.ravel(), (rows, np.repeat(cell, 3))), (3 * len(mesh.nodes), cell.max() + 1)).tocsc()


def prepare_model(volume, mask, craniotomy, exposed=None, labels=None, settings=ModelSettings(), progress=lambda share, what: None,
                  provenance=None):
    """BrainModel of an MR (Volume) whose brain is > 0.5 in `mask` (Volume).

    craniotomy: its middle in pmr [m]. exposed: points (N, 3) of the first surface, or None. labels: name to Volume: tumour, ventricles,
    falx ... progress(share, what) is told how far it is. Raises ModelError, VolumeError.
    """
    began = time.monotonic()
    check_mask(mask)
    progress(0.0, 'distance to the border')
    distance = distance_to(mask)
    craniotomy = np.asarray(craniotomy, float)
    away = abs(float(distance.at(craniotomy[None])[0]))
    if away > settings.reach:
        raise ModelError(f'the craniotomy lies {away * 1000:.0f} mm from the border of the brain; check the '
                         'patient registration and the mask')
    progress(0.1, 'mesh')
    mesh = brain_mesh(distance, craniotomy, settings.elements)
    tissue, names = tissues_of(mesh.nodes[mesh.tetrahedra].mean(1), labels or {})
    lame = np.array([material_of(name).lame for name in names])[tissue]
    progress(0.25, 'stiffness')
    border = np.unique(mesh.border)
    down = AXES_FROM_RAS[volume.axes][:3, :3] @ [0, 0, -1.0]
    height = mesh.nodes @ down
    matrix = stiffness(mesh.nodes, mesh.tetrahedra, lame)
    weight = weights_of_nodes(mesh.nodes, mesh.tetrahedra)
    zone, skull = _zone(mesh, border, craniotomy, exposed, tissue, names, settings)
    held = settings.stem_spring * weight * (height > height.max() - settings.stem)
    held[skull] += settings.rest * np.linalg.norm(mesh.node_normals()[skull], axis=1)
    matrix = (matrix + diags(np.repeat(held, 3))).tocsr()
    progress(0.3, 'factor')
    factor = factorise(matrix, mesh.nodes)
    patches = patches_of(mesh, skull, settings.patch)
    units = coo_matrix((np.ones(3 * len(zone)), ((3 * zone[:, None] + np.arange(3)).ravel(), np.arange(3 * len(zone)))),
                       (3 * len(mesh.nodes), 3 * len(zone))).tocsc()
    kept = hstack([units, patches]).tocsc()
    compliance = np.empty((kept.shape[1],) * 2)
    for first in range(0, kept.shape[1], 128):
        progress(0.5 + 0.4 * first / kept.shape[1], 'compliance')
        compliance[:, first:first + 128] = kept.T @ factor.solve(kept[:, first:first + 128].toarray())
    compliance = (compliance + compliance.T) / 2
    progress(0.9, 'samples')
    random = np.random.default_rng(settings.seed)
    noise = random_forces(mesh.nodes, mesh.tetrahedra, lame, settings.samples, random, settings.coarsest)
    noise += np.sqrt(np.repeat(held, 3))[:, None] * random.standard_normal(noise.shape)
    samples = factor.solve(noise)
    about = {'mr': identity_of(volume), 'mr_source': volume.source, 'axes': volume.axes, 'elements': len(tissue),
             'nodes': len(mesh.nodes), 'seconds': time.monotonic() - began, **(provenance or {})}
    progress(1.0, 'done')
    return BrainModel(mesh, tissue, names, lame, zone, csc_matrix(patches), compliance, samples, factor, craniotomy, about, dict(labels or {}))


def _zone(mesh, border, craniotomy, exposed, tissue, names, settings):
    """Nodes that are kept, and border nodes that the skull holds."""
    if exposed is None:
        open_ = np.linalg.norm(mesh.nodes[border] - craniotomy, axis=1) < settings.opening
    else:
        open_ = cKDTree(exposed).query(mesh.nodes[border])[0] < settings.margin
    if open_.sum() < 10:
        if exposed is not None:
            raise ModelError('the first surface lies nowhere on the border of the brain; check the patient registration and the mask')
        raise ModelError(f'the border of the brain has only {open_.sum()} nodes within {settings.opening * 1000:g} mm of the craniotomy; check '
                         'where it is said to be and the mask, or prepare more elements')
    tumour = np.unique(mesh.tetrahedra[tissue == names.index('tumour')]) if 'tumour' in names else np.zeros(0, int)
    return np.union1d(border[open_], tumour), border[~open_]
