"""NIfTI files: RAS, in the header's unit (NIfTI-1 standard, methods 2 and 3), oriented by the header alone.

Nothing is guessed: a header that does not say where the voxels are is refused.
"""
import gzip
import zlib

import nibabel
import numpy as np

from cortshift_tracking.errors import VolumeError
from cortshift_tracking.mr.volume import volume_from_ras

NIFTI_UNITS = {'mm': 0.001, 'meter': 1.0, 'micron': 1e-6}
PATIENT_CODES = (1, 2)  # of sform and qform: the scanner's coordinates, and those of another image of the patient
#: Codes whose coordinates are not of the patient but of an atlas that the brain was fitted to.
TEMPLATE_CODES = {3: 'coordinates of the Talairach atlas', 4: 'coordinates of the MNI template', 5: 'coordinates of a template'}
FORM_TOLERANCE = 0.0005   # qform and sform may differ by this much anywhere in the volume [m]
EXTENT_RANGE = (0.02, 0.6)  # of a head volume's longest side [m]; outside, an unstated unit cannot be millimetres


def load_nifti(path, axes='RAS', form=None, template_space=False, form_decides=True):
    """Load a 3D NIfTI-1 or NIfTI-2 file.

    form: 'sform' or 'qform'; needed only where the header holds both and they disagree.
    form_decides: refuse a header that does not hold `form`. False: `form` is that of another file, and counts only where it is needed.
    template_space: take coordinates of an atlas, too. They are not those of the patient, and of another size.
    """
    try:
        _check_offset(path)
        image = nibabel.load(path)
        if not isinstance(image, (nibabel.Nifti1Image, nibabel.Nifti2Image)):  # Analyze files open too
            raise VolumeError(f'{path}: is {type(image).__name__}, not NIfTI; convert it')
        header = image.header
    except (nibabel.filebasedimages.ImageFileError, nibabel.spatialimages.HeaderDataError, OSError, EOFError, ValueError,
            zlib.error) as error:
        raise VolumeError(f'{path}: not readable as NIfTI ({error}); export it again') from error
    shape = image.shape
    if len(shape) > 3 and np.prod(shape[3:]) != 1:
        raise VolumeError(f'{path}: holds {int(np.prod(shape[3:]))} volumes (shape {shape}); export the one to be used')
    if len(shape) < 3 or min(shape[:3]) < 1:
        raise VolumeError(f'{path}: shape {shape} is not a 3D volume; export one 3D volume')
    if header.get_data_dtype().names or header.get_data_dtype().kind == 'c':
        raise VolumeError(f'{path}: voxels of type {header.get_data_dtype()} are not intensities; export grey values')
    forms = _nifti_forms(path, header)
    scale, doubts = _nifti_unit(path, header, forms, shape)
    name, affine, notes = _nifti_affine(path, header, forms, scale, form, form_decides)
    doubts += _nifti_space(path, name, int(header[name + '_code']), template_space)
    try:
        data = np.asarray(image.dataobj, np.float32).reshape(shape[:3])
    except (OSError, EOFError, ValueError, zlib.error, gzip.BadGzipFile) as error:
        raise VolumeError(f'{path}: voxel data are incomplete or damaged ({error}); copy or export it again') from error
    return volume_from_ras(data, affine, axes, path, notes, doubts)


def _check_offset(path):
    """Whether voxels begin behind the header. nibabel would take a header's bytes for voxels, where vox_offset is 0, and shift all that
    follow; image.header does not keep what the file says."""
    with nibabel.openers.ImageOpener(path) as file:
        head = file.read(nibabel.Nifti2Header.sizeof_hdr)
    for kind in (nibabel.Nifti1Header, nibabel.Nifti2Header):
        if kind.may_contain_header(head):
            header, smallest = kind(head[:kind.sizeof_hdr], check=False), kind.single_vox_offset
            said = header['vox_offset'].item()
            # A damaged count of dimensions tells no order of bytes, and is refused by nibabel.
            if 1 <= header['dim'][0] <= 7 and (not said >= smallest or said % 1):
                raise VolumeError(f'{path}: vox_offset is {said:g}, but voxels of a .nii file begin at byte {smallest} or behind it; write '
                                  f'the file anew with vox_offset {smallest}')


def _nifti_forms(path, header):
    """The header's voxel-to-RAS matrices by name, in its own unit; at least one."""
    forms = {}
    if header['sform_code'] > 0:
        forms['sform'] = header.get_sform()
    if header['qform_code'] > 0:
        try:
            forms['qform'] = header.get_qform()
        except (nibabel.spatialimages.HeaderDataError, ValueError) as error:
            raise VolumeError(f'{path}: the qform quaternion is not a rotation ({error}); export it again') from error
    if not forms:
        raise VolumeError(f'{path}: qform_code and sform_code are 0, so the header does not say where the voxels lie; export '
                          'it again with scanner coordinates')
    return forms


def _nifti_affine(path, header, forms, scale, form, decides):
    """Name of the form that counts, voxel to RAS [m], and notes. scale: metres per unit of the header. decides: see load_nifti."""
    forms = {name: np.diag([scale, scale, scale, 1]) @ matrix for name, matrix in forms.items()}
    if form not in (None, 'sform', 'qform'):
        raise VolumeError(f'form "{form}" is not known; use sform or qform')
    if decides and form is not None and form not in forms:
        raise VolumeError(f'{path}: the header has no {form}; it has {" and ".join(forms)}')
    asked = form, forms.get(form), [f'orientation from the {form}, as asked']
    if decides and form is not None:
        return asked
    if len(forms) == 2:
        shape = header.get_data_shape()[:3]
        corners = np.array([[i, j, k, 1] for i in (0, shape[0]) for j in (0, shape[1]) for k in (0, shape[2])], float)
        apart = np.linalg.norm((corners @ (forms['sform'] - forms['qform']).T)[:, :3], axis=1).max()
        if not apart <= FORM_TOLERANCE:
            if form is not None:
                return asked
            raise VolumeError(f'{path}: sform (code {int(header["sform_code"])}) and qform (code {int(header["qform_code"])}) '
                              f'place voxels up to {apart * 1000:.1f} mm apart; say which one the patient registration '
                              'used (--form sform or qform)')
    name = 'sform' if 'sform' in forms else 'qform'
    return name, forms[name], [f'orientation from the {name} (code {int(header[name + "_code"])})']


def _nifti_space(path, name, code, template_space):
    """Warnings. Refuses coordinates of a template, unless they are meant."""
    if code in PATIENT_CODES:
        return []
    if code not in TEMPLATE_CODES:
        raise VolumeError(f'{path}: {name}_code {code} is none that NIfTI knows, so it is not said which space this is; export it again')
    if not template_space:
        raise VolumeError(f'{path}: {name}_code {code} says {TEMPLATE_CODES[code]}, not those of the patient; give the MR in scanner '
                          'coordinates, or --template-space if it is meant')
    return [f'in {TEMPLATE_CODES[code]}, as meant']


def _nifti_unit(path, header, forms, shape):
    """Metres per header unit, and warnings. Many real headers leave the unit out; millimetres are then taken if a head would fit."""
    try:
        unit = header.get_xyzt_units()[0]
    except KeyError as error:
        raise VolumeError(f'{path}: xyzt_units {int(header["xyzt_units"])} names no unit that NIfTI knows; set it to mm') from error
    if unit in NIFTI_UNITS:
        return NIFTI_UNITS[unit], []
    extent = max((np.linalg.norm(matrix[:3, :3], axis=0) * np.array(shape[:3])).max() for matrix in forms.values()) * 0.001
    if not EXTENT_RANGE[0] <= extent <= EXTENT_RANGE[1]:
        raise VolumeError(f'{path}: the header names no unit of length, and as millimetres the volume would be '
                          f'{extent * 1000:.4g} mm long; set xyzt_units')
    return 0.001, ['the header names no unit of length; taken as mm']
