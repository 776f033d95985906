"""The prepared model of one brain: what is computed before surgery, in one file."""
import hashlib
import json
import zipfile
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.sparse import csc_matrix
from scipy.spatial import cKDTree

from cortshift_tracking.durable import replacing
from cortshift_tracking.errors import CortshiftError
from cortshift_tracking.model.factor import Factor
from cortshift_tracking.model.mesh import Mesh
from cortshift_tracking.mr.volume import Volume

FORMAT = 2   # of the file
CANDIDATES = 24   # tetrahedra around a point that are asked whether they hold it


class ModelError(CortshiftError):
    """A brain model that cannot be made, is not one, or does not belong to what it is asked about."""


@dataclass(frozen=True)
class BrainModel:
    """mesh; tissue (T,): index into tissues; lame (T, 2) [Pa].

    zone (Z,): nodes whose three unknowns are kept each: the border at the craniotomy, and the tumour. patches: sparse matrix of
    the border that the skull holds: shares of the outward normal displacement, (3N, P). compliance (3Z + P, 3Z + P) [m/N]: of them all.
    samples (3N, S): draws of a displacement whose covariance is the inverse stiffness [m / sqrt(J)].
    craniotomy (3,): its middle. provenance: JSON. labels: name to Volume of 0 and 1, as they were given.
    """
    mesh: Mesh
    tissue: np.ndarray
    tissues: tuple
    lame: np.ndarray
    zone: np.ndarray
    patches: object
    compliance: np.ndarray
    samples: np.ndarray
    factor: Factor
    craniotomy: np.ndarray
    provenance: dict
    labels: dict = field(default_factory=dict)

    @cached_property
    def _finder(self):
        corners = self.mesh.nodes[self.mesh.tetrahedra]
        return cKDTree(corners.mean(1)), np.linalg.inv(corners[:, 1:] - corners[:, :1]), corners[:, 0]

    def places(self, points):
        """Tetrahedron of each point (N,), -1 outside, and its barycentric weights (N, 4)."""
        tree, inverse, first = self._finder
        best, weights = np.full(len(points), -1), np.zeros((len(points), 4))
        left = np.arange(len(points))
        for count in (4, CANDIDATES):   # most points are in one of the nearest few
            if not len(left):
                break
            near = tree.query(points[left], k=count)[1]
            local = np.einsum('ncj,ncjk->nck', points[left, None] - first[near], inverse[near])
            all_weights = np.concatenate([1 - local.sum(-1, keepdims=True), local], -1)
            inside = all_weights.min(-1)
            at = inside.argmax(1)
            rows = np.arange(len(left))
            held = inside[rows, at] > -1e-9
            best[left[held]] = near[rows, at][held]
            weights[left[held]] = all_weights[rows, at][held]
            left = left[~held]
        return best, weights


def identity_of(volume):
    """SHA-256 of an MR's voxels and their places: which MR a model is of."""
    digest = hashlib.sha256(np.ascontiguousarray(volume.data).tobytes())
    digest.update(np.round(volume.T_pmr_voxel * 1e6).astype(np.int64).tobytes())
    return digest.hexdigest()


def save_model(model, path):
    """Write the model durably as one file (NumPy's npz)."""
    patches = model.patches.tocoo()
    arrays = {'nodes': model.mesh.nodes, 'tetrahedra': model.mesh.tetrahedra.astype(np.int32), 'border': model.mesh.border.astype(np.int32),
              'tissue': model.tissue, 'lame': model.lame, 'zone': model.zone, 'patch_row': patches.row, 'patch_column': patches.col,
              'patch_value': patches.data, 'patch_shape': np.array(patches.shape), 'compliance': model.compliance,
              'samples': model.samples.astype(np.float32), 'craniotomy': model.craniotomy, **model.factor.arrays()}
    for name, label in model.labels.items():
        arrays[f'label_{name}'] = np.packbits(label.data > 0.5)
        arrays[f'affine_{name}'] = label.T_pmr_voxel
    shapes = {name: [label.data.shape, label.axes, label.source] for name, label in model.labels.items()}
    text = {'format': FORMAT, 'tissues': model.tissues, 'labels': shapes, **model.provenance}
    with replacing(path) as temporary, open(temporary, 'wb') as file:
        np.savez(file, about=np.frombuffer(json.dumps(text).encode(), np.uint8), **arrays)


def load_model(path):
    """Read a file of save_model. Raises ModelError."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        about = json.loads(arrays['about'].tobytes().decode())
        if about.pop('format') != FORMAT:
            raise ModelError(f'{path}: was made by another version of prepare_model; prepare it again')
        tissues = tuple(about.pop('tissues'))
        labels = {name: Volume(np.unpackbits(arrays[f'label_{name}'])[:np.prod(shape)].reshape(shape).astype(np.float32),
                               arrays[f'affine_{name}'], axes, source) for name, (shape, axes, source) in about.pop('labels').items()}
        patches = csc_matrix((arrays['patch_value'], (arrays['patch_row'], arrays['patch_column'])), tuple(arrays['patch_shape']))
        return BrainModel(Mesh(arrays['nodes'], arrays['tetrahedra'], arrays['border']), arrays['tissue'], tissues, arrays['lame'],
                          arrays['zone'], patches, arrays['compliance'], arrays['samples'],
                          Factor.from_arrays(arrays), arrays['craniotomy'], about, labels)
    except FileNotFoundError as error:
        raise ModelError(f'{path}: no such file; make it with prepare_model') from error
    except (KeyError, ValueError, EOFError, OSError, zipfile.BadZipFile) as error:
        raise ModelError(f'{path}: is no brain model, or is damaged ({error}); make it with prepare_model') from error
