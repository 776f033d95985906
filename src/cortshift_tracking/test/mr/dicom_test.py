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
    ('FrameOfReferenceUID', '1.2.3.4')])
def test_several_images_in_one_series_are_refused(tmp_path, key, value):
    with pytest.raises(VolumeError, match=rf'{key} differs within the series: .*\(00.dcm\) and .*\(03.dcm\); these are several images'):
        load_volume(series(tmp_path / 's', setting(key, value)))


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
