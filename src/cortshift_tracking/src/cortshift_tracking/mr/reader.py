"""Preoperative MR from NIfTI files and DICOM series, oriented by the header alone.

NIfTI stores RAS millimetres (NIfTI-1 standard, methods 2 and 3), DICOM LPS millimetres (PS3.3 C.7.6.2.1.1); both
become one Volume in pmr, metres. Nothing is guessed: a header that does not say where the voxels are is refused.
DICOM is read by pydicom: Debian 12 has no SimpleITK.
"""
import gzip
import os
import zlib

import nibabel
import numpy as np
import pydicom

from cortshift_tracking.durable import write_durably
from cortshift_tracking.errors import VolumeError
from cortshift_tracking.mr.volume import AXES_FROM_RAS, Volume

NIFTI_UNITS = {'mm': 0.001, 'meter': 1.0, 'micron': 1e-6}
FORM_TOLERANCE = 0.0005   # qform and sform may differ by this much anywhere in the volume [m]
SLICE_TOLERANCE = 0.01    # slices may deviate from even spacing by this share of the spacing
EXTENT_RANGE = (0.02, 0.6)  # of a head volume's longest side [m]; outside, an unstated unit cannot be millimetres


def load_volume(path, axes='RAS', form=None, series=None):
    """Load a NIfTI file (.nii, .nii.gz), a DICOM file, or a folder with one DICOM series.

    axes: what the axes of pmr point to, 'RAS' or 'LPS'. form: see load_nifti. series: see load_dicom.
    Raises VolumeError naming the file and the remedy.
    """
    if os.path.isdir(path):
        return load_dicom(path, axes, series)
    if not os.path.exists(path):
        raise VolumeError(f'{path}: no such file; give a NIfTI file or a folder with a DICOM series')
    if str(path).endswith(('.nii', '.nii.gz')):
        return load_nifti(path, axes, form)
    return load_dicom(path, axes, series)


# ---- NIfTI

def load_nifti(path, axes='RAS', form=None):
    """Load a 3D NIfTI-1 or NIfTI-2 file.

    form: 'sform' or 'qform'; needed only where the header holds both and they disagree.
    """
    try:
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
    scale, unit_note = _nifti_unit(path, header, forms, shape)
    affine, notes = _nifti_affine(path, header, forms, scale, form)
    try:
        data = np.asarray(image.dataobj, np.float32).reshape(shape[:3])
    except (OSError, EOFError, ValueError, zlib.error, gzip.BadGzipFile) as error:
        raise VolumeError(f'{path}: voxel data are incomplete or damaged ({error}); copy or export it again') from error
    if not np.isfinite(data).any():
        raise VolumeError(f'{path}: holds no finite voxel; export it again')
    return Volume(np.nan_to_num(data, nan=0.0, posinf=0.0, neginf=0.0), AXES_FROM_RAS[_known(axes)] @ affine, axes, str(path),
                  tuple(notes + unit_note))


def _known(axes):
    if axes not in AXES_FROM_RAS:
        raise VolumeError(f'axes "{axes}" are not known; use RAS or LPS')
    return axes


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


def _nifti_affine(path, header, forms, scale, form):
    """Voxel to RAS [m], and notes. scale: metres per unit of the header."""
    forms = {name: np.diag([scale, scale, scale, 1]) @ matrix for name, matrix in forms.items()}
    if form is not None:
        if form not in ('sform', 'qform'):
            raise VolumeError(f'form "{form}" is not known; use sform or qform')
        if form not in forms:
            raise VolumeError(f'{path}: the header has no {form}; it has {" and ".join(forms)}')
        return forms[form], [f'orientation from the {form}, as asked']
    if len(forms) == 2:
        shape = header.get_data_shape()[:3]
        corners = np.array([[i, j, k, 1] for i in (0, shape[0]) for j in (0, shape[1]) for k in (0, shape[2])], float)
        apart = np.linalg.norm((corners @ (forms['sform'] - forms['qform']).T)[:, :3], axis=1).max()
        if not apart <= FORM_TOLERANCE:
            raise VolumeError(f'{path}: sform (code {int(header["sform_code"])}) and qform (code {int(header["qform_code"])}) '
                              f'place voxels up to {apart * 1000:.1f} mm apart; say which one the patient registration '
                              'used (form: sform or qform)')
    name = 'sform' if 'sform' in forms else 'qform'
    return forms[name], [f'orientation from the {name} (code {int(header[name + "_code"])})']


def _nifti_unit(path, header, forms, shape):
    """Metres per header unit. Many real headers leave the unit out; millimetres are then taken if a head would fit."""
    unit = header.get_xyzt_units()[0]
    if unit in NIFTI_UNITS:
        return NIFTI_UNITS[unit], []
    extent = max((np.linalg.norm(matrix[:3, :3], axis=0) * np.array(shape[:3])).max() for matrix in forms.values()) * 0.001
    if not EXTENT_RANGE[0] <= extent <= EXTENT_RANGE[1]:
        raise VolumeError(f'{path}: the header names no unit of length, and as millimetres the volume would be '
                          f'{extent * 1000:.4g} mm long; set xyzt_units')
    return 0.001, ['the header names no unit of length; taken as mm']


def save_nifti(volume, path):
    """Write a Volume as NIfTI-1 (float32, RAS, mm, sform and qform with scanner code), durably."""
    affine = np.linalg.inv(AXES_FROM_RAS[volume.axes]) @ volume.T_pmr_voxel
    affine[:3] *= 1000
    image = nibabel.Nifti1Image(np.asarray(volume.data, np.float32), affine)
    image.header.set_xyzt_units('mm')
    image.set_sform(affine, code=1)
    try:
        image.set_qform(affine, code=1, strip_shears=False)
    except nibabel.spatialimages.HeaderDataError:  # a sheared grid has no quaternion; the sform alone tells
        image.set_qform(None, code=0)
    data = image.to_bytes()
    write_durably(path, gzip.compress(data, 6) if str(path).endswith('.gz') else data)


# ---- DICOM

def load_dicom(path, axes='RAS', series=None):
    """Load a DICOM series: a folder (not searched below) or a single file.

    series: SeriesInstanceUID (or its end) to take where the folder holds several.
    """
    files = sorted(os.path.join(path, name) for name in os.listdir(path)) if os.path.isdir(path) else [path]
    slices = {}
    unread = []
    for file in files:
        if not os.path.isfile(file):
            continue
        try:
            dataset = pydicom.dcmread(file)
        except (pydicom.errors.InvalidDicomError, OSError, EOFError, ValueError, KeyError, AttributeError) as error:
            unread.append(f'{os.path.basename(file)} ({error})')
            continue
        if 'PixelData' in dataset:
            slices.setdefault(str(dataset.get('SeriesInstanceUID', '')), []).append((file, dataset))
    if not slices:
        raise VolumeError(f'{path}: no DICOM image found' + (f'; not readable: {"; ".join(unread[:3])}' if unread else '')
                          + '; give a folder with one series, or a NIfTI file')
    if series is not None:
        slices = {uid: members for uid, members in slices.items() if uid.endswith(series)}
        if not slices:
            raise VolumeError(f'{path}: no series ends in "{series}"')
    if len(slices) > 1:
        listing = '; '.join(f'{uid[-24:]} "{members[0][1].get("SeriesDescription", "")}" ({len(members)} images)'
                            for uid, members in sorted(slices.items()))
        raise VolumeError(f'{path}: holds {len(slices)} series; name one by the end of its UID: {listing}')
    members = next(iter(slices.values()))
    _check_alike(path, members)
    members, step, notes = _sorted_slices(path, members)
    data = np.stack([_pixels(file, dataset) for file, dataset in members], axis=-1)
    first = members[0][1]
    row, column = _directions(members[0])
    spacing = np.array(first.PixelSpacing, float)  # between rows, between columns
    affine_lps = np.eye(4)
    affine_lps[:3, 0] = row * spacing[1]
    affine_lps[:3, 1] = column * spacing[0]
    affine_lps[:3, 2] = step
    affine_lps[:3, 3] = np.array(first.ImagePositionPatient, float)
    affine_lps[:3] *= 0.001
    T_ras_voxel = np.linalg.inv(AXES_FROM_RAS['LPS']) @ affine_lps
    return Volume(data, AXES_FROM_RAS[_known(axes)] @ T_ras_voxel, axes, str(path),
                  tuple(notes + ([f'{len(unread)} files in the folder are not DICOM'] if unread else [])))


def _check_alike(path, members):
    for file, dataset in members:
        name = os.path.basename(file)
        if int(dataset.get('NumberOfFrames', 1)) != 1:
            raise VolumeError(f'{path}: {name} is a multi-frame image; export it as single slices or as NIfTI')
        if 'MOSAIC' in list(dataset.get('ImageType', [])):
            raise VolumeError(f'{path}: {name} is a mosaic of slices; convert it to NIfTI')
        if int(dataset.get('SamplesPerPixel', 1)) != 1:
            raise VolumeError(f'{path}: {name} is a colour image; give the MR series itself')
        for key, count in (('ImagePositionPatient', 3), ('ImageOrientationPatient', 6), ('PixelSpacing', 2)):
            value = dataset.get(key)
            if value is None or len(value) != count or not np.isfinite(np.array(value, float)).all():
                raise VolumeError(f'{path}: {name} has no usable {key}, so its place in the head is unknown; export the '
                                  'original series')
        if min(np.array(dataset.PixelSpacing, float)) <= 0:
            raise VolumeError(f'{path}: {name} has PixelSpacing {list(dataset.PixelSpacing)}; export the original series')
        _directions((file, dataset))
    first = members[0][1]
    for file, dataset in members[1:]:
        for key in ('Rows', 'Columns', 'PixelSpacing', 'ImageOrientationPatient'):
            if not np.allclose(np.array(dataset[key].value, float), np.array(first[key].value, float), atol=1e-4):
                raise VolumeError(f'{path}: {key} of {os.path.basename(file)} differs from that of '
                                  f'{os.path.basename(members[0][0])}: not one stack of parallel slices (a localiser or '
                                  'rotated projections?); choose another series')


def _directions(member):
    """Unit vectors along the rows and down the columns, LPS."""
    file, dataset = member
    orientation = np.array(dataset.ImageOrientationPatient, float)
    row, column = orientation[:3], orientation[3:]
    lengths = np.linalg.norm(row), np.linalg.norm(column)
    if abs(lengths[0] - 1) > 1e-2 or abs(lengths[1] - 1) > 1e-2 or abs(row @ column) > 1e-2:
        raise VolumeError(f'{file}: ImageOrientationPatient {list(orientation)} is not two perpendicular unit vectors; export '
                          'the original series')
    return row / lengths[0], column / lengths[1]


def _sorted_slices(path, members):
    """Slices by position along their normal (never by file name or instance number), and the step between them [mm]."""
    row, column = _directions(members[0])
    normal = np.cross(row, column)
    members = sorted(members, key=lambda member: normal @ np.array(member[1].ImagePositionPatient, float))
    if len(members) == 1:
        dataset = members[0][1]
        thickness = dataset.get('SpacingBetweenSlices') or dataset.get('SliceThickness')
        if not thickness or not float(thickness) > 0:
            raise VolumeError(f'{path}: a single slice without SliceThickness; give the whole series')
        return members, normal * float(thickness), ['a single slice; its thickness is taken as the spacing']
    positions = np.array([np.array(dataset.ImagePositionPatient, float) for _, dataset in members])
    steps = np.diff(positions, axis=0)
    typical = np.median(np.linalg.norm(steps, axis=1))
    if typical < 1e-3:
        raise VolumeError(f'{path}: several images at the same place; give one series at one time and contrast')
    step = (positions[-1] - positions[0]) / (len(members) - 1)
    deviation = np.linalg.norm(steps - step, axis=1)
    if deviation.max() > SLICE_TOLERANCE * typical + 1e-3:
        worst = int(deviation.argmax())
        raise VolumeError(f'{path}: uneven slices: {np.linalg.norm(steps[worst]):.3f} mm between '
                          f'{os.path.basename(members[worst][0])} and {os.path.basename(members[worst + 1][0])}, usually '
                          f'{typical:.3f} mm; a slice is missing or doubled, export the whole series')
    return members, step, []


def _pixels(file, dataset):
    """(columns, rows) float32 after the modality rescale."""
    try:
        pixels = dataset.pixel_array
    except Exception as error:  # pydicom's decoders raise many types; all mean the same here
        raise VolumeError(f'{file}: pixel data are not readable ({error}); export it uncompressed') from error
    slope, intercept = float(dataset.get('RescaleSlope', 1) or 1), float(dataset.get('RescaleIntercept', 0) or 0)
    return (pixels.astype(np.float32) * np.float32(slope) + np.float32(intercept)).T
