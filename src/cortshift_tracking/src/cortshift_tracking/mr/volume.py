"""A scalar MR volume in pmr."""
from dataclasses import dataclass, field
from typing import Optional, Tuple

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from cortshift_tracking.errors import VolumeError

#: From RAS to the named axes of pmr; all are right-handed, so that no flip can hide.
AXES_FROM_RAS = {'RAS': np.diag([1.0, 1.0, 1.0, 1.0]), 'LPS': np.diag([-1.0, -1.0, 1.0, 1.0])}
SMALLEST_VOXEL, LARGEST_VOXEL = 0.00005, 0.02  # [m]


@dataclass(frozen=True)
class Volume:
    """Intensities on a voxel grid. If it is constructed, its geometry is valid.

    data          (I, J, K) float32, intensity in arbitrary units, in the order of the file
    T_pmr_voxel   (4, 4): voxel index (i, j, k) of a voxel's centre to pmr [m]; may be oblique and left-handed
    axes          'RAS' or 'LPS': what the axes of pmr point to
    source        file or folder it came from
    notes         what had to be assumed while loading, for people
    warnings      those of the notes that a person should know before believing what comes of it
    unknown       (I, J, K) bool: voxels that were not numbers in the file; None: there are none
    """
    data: np.ndarray
    T_pmr_voxel: np.ndarray
    axes: str = 'RAS'
    source: str = ''
    notes: Tuple[str, ...] = ()
    unknown: Optional[np.ndarray] = None
    warnings: Tuple[str, ...] = ()
    _spline: dict = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self):
        where = self.source or 'volume'
        if self.axes not in AXES_FROM_RAS:
            raise VolumeError(f'{where}: axes "{self.axes}" are not known; use RAS or LPS')
        if self.data.ndim != 3 or min(self.data.shape) < 1:
            raise VolumeError(f'{where}: shape {self.data.shape} is not a 3D volume; export one 3D volume')
        affine = np.asarray(self.T_pmr_voxel, float)
        if affine.shape != (4, 4) or not np.isfinite(affine).all():
            raise VolumeError(f'{where}: the voxel-to-space matrix holds NaN or infinity; export the volume again')
        spacing = np.linalg.norm(affine[:3, :3], axis=0)
        if not ((spacing >= SMALLEST_VOXEL) & (spacing <= LARGEST_VOXEL)).all():
            raise VolumeError(f'{where}: voxel spacing {spacing * 1000} mm is outside {SMALLEST_VOXEL * 1000:g} ... '
                              f'{LARGEST_VOXEL * 1000:g} mm; check the unit in the header')
        if abs(np.linalg.det(affine[:3, :3] / spacing)) < 0.05:
            raise VolumeError(f'{where}: the voxel axes are (nearly) in one plane; export the volume again')

    @property
    def spacing(self):
        """Distance of neighbouring voxels along i, j, k [m]."""
        return np.linalg.norm(self.T_pmr_voxel[:3, :3], axis=0)

    @property
    def orientation(self):
        """Three letters: what i, j and k run towards, as 'LAS'. Needs no convention of the viewer."""
        directions = (np.linalg.inv(AXES_FROM_RAS[self.axes]) @ self.T_pmr_voxel)[:3, :3]
        # The assignment of voxel axes to body axes that fits best as a whole: oblique volumes must not name one twice.
        best = max(((a, b, c) for a in range(3) for b in range(3) for c in range(3) if len({a, b, c}) == 3),
                   key=lambda p: sum(abs(directions[p[n], n]) / self.spacing[n] for n in range(3)))
        return ''.join('LPI RAS'[(0 if directions[axis, n] < 0 else 4) + axis] for n, axis in enumerate(best))

    def to_pmr(self, voxels):
        """Voxel indices (..., 3) to points in pmr [m]."""
        return np.asarray(voxels, float) @ self.T_pmr_voxel[:3, :3].T + self.T_pmr_voxel[:3, 3]

    def to_voxel(self, points_pmr):
        """Points in pmr (..., 3) [m] to voxel indices, fractional."""
        inverse = np.linalg.inv(self.T_pmr_voxel)
        return np.asarray(points_pmr, float) @ inverse[:3, :3].T + inverse[:3, 3]

    def corners_pmr(self):
        """Smallest and largest coordinate of all voxel centres in pmr, (2, 3) [m]."""
        last = np.subtract(self.data.shape, 1)
        corners = self.to_pmr([[i, j, k] for i in (0, last[0]) for j in (0, last[1]) for k in (0, last[2])])
        return np.stack([corners.min(0), corners.max(0)])

    def crop(self, low_pmr, high_pmr):
        """The smallest part of the volume that holds a box of pmr, corners (3,) [m]; a Volume, empty parts refused."""
        box = np.stack([low_pmr, high_pmr])
        corners = self.to_voxel([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
        first = np.clip(np.floor(corners.min(0)).astype(int), 0, self.data.shape)
        last = np.clip(np.ceil(corners.max(0)).astype(int) + 1, 0, self.data.shape)
        if (last <= first).any():
            raise VolumeError(f'{self.source}: holds nothing of the asked part of pmr; check the patient registration and the axes '
                              f'of pmr ({self.axes})')
        T = self.T_pmr_voxel.copy()
        T[:3, 3] = self.to_pmr(first)
        part = tuple(slice(a, b) for a, b in zip(first, last))
        return Volume(self.data[part], T, self.axes, self.source, self.notes, None if self.unknown is None else self.unknown[part],
                      self.warnings)

    def sample(self, points_pmr, order=1):
        """Intensity at points (..., 3) in pmr [m]; NaN outside the outermost voxel centres.

        order 1: linear, 3: cubic B-spline (for sub-voxel edges).
        """
        points = np.asarray(points_pmr, float)
        index = np.moveaxis(self.to_voxel(points), -1, 0)
        if order > 1:
            if order not in self._spline:
                self._spline[order] = spline_filter(self.data, order=order, mode='nearest')
            values = map_coordinates(self._spline[order], index, order=order, mode='nearest', prefilter=False)
        else:
            values = map_coordinates(self.data, index, order=order, mode='nearest')
        last = np.subtract(self.data.shape, 1).reshape(3, *[1] * (index.ndim - 1))
        inside = ((index >= -1e-6) & (index <= last + 1e-6)).all(0) & np.isfinite(points).all(-1)
        return np.where(inside, values, np.nan)


def volume_from_ras(data, T_ras_voxel, axes, path, notes=(), warnings=()):
    """Volume of voxels whose places are known in RAS [m]. Voxels that are not numbers are noted, and kept in `unknown`.

    Raises VolumeError where none is a number.
    """
    if axes not in AXES_FROM_RAS:
        raise VolumeError(f'axes "{axes}" are not known; use RAS or LPS')
    data = np.asarray(data, np.float32)
    known = np.isfinite(data)
    if not known.any():
        raise VolumeError(f'{path}: holds no finite voxel; export it again')
    low = data[known].min()
    if not known.all():
        share = 1 - known.mean()
        warnings = (*warnings, f'{int((~known).sum())} voxels ({share:.2%}) are not numbers, taken as {low:g}, the darkest')
    unknown = None if known.all() else ~known
    return Volume(data if known.all() else np.where(known, data, low), AXES_FROM_RAS[axes] @ T_ras_voxel, axes, str(path), (*notes, *warnings),
                  unknown, tuple(warnings))
