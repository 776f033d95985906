"""What makes DICOM files one image: each thing that may differ is refused by its name, and so is a number that is none."""
import os
import re
import shutil

import numpy as np
import pytest
from cortshift_tracking.errors import VolumeError
from cortshift_tracking.mr.reader import load_volume
from dicom_series import SIZE, SLICES, SPACING, series, voxels
from pydicom.datadict import dictionary_VR, tag_for_keyword
from pydicom.dataelem import RawDataElement
from pydicom.tag import Tag

def raw(dataset, key, value):
    """An element as a careless program writes it."""
    tag = Tag(tag_for_keyword(key))
    data = value.encode() + b' ' * (len(value) % 2)
    dataset[tag] = RawDataElement(tag, dictionary_VR(tag), len(data), data, 0, False, True)


def setting(key, value, slices=range(3, SLICES)):
    def change(dataset, n):
        if n in slices:
            if value is None:
                if key in dataset:
                    delattr(dataset, key)
            else:
                setattr(dataset, key, value)
    return change


def test_a_whole_series_is_read(tmp_path):
    volume = load_volume(series(tmp_path / 's'))
    assert volume.data.shape == (SIZE, SIZE, SLICES) and np.allclose(volume.spacing, SPACING / 1000)
    assert np.array_equal(volume.data, np.moveaxis(voxels(), (0, 1, 2), (2, 1, 0)))


@pytest.mark.parametrize('key, value', [
    ('EchoTime', 90.0), ('EchoTime', None), ('EchoNumbers', 2), ('ImageType', ['ORIGINAL', 'PRIMARY', 'P']), ('FlipAngle', 9.0),
    ('InversionTime', 900.0), ('TemporalPositionIdentifier', 2), ('PhotometricInterpretation', 'MONOCHROME1'), ('RescaleSlope', 2.0),
    ('FrameOfReferenceUID', '1.2.3.4'), ('RepetitionTime', 2000.0), ('ComplexImageComponent', 'PHASE'),
    ('ContrastBolusAgent', 'Gadovist'), ('PatientID', 'another'), ('Modality', None)])
def test_several_images_in_one_series_are_refused(tmp_path, key, value):
    with pytest.raises(VolumeError, match=rf'{key} differs within the series: .*\(00.dcm\) and .*\(03.dcm\); these are several images'):
        load_volume(series(tmp_path / 's', setting(key, value)))


def test_two_sequences_in_one_series_are_refused_and_what_some_slices_leave_out_is_not(tmp_path):
    def change(dataset, n):
        dataset.SequenceName, dataset.ContrastBolusAgent = '*tfl3d1', ['GADOVIST', 'Gadovist '][n % 2]
        if n == 2:
            del dataset.SequenceName
            dataset.RepetitionTime = None
        elif n == 5 and two:
            dataset.SequenceName = '*se2d1'
    two = False
    assert load_volume(series(tmp_path / 'one', change)).warnings == ()
    two = True
    with pytest.raises(VolumeError, match='SequenceName differs within the series'):
        load_volume(series(tmp_path / 'two', change))


def test_patients_are_told_apart_without_their_names(tmp_path):
    with pytest.raises(VolumeError) as refusal:
        load_volume(series(tmp_path / 's', setting('PatientID', 'Mustermann')))
    assert 'PatientID differs within the series: one (00.dcm) and one (03.dcm)' in str(refusal.value) and '4MR1' not in str(refusal.value)


def test_what_scanners_round_and_leave_out_is_one_image(tmp_path):
    def change(dataset, n):
        dataset.RepetitionTime = [4000.0, 4000.04, 4000.4, 3999.96][n % 4]
        dataset.ContrastBolusAgent = ''
        if n > 3:
            del dataset.ContrastBolusAgent
    assert load_volume(series(tmp_path / 's', change)).warnings == ()
    assert load_volume(series(tmp_path / 'none', setting('RepetitionTime', None, range(SLICES)))).warnings == ()


@pytest.mark.parametrize('modality, refused', [('CT', True), ('PT', True), ('SEG', True), ('mr', False), ('OT', False), (None, False)])
def test_only_an_mr_is_an_mr(tmp_path, modality, refused):
    folder = series(tmp_path / 's', setting('Modality', modality, range(SLICES)))
    if refused:
        with pytest.raises(VolumeError, match=f'Modality of 00.dcm is {modality}, not MR; give the folder with the MR series$'):
            load_volume(folder)
    else:
        assert load_volume(folder).warnings == (() if modality == 'mr' else (f'Modality is {modality or "absent"}; taken as MR',))


@pytest.mark.parametrize('signed, high, raw_value, value, stray', [
    (0, 11, 1000 | 1 << 15, 1000, True),        # an overlay in the highest bit
    (0, 11, 1000, 1000, False), (1, 11, 1000, 1000, False),
    (1, 11, -490 & 0xfff, -490, False),         # its sign not extended
    (1, 11, -490 & 0xffff, -490, False), (1, 11, -490 & 0xfff | 1 << 15, -490, True),
    (0, 15, 1000 << 4, 1000, False), (0, 15, 1000 << 4 | 3, 1000, True), (1, 15, -490 << 4 & 0xffff, -490, False),
    (1, 13, -490 << 2 & 0xffff, -490, False)])
def test_only_the_stored_bits_count(tmp_path, signed, high, raw_value, value, stray):
    def change(dataset, n):
        dataset.BitsStored, dataset.HighBit, dataset.PixelRepresentation = 12, high, signed
        if n == 2:
            dataset.PixelData = np.full(SIZE * SIZE, raw_value, '<u2').tobytes()
            if stray and declared:
                dataset.add_new((0x6000, 0x0102), 'US', 15)
        else:
            dataset.PixelData = (voxels()[n].astype('<u2') << high - 11).tobytes()
    declared = False
    if stray:
        with pytest.raises(VolumeError, match='02.dcm: values need more bits than its BitsStored 12 says, and no overlay lies in them; export the'):
            load_volume(series(tmp_path / 'undeclared', change))
    declared = True
    volume = load_volume(series(tmp_path / 's', change))
    assert (volume.data[..., 2] == value).all() and np.array_equal(volume.data[..., 1], voxels()[1].T)
    assert volume.warnings == (('bits outside BitsStored are set and left out (an overlay?): 02.dcm',) if stray else ())


def test_whole_words_are_left_alone_and_bits_that_do_not_fit_are_refused(tmp_path):
    def change(dataset, _):
        dataset.PixelRepresentation = 0
        dataset.PixelData = np.r_[np.full(SIZE * SIZE - 1, 40000), 1].astype('<u2').tobytes()
    assert load_volume(series(tmp_path / 's', change)).data.max() == 40000
    with pytest.raises(VolumeError, match='00.dcm: BitsStored 12 with HighBit 16 do not fit into BitsAllocated 16; export the original series'):
        load_volume(series(tmp_path / 't', lambda dataset, _: (setattr(dataset, 'BitsStored', 12), setattr(dataset, 'HighBit', 16))))


@pytest.mark.parametrize('key, value', [('PixelSpacing', [3.0, 3.1]), ('ImageOrientationPatient', [0, 1, 0, 1, 0, 0]), ('Rows', 15)])
def test_slices_that_make_no_stack_are_refused(tmp_path, key, value):
    with pytest.raises(VolumeError, match=f'{key} of 03.dcm differs.*not one stack'):
        load_volume(series(tmp_path / 's', setting(key, value)))


@pytest.mark.parametrize('key, text', [('PixelSpacing', '3,0\\3,0'), ('ImagePositionPatient', '0\\0\\zero'), ('RescaleSlope', 'none'),
                                       ('EchoTime', '4,6'), ('ImageOrientationPatient', '1\\0\\0\\0\\1'), ('NumberOfFrames', 'one'),
                                       ('ImagePositionPatient', '0\\0\\1e999')])
def test_numbers_that_are_none_are_refused_by_name(tmp_path, key, text):
    def change(dataset, n):
        if n == 2:
            raw(dataset, key, text)
    with pytest.raises(VolumeError, match=rf'02.dcm: {key} is .*; export the original series') as refusal:
        load_volume(series(tmp_path / 's', change))
    assert text.split('\\')[-1] in str(refusal.value) or 'inf' in str(refusal.value)


@pytest.mark.parametrize('photometric', ['RGB', 'PALETTE COLOR', ''])
def test_colours_are_refused(tmp_path, photometric):
    with pytest.raises(VolumeError, match=f'PhotometricInterpretation of 00.dcm is "{photometric}"'):
        load_volume(series(tmp_path / 's', setting('PhotometricInterpretation', photometric, range(SLICES))))


def test_monochrome1_is_turned_over(tmp_path):
    volume = load_volume(series(tmp_path / 's', setting('PhotometricInterpretation', 'MONOCHROME1', range(SLICES))))
    assert np.array_equal(volume.data[..., 0], -1 - voxels()[0].T) and any('turned over' in note for note in volume.notes)


@pytest.mark.parametrize('slope, intercept', [(2.5, -10.0), (0.5, 0.0)])
def test_the_rescale_counts(tmp_path, slope, intercept):
    def change(dataset, _):
        dataset.RescaleSlope, dataset.RescaleIntercept = slope, intercept
    volume = load_volume(series(tmp_path / 's', change))
    assert np.allclose(volume.data[..., 1], voxels()[1].T * slope + intercept)


def test_a_slope_of_zero_is_refused(tmp_path):
    with pytest.raises(VolumeError, match='RescaleSlope of 04.dcm is 0'):
        load_volume(series(tmp_path / 's', setting('RescaleSlope', 0, [4])))


def test_missing_and_doubled_slices_are_named(tmp_path):
    gap = series(tmp_path / 'gap')
    os.remove(os.path.join(gap, '04.dcm'))
    with pytest.raises(VolumeError, match='uneven slices: 6.000 mm between 03.dcm and 05.dcm, usually 3.000 mm; a slice is missing there'):
        load_volume(gap)
    twice = series(tmp_path / 'twice')
    shutil.copy(os.path.join(twice, '04.dcm'), os.path.join(twice, '04_copy.dcm'))
    with pytest.raises(VolumeError, match='04.dcm and 04_copy.dcm lie at the same place: a doubled slice'):
        load_volume(twice)


@pytest.mark.parametrize('content, reason', [
    (b'notes of the scan', r'stray \(not DICOM\)'),
    (b'\0' * 128 + b'DICM' + b'\xff' * 40, r'stray \(damaged, noticed as \w+|stray \(DICOM without an image')], ids=['text', 'damaged'])
def test_other_files_are_set_aside_and_named(tmp_path, content, reason):
    folder = series(tmp_path / 's')
    with open(os.path.join(folder, 'stray'), 'wb') as file:
        file.write(content)
    volume = load_volume(folder)
    assert volume.data.shape[2] == SLICES
    assert any(re.search('1 file set aside: ' + reason, note) for note in volume.notes), volume.notes


def test_a_damaged_slice_in_the_middle_is_missed(tmp_path):
    folder = series(tmp_path / 's')
    with open(os.path.join(folder, '03.dcm'), 'r+b') as file:
        file.truncate(200)
    with pytest.raises(VolumeError, match='between 02.dcm and 04.dcm.*missing'):
        load_volume(folder)


def test_pixels_that_cannot_be_read_are_refused_without_the_words_of_a_library(tmp_path):
    with pytest.raises(VolumeError, match='05.dcm: the pixel data cannot be read: they are cut off, or compressed'):
        load_volume(series(tmp_path / 's', lambda d, n: n == 5 and setattr(d, 'PixelData', b'\0\0')))
