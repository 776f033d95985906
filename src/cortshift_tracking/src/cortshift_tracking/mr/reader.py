"""Preoperative MR from NIfTI files and DICOM series, and to NIfTI."""
import gzip
import os

import nibabel
import numpy as np

from cortshift_tracking.durable import write_durably
from cortshift_tracking.errors import VolumeError
from cortshift_tracking.mr.dicom import load_dicom
from cortshift_tracking.mr.nifti import load_nifti
from cortshift_tracking.mr.volume import AXES_FROM_RAS


def load_volume(path, axes='RAS', form=None, series=None, template_space=False, form_decides=True):
    """Load a NIfTI file (.nii, .nii.gz), a DICOM file, or a folder with one DICOM series.

    axes: what the axes of pmr point to, 'RAS' or 'LPS'. form, template_space, form_decides: see load_nifti. series: see load_dicom.
    Raises VolumeError naming the file and the remedy.
    """
    path = str(path)
    if os.path.isdir(path):
        return load_dicom(path, axes, series)
    if not os.path.exists(path):
        raise VolumeError(f'{path}: no such file; give a NIfTI file or a folder with a DICOM series')
    if path.lower().endswith(('.nii', '.nii.gz')):
        return load_nifti(path, axes, form, template_space, form_decides)
    return load_dicom(path, axes, series)


def save_nifti(volume, path, kind=np.float32, level=6):
    """Write a Volume as NIfTI-1 (RAS, mm, sform and qform with scanner code), durably. level: of the compression, 1 fast."""
    affine = np.linalg.inv(AXES_FROM_RAS[volume.axes]) @ volume.T_pmr_voxel
    affine[:3] *= 1000
    image = nibabel.Nifti1Image(np.asarray(volume.data, kind), affine)
    image.header.set_xyzt_units('mm')
    image.set_sform(affine, code=1)
    try:
        image.set_qform(affine, code=1, strip_shears=False)
    except nibabel.spatialimages.HeaderDataError:  # a sheared grid has no quaternion; the sform alone tells
        image.set_qform(None, code=0)
    data = image.to_bytes()
    write_durably(path, gzip.compress(data, level) if str(path).endswith('.gz') else data)
