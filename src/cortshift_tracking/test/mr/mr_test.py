"""NIfTI and DICOM into pmr: orientation by the header alone, and refusals that name the remedy."""
import gzip
import os
import shutil

import nibabel
import numpy as np
import pydicom
import pytest
from cortshift_tracking.errors import VolumeError
from cortshift_tracking.mr import load_volume
from cortshift_tracking.mr.admission import MrSource
from cortshift_tracking.mr.dicom import load_dicom
from cortshift_tracking.mr.marked import load_marked
from cortshift_tracking.mr.nifti import load_nifti
from cortshift_tracking.mr.reader import save_nifti
from cortshift_tracking.mr.volume import Volume

CH2 = '/usr/share/mricron/templates/ch2.nii.gz'     # Debian's mricron-data: a real T1 of one head
AAL = '/usr/share/mricron/templates/aal.nii.gz'     # labels of the same head, odd ones on its left
PYDICOM = os.path.join(os.path.dirname(pydicom.__file__), 'data', 'test_files')
NIBABEL = os.path.join(os.path.dirname(nibabel.__file__), 'tests', 'data')

# An oblique grid with i towards the left (negative spacing), anisotropic.
TURN = np.array([[0.9362934, -0.2750958, 0.2183507], [0.2896295, 0.9564251, -0.0369570], [-0.1986693, 0.0978434, 0.9751703]])
OBLIQUE = np.eye(4)
OBLIQUE[:3, :3] = TURN @ np.diag([-0.9, 1.1, 1.7])
OBLIQUE[:3, 3] = [41.0, -63.0, 12.0]
LANDMARK = (7, 21, 4)  # voxel; lies right, anterior and inferior of the middle of a RAS grid of 30 x 30 x 20


def landmark_array():
    data = np.zeros((30, 30, 20), np.float32)
    data[LANDMARK] = 1000
    data[25, 3, 15] = 300
    return data


def nifti(path, affine, data=None, sform=1, qform=1, unit='mm'):
    image = nibabel.Nifti1Image(landmark_array() if data is None else data, None)
    image.header.set_xyzt_units(unit)
    image.set_sform(affine, code=sform)
    image.set_qform(affine, code=qform)
    nibabel.save(image, path)
    return str(path)


def contradicting(path):
    """A file whose sform lies 3 mm beside its qform."""
    image = nibabel.Nifti1Image(landmark_array(), None)
    image.header.set_xyzt_units('mm')
    image.set_sform(OBLIQUE + 3 * np.eye(4, k=3), code=2)
    image.set_qform(OBLIQUE, code=1)
    nibabel.save(image, path)
    return str(path)


def dicom_series(folder, T_lps_voxel_mm, data, order=None, **changes):
    """Write data (columns, rows, slices) as single-slice DICOM files with the given grid; `order` numbers the files."""
    os.makedirs(folder, exist_ok=True)
    template = pydicom.dcmread(os.path.join(PYDICOM, 'MR_small.dcm'))
    spacing = np.linalg.norm(T_lps_voxel_mm[:3, :3], axis=0)
    order = range(data.shape[2]) if order is None else order
    for number, k in enumerate(order):
        slice_ = pydicom.dcmread(os.path.join(PYDICOM, 'MR_small.dcm'))
        slice_.SOPInstanceUID = template.SOPInstanceUID + f'.{k}'
        slice_.SeriesInstanceUID = changes.get('series', '1.2.3')
        slice_.Columns, slice_.Rows = data.shape[:2]
        slice_.PixelData = np.ascontiguousarray(data[..., k].T).astype('<i2').tobytes()
        slice_.PixelSpacing = [f'{spacing[1]:.8g}', f'{spacing[0]:.8g}']
        slice_.SliceThickness = 9.9  # a lie: spacing must come from the positions
        slice_.ImageOrientationPatient = [f'{v:.8f}' for v in np.concatenate(
            [T_lps_voxel_mm[:3, 0] / spacing[0], T_lps_voxel_mm[:3, 1] / spacing[1]])]
        slice_.ImagePositionPatient = [f'{v:.6f}' for v in T_lps_voxel_mm[:3, 3] + k * T_lps_voxel_mm[:3, 2]]
        slice_.InstanceNumber = number + 1
        slice_.save_as(os.path.join(folder, f'im{number:03d}.dcm'))
    return str(folder)


def brightest(volume):
    return volume.to_pmr(np.unravel_index(volume.data.argmax(), volume.data.shape))


@pytest.mark.parametrize('affine', [np.diag([1.0, 1, 1, 1]), np.diag([-1.0, 1, 2, 1]), np.diag([1.0, -0.5, -2, 1]), OBLIQUE])
def test_landmark_lies_where_the_header_says(tmp_path, affine):
    expected_ras = (affine @ [*LANDMARK, 1])[:3] / 1000
    path = nifti(tmp_path / 'a.nii.gz', affine)
    assert np.allclose(brightest(load_volume(path)), expected_ras, atol=1e-6)
    assert np.allclose(brightest(load_volume(path, axes='LPS')), expected_ras * [-1, -1, 1], atol=1e-6)


def test_negative_spacing_is_kept_and_named(tmp_path):
    volume = load_nifti(nifti(tmp_path / 'a.nii', np.diag([-1.0, 1, 2, 1])))
    assert volume.orientation == 'LAS'
    assert np.allclose(volume.spacing, [0.001, 0.001, 0.002])
    assert np.linalg.det(volume.T_pmr_voxel[:3, :3]) < 0
    assert load_nifti(nifti(tmp_path / 'b.nii', OBLIQUE)).orientation == 'LAS'
    assert load_volume(nifti(tmp_path / 'c.nii', np.diag([-1.0, 1, 2, 1])), axes='LPS').orientation == 'LAS'


def test_units_of_the_header_count(tmp_path):
    metres = OBLIQUE.copy()
    metres[:3] /= 1000
    a = load_nifti(nifti(tmp_path / 'm.nii', metres, unit='meter'))
    b = load_nifti(nifti(tmp_path / 'mm.nii', OBLIQUE))
    assert np.allclose(a.T_pmr_voxel, b.T_pmr_voxel, atol=1e-8)


@pytest.mark.parametrize('unit, per_mm', [('meter', 1e-3), ('micron', 1e3)])
def test_forms_are_compared_in_the_unit_of_the_header(tmp_path, unit, per_mm):
    path = tmp_path / 'a.nii'
    for apart_mm in (50.0, 0.0005):
        sform, qform = OBLIQUE.copy(), OBLIQUE.copy()
        qform[0, 3] += apart_mm
        image = nibabel.Nifti1Image(landmark_array(), None)
        image.header.set_xyzt_units(unit)
        image.set_sform(np.diag([per_mm] * 3 + [1]) @ sform, code=1)
        image.set_qform(np.diag([per_mm] * 3 + [1]) @ qform, code=1)
        nibabel.save(image, path)
        if apart_mm > 1:
            with pytest.raises(VolumeError, match='place voxels up to 50.0 mm apart'):
                load_volume(str(path))
        else:
            assert np.allclose(load_volume(str(path)).spacing, [0.0009, 0.0011, 0.0017], atol=1e-6)


def test_round_trip_of_points_and_files(tmp_path):
    volume = load_nifti(nifti(tmp_path / 'a.nii', OBLIQUE), axes='LPS')
    voxels = np.random.default_rng(1).uniform(0, 19, (50, 3))
    assert np.abs(volume.to_voxel(volume.to_pmr(voxels)) - voxels).max() < 1e-9
    save_nifti(volume, tmp_path / 'b.nii.gz')
    again = load_nifti(tmp_path / 'b.nii.gz', axes='LPS')
    assert np.array_equal(again.data, volume.data)
    assert np.allclose(again.T_pmr_voxel, volume.T_pmr_voxel, atol=1e-8)
    # The other reader of the header (nibabel's own) agrees with what was written.
    written = nibabel.load(tmp_path / 'b.nii.gz')
    assert np.allclose(written.affine[:3], OBLIQUE[:3], atol=1e-4)


def test_sampling_is_linear_in_space_and_nan_outside(tmp_path):
    i, j, k = np.meshgrid(*map(np.arange, (30, 30, 20)), indexing='ij')
    data = (3 * i - 2 * j + 5 * k).astype(np.float32)
    volume = load_nifti(nifti(tmp_path / 'a.nii', OBLIQUE, data))
    voxels = np.random.default_rng(2).uniform(4, 15, (100, 3))
    for order in (1, 3):
        assert np.allclose(volume.sample(volume.to_pmr(voxels), order), voxels @ [3, -2, 5], atol=2e-2)
    outside = volume.to_pmr([[-0.5, 3, 3], [3, 3, 19.5], [np.nan, 1, 1]])
    assert np.isnan(volume.sample(outside)).all()


def test_dicom_series_lies_where_the_same_nifti_lies(tmp_path):
    nifti_volume = load_volume(nifti(tmp_path / 'a.nii', OBLIQUE))
    T_lps = np.diag([-1.0, -1, 1, 1]) @ OBLIQUE
    data = landmark_array()
    shuffled = np.random.default_rng(3).permutation(data.shape[2])
    volume = load_volume(dicom_series(tmp_path / 'series', T_lps, data, shuffled))
    assert np.allclose(brightest(volume), brightest(nifti_volume), atol=2e-6)
    # Voxel by voxel: DICOM's slices may be stacked the other way, so compare in space.
    voxels = np.argwhere(np.ones(data.shape, bool))[::37]
    assert np.allclose(volume.sample(nifti_volume.to_pmr(voxels + 0.0)), data[tuple(voxels.T)], atol=2.0)
    assert np.allclose(sorted(volume.spacing), [0.0009, 0.0011, 0.0017], atol=1e-8)
    assert np.allclose(brightest(load_dicom(tmp_path / 'series', axes='LPS')), brightest(nifti_volume) * [-1, -1, 1], atol=2e-6)


# ---- real files

def test_real_head_from_nifti():
    volume = load_volume(CH2, template_space=True)
    assert volume.data.shape == (181, 217, 181) and volume.orientation == 'RAS'
    assert np.allclose(volume.spacing, 0.001)
    assert any('no unit' in note for note in volume.notes)
    labels = load_volume(AAL, template_space=True)
    right_amygdala, left_amygdala = labels.data == 42, labels.data == 41
    centre = [labels.to_pmr(np.argwhere(mask)).mean(0) for mask in (right_amygdala, left_amygdala)]
    assert centre[0][0] > 0.015 and centre[1][0] < -0.015      # RAS: right is +x
    assert -0.02 < centre[0][1] < 0.01 and -0.03 < centre[0][2] < -0.005
    assert np.median(volume.sample(labels.to_pmr(np.argwhere(right_amygdala)))) > 60  # tissue, not air


def test_real_oblique_scan_from_nifti(tmp_path):
    with pytest.raises(VolumeError, match='holds 2 volumes'):
        load_volume(os.path.join(NIBABEL, 'example4d.nii.gz'))
    first = nibabel.load(os.path.join(NIBABEL, 'example4d.nii.gz')).slicer[..., 0]
    nibabel.save(first, tmp_path / 'first.nii.gz')
    volume = load_volume(str(tmp_path / 'first.nii.gz'))
    assert volume.orientation == 'LAS'
    assert np.allclose(volume.spacing, [0.002, 0.002, 0.0022], atol=1e-7)
    # The EPI is tilted by 9.3 degrees about the left-right axis.
    assert np.isclose(np.degrees(np.arctan2(volume.T_pmr_voxel[2, 1], volume.T_pmr_voxel[1, 1])), 9.3, atol=0.1)


def test_real_mr_from_dicom():
    volume = load_volume(os.path.join(PYDICOM, 'MR_small.dcm'))
    source = pydicom.dcmread(os.path.join(PYDICOM, 'MR_small.dcm'))
    assert volume.data.shape == (64, 64, 1)
    assert np.allclose(volume.spacing * 1000, [*map(float, source.PixelSpacing), source.SliceThickness])
    first_voxel = np.array(source.ImagePositionPatient, float) * [-1, -1, 1] / 1000
    assert np.allclose(volume.to_pmr([0, 0, 0]), first_voxel)
    assert volume.data[5, 40, 0] == source.pixel_array[40, 5]


def real_ct_named_mr(folder, name):
    os.makedirs(folder)
    for file in os.listdir(os.path.join(PYDICOM, 'dicomdirtests', name)):
        slice_ = pydicom.dcmread(os.path.join(PYDICOM, 'dicomdirtests', name, file))
        slice_.Modality = 'MR'
        slice_.save_as(folder / file)
    return str(folder)


def test_real_series_is_sorted_by_position(tmp_path):
    volume = load_volume(real_ct_named_mr(tmp_path / 's', '98892001/CT5N'))
    assert volume.data.shape == (16, 16, 5)
    assert np.allclose(volume.spacing, [0.000488281, 0.000488281, 0.0025])
    assert np.isclose(volume.to_pmr([0, 0, 0])[2], -0.0012375) and volume.T_pmr_voxel[2, 2] > 0


@pytest.mark.parametrize('folder, reason', [
    ('98892003/MR700', 'not one stack of parallel slices'),  # rotating projections of an angiogram
    ('98892003/MR2', 'holds 3 series'),                      # three-plane localisers
    ('98892001/CT5N', 'Modality of 2062 is CT, not MR; give the folder with the MR series'), ('77654033/CT2', 'is CT, not MR')])
def test_real_folders_that_are_no_volume(folder, reason):
    with pytest.raises(VolumeError, match=reason):
        load_volume(os.path.join(PYDICOM, 'dicomdirtests', folder))


def test_a_real_folder_with_most_slices_left_out(tmp_path):
    with pytest.raises(VolumeError, match='uneven slices'):
        load_volume(real_ct_named_mr(tmp_path / 's', '77654033/CT2'))


@pytest.mark.parametrize('value', [1, 255, 0.25])
def test_what_marks_is_above_0_whatever_the_number(tmp_path, value):
    """Between its voxels the border of a label lies half way, as of one that is stored as 1."""
    data = np.zeros((30, 30, 20), np.float32)
    data[10:20, 10:20, 5:15] = value
    data[0, 0, 0] = np.nan
    marked = load_marked(MrSource(nifti(tmp_path / 'a.nii', OBLIQUE, data)), one_structure=True)
    assert marked.data.dtype == np.float32 and marked.data.sum() == 1000 and marked.data.max() == 1 and marked.data[0, 0, 0] == 0
    at = marked.sample(marked.to_pmr([[9.4, 15, 10], [9.6, 15, 10]]))
    assert at[0] < 0.5 < at[1]


def test_a_label_file_of_several_structures_is_refused(tmp_path):
    data = np.zeros((30, 30, 20), np.float32)
    data[3:9, 3:9, 3:9], data[12:19, 3:9, 3:9] = 4, 43
    source = MrSource(nifti(tmp_path / 'a.nii', OBLIQUE, data))
    with pytest.raises(VolumeError, match=r'a.nii: numbers several structures \(4, 43\); if all of it is one, write it as 0 and 1, else give'):
        load_marked(source, one_structure=True)
    assert load_marked(source).data.sum() == 6 ** 3 + 7 * 6 * 6   # a brain mask may


def test_the_form_of_the_mr_counts_for_a_mask_only_where_its_header_leaves_a_choice(tmp_path):
    alone = nifti(tmp_path / 'alone.nii', OBLIQUE, qform=0)
    assert (load_marked(MrSource(alone, form='qform')).T_pmr_voxel == load_nifti(alone).T_pmr_voxel).all()
    agree = nifti(tmp_path / 'agree.nii', OBLIQUE)
    assert (load_marked(MrSource(agree, form='qform')).T_pmr_voxel == load_nifti(agree).T_pmr_voxel).all()
    both = contradicting(tmp_path / 'both.nii')
    assert (load_marked(MrSource(both, form='qform')).T_pmr_voxel == load_nifti(both, form='qform').T_pmr_voxel).all()
    with pytest.raises(VolumeError, match='3.0 mm apart'):
        load_marked(MrSource(both))


# ---- refusals

def test_no_orientation_is_refused(tmp_path):
    with pytest.raises(VolumeError, match='does not say where.*export'):
        load_volume(nifti(tmp_path / 'a.nii', OBLIQUE, sform=0, qform=0))


def test_disagreeing_forms_are_refused_until_one_is_named(tmp_path):
    path = contradicting(tmp_path / 'a.nii')
    with pytest.raises(VolumeError, match='3.0 mm apart'):
        load_volume(path)
    gap = brightest(load_volume(path, form='sform')) - brightest(load_volume(path, form='qform'))
    assert np.allclose(gap, [0.003, 0, 0], atol=1e-6)
    with pytest.raises(VolumeError, match='has no qform; it has sform'):
        load_nifti(nifti(tmp_path / 'b.nii', OBLIQUE, qform=0), form='qform')


def damaged(path, offset, data):
    with open(path, 'r+b') as file:
        file.seek(offset)
        file.write(data)


@pytest.mark.parametrize('offset, data, reason', [
    (344, b'abcd', 'not readable as NIfTI|not NIfTI'),                    # magic
    (40, b'\xff\x7f', 'not readable as NIfTI|not a 3D volume'),           # number of dimensions
    (42, b'\xfe\xff', 'not readable as NIfTI|not a 3D volume'),           # a negative size
    (70, b'\x99\x09', 'not readable as NIfTI'),                           # unknown data type
    (280, np.float32(np.nan).tobytes(), 'NaN'),                           # sform
    (280, np.zeros(4, np.float32).tobytes(), 'outside|in one plane'),     # a vanishing axis
    (123, b'\x01', 'outside|unit')])                                      # metres where millimetres are meant
def test_broken_headers_are_refused(tmp_path, offset, data, reason):
    path = nifti(tmp_path / 'a.nii', np.diag([1.0, 1, 1, 1]), qform=0)
    damaged(path, offset, data)
    with pytest.raises(VolumeError, match=reason) as refusal:
        load_volume(path)
    assert 'a.nii' in str(refusal.value)


@pytest.mark.parametrize('suffix', ['.nii', '.nii.gz'])
@pytest.mark.parametrize('order', ['<', '>'])
@pytest.mark.parametrize('kind, place, number, smallest', [(nibabel.Nifti1Image, 108, 'f4', 352), (nibabel.Nifti2Image, 168, 'i8', 544)])
def test_voxels_begin_behind_the_header(tmp_path, kind, place, number, smallest, order, suffix):
    """Offsets within the header shift the MR by up to 176 voxels of 16 bits; where an extension stands between, the voxels count."""
    path = tmp_path / ('a' + suffix)

    def write(offset=None, extension=False):
        image = kind(landmark_array(), OBLIQUE, kind.header_class(endianness=order))
        if extension:
            image.header.extensions.append(nibabel.nifti1.Nifti1Extension('comment', b'of the scanner' * 10))
        image.header.set_xyzt_units('mm')
        data = bytearray(image.to_bytes())
        if offset is not None:
            data[place:place + np.dtype(number).itemsize] = np.array(offset, order + number).tobytes()
        path.write_bytes(gzip.compress(bytes(data)) if suffix.endswith('gz') else data)
        return str(path)
    for extension in (False, True):
        assert np.array_equal(load_volume(write(extension=extension)).data, landmark_array())
        for offset in (0, 16, smallest - 4, -16):
            with pytest.raises(VolumeError, match=rf'a{suffix}: vox_offset is {offset}, but voxels of a .nii file begin at byte {smallest} or '
                               rf'behind it; write the file anew with vox_offset {smallest}$'):
                load_volume(write(offset, extension))
    if number == 'f4':
        for offset in (np.nan, np.inf, smallest + 0.5):
            with pytest.raises(VolumeError, match=f'a{suffix}: vox_offset is (352.5|nan|inf), but'):
                load_volume(write(offset))


def test_truncated_files_are_refused(tmp_path):
    whole = nifti(tmp_path / 'a.nii', OBLIQUE)
    packed = nifti(tmp_path / 'a.nii.gz', OBLIQUE)
    for path, keep in ((whole, 20000), (whole, 100), (packed, 300), (packed, 60)):
        cut = tmp_path / ('cut' + ''.join(os.path.splitext(path)[1:] if not path.endswith('.gz') else '.nii.gz'))
        with open(path, 'rb') as source:
            cut.write_bytes(source.read(keep))
        with pytest.raises(VolumeError, match='cut.*(incomplete|not readable)'):
            load_volume(str(cut))
    not_gzip = tmp_path / 'text.nii.gz'
    not_gzip.write_text('hello')
    with pytest.raises(VolumeError, match='text.nii.gz'):
        load_volume(str(not_gzip))
    (tmp_path / 'zip.nii.gz').write_bytes(gzip.compress(b'hello'))
    with pytest.raises(VolumeError, match='zip.nii.gz'):
        load_volume(str(tmp_path / 'zip.nii.gz'))


def test_missing_unit_is_refused_where_mm_makes_no_head(tmp_path):
    tiny = OBLIQUE.copy()
    tiny[:3, :3] /= 100
    with pytest.raises(VolumeError, match='set xyzt_units'):
        load_volume(nifti(tmp_path / 'a.nii', tiny, unit='unknown'))


def test_faulty_series_are_refused(tmp_path):
    T_lps = np.diag([-1.0, -1, 1, 1]) @ OBLIQUE
    data = landmark_array()
    gap = tmp_path / 'gap'
    dicom_series(gap, T_lps, data)
    os.remove(gap / 'im007.dcm')
    with pytest.raises(VolumeError, match='uneven slices'):
        load_volume(str(gap))
    twice = tmp_path / 'twice'
    dicom_series(twice, T_lps, data)
    shutil.copy(twice / 'im007.dcm', twice / 'copy.dcm')
    with pytest.raises(VolumeError, match='uneven slices|same place'):
        load_volume(str(twice))
    two = tmp_path / 'two'
    dicom_series(two, T_lps, data[..., :3])
    other = tmp_path / 'other'
    dicom_series(other, T_lps, data[..., :3], series='1.2.77')
    for file in os.listdir(other):
        shutil.copy(other / file, two / f'other_{file}')
    with pytest.raises(VolumeError, match='holds 2 series'):
        load_volume(str(two))
    assert load_volume(str(two), series='.77').data.shape == (30, 30, 3)
    with pytest.raises(VolumeError, match='no series ends in'):
        load_volume(str(two), series='9')
    placeless = pydicom.dcmread(other / 'im001.dcm')
    del placeless.ImagePositionPatient
    placeless.save_as(other / 'im001.dcm')
    with pytest.raises(VolumeError, match='im001.dcm has no usable ImagePositionPatient'):
        load_volume(str(other))
    empty = tmp_path / 'empty'
    empty.mkdir()
    (empty / 'notes.txt').write_text('no image')
    with pytest.raises(VolumeError, match='no DICOM image found.*notes.txt'):
        load_volume(str(empty))


def test_missing_file_and_unknown_axes_are_refused(tmp_path):
    with pytest.raises(VolumeError, match='no such file'):
        load_volume(str(tmp_path / 'nothing.nii'))
    with pytest.raises(VolumeError, match='use RAS or LPS'):
        load_volume(nifti(tmp_path / 'a.nii', OBLIQUE), axes='RSA')
    with pytest.raises(VolumeError, match='one plane'):
        Volume(np.zeros((2, 2, 2), np.float32), np.diag([0.001, 0.001, 0.001, 1]) @ np.array(
            [[1, 1, 0, 0], [0, 0, 0, 0], [0, 0.01, 1, 0], [0, 0, 0, 1.0]]))
