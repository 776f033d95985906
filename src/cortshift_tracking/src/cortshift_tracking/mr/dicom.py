"""DICOM series: LPS millimetres (PS3.3 C.7.6.2.1.1), oriented by the headers alone, checked for being one image.

Read by pydicom: Debian 12 has no SimpleITK.
"""
import math
import os
import warnings

import numpy as np
import pydicom

from cortshift_tracking.errors import VolumeError
from cortshift_tracking.mr.volume import AXES_FROM_RAS, volume_from_ras

SLICE_TOLERANCE = 0.01    # slices may deviate from even spacing by this share of the spacing
SAME_PLACE = 0.001        # slices that are closer lie at one place [mm]: DICOM's decimals do not tell them apart
#: What says where a slice lies, with its count of numbers; a series in which one differs is no stack.
GEOMETRY = {'Rows': 1, 'Columns': 1, 'PixelSpacing': 2, 'ImageOrientationPatient': 6}
GEOMETRY_TOLERANCE = 1e-4
#: What else every slice of one image has in common: words, and numbers as far as DICOM's decimals tell them apart.
SAME_WORDS = ('ImageType', 'PhotometricInterpretation', 'Modality', 'FrameOfReferenceUID', 'ComplexImageComponent', 'SequenceName',
              'ContrastBolusAgent', 'PatientID')
SAME_NUMBERS = ('EchoTime', 'EchoNumbers', 'InversionTime', 'FlipAngle', 'TemporalPositionIdentifier', 'DiffusionBValue')
SAME_ABOUT = {'RepetitionTime': 0.1}  # as far as scanners round and time: the share by which numbers of one image may lie apart
TYPED = ('ContrastBolusAgent',)  # by people: case and blanks tell nothing
LEFT_OUT = ('SequenceName',)  # by some programs in some slices: absence tells nothing
PRIVATE = ('PatientID',)  # never shown
UNSAID = ('', 'OT')  # Modality where a program did not know better: may be an MR
DECODED = ('1.2.840.10008.1.2.4.',)  # beginning of the syntaxes whose decoders give the stored bits alone
GREY = ('MONOCHROME2', 'MONOCHROME1')


def load_dicom(path, axes='RAS', series=None):
    """Load a DICOM series: a folder (not searched below) or a single file.

    series: SeriesInstanceUID (or its end) to take where the folder holds several.
    Files that are no images are set aside and named in the notes. Raises VolumeError naming file, element and remedy.
    """
    files = sorted(os.path.join(path, name) for name in os.listdir(path)) if os.path.isdir(path) else [path]
    slices, aside = {}, []
    for file in files:
        if os.path.isfile(file):
            slice_, reason = _read(file)
            if slice_ is None:
                aside.append(f'{os.path.basename(file)} ({reason})')
            else:
                slices.setdefault(slice_.text('SeriesInstanceUID'), []).append(slice_)
    if not slices:
        raise VolumeError(f'{path}: no DICOM image found' + (f'; set aside: {_listing(aside)}' if aside else '')
                          + '; give a folder with one series, or a NIfTI file')
    members = _one_series(path, slices, series)
    for slice_ in members:
        slice_.check(path)
    _check_alike(path, members)
    members, step, doubts = _sorted_slices(path, members)
    data = np.stack([slice_.pixels() for slice_ in members], axis=-1)
    doubts += _doubts(members)
    notes = ['MONOCHROME1 (bright is stored low): turned over'] if members[0].text('PhotometricInterpretation') == 'MONOCHROME1' else []
    if aside:
        doubts.append(f'{len(aside)} file{"s" if len(aside) > 1 else ""} set aside: {_listing(aside)}')
    row, column = members[0].directions()
    spacing = members[0].numbers('PixelSpacing', 2)  # between rows, between columns
    affine_lps = np.eye(4)
    affine_lps[:3, :3] = np.column_stack([row * spacing[1], column * spacing[0], step]) * 0.001
    affine_lps[:3, 3] = np.array(members[0].numbers('ImagePositionPatient', 3)) * 0.001
    return volume_from_ras(data, np.linalg.inv(AXES_FROM_RAS['LPS']) @ affine_lps, axes, path, notes, doubts)


def _listing(names, most=5):
    return '; '.join(names[:most]) + (f' and {len(names) - most} more' if len(names) > most else '')


def _read(file):
    """(Slice, '') of a file, or (None, reason) where it is no image."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            dataset = pydicom.dcmread(file)
            if 'PixelData' in dataset:
                return Slice(file, dataset), ''
            return None, 'DICOM without an image'
    except pydicom.errors.InvalidDicomError:
        return None, 'not DICOM'
    except Exception as error:  # on damaged bytes pydicom raises whatever its parts raise; all mean the same here
        return None, f'damaged, noticed as {type(error).__name__}'


class Slice:
    """One file of a series; what cannot be read of it is refused by the element's name."""

    def __init__(self, file, dataset):
        self.file, self.name, self._dataset = file, os.path.basename(file), dataset
        self.stray = False  # whether pixels() left out what does not belong to the values

    def _value(self, key):
        """The element, None where it is absent or empty."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')
                value = self._dataset.get(key)
        except Exception as error:  # a word where a number belongs, bytes that are no text
            raise VolumeError(f'{self.file}: {key} is {self._raw(key)}, which cannot be read; export the original series') from error
        return None if value is None or value == '' or isinstance(value, pydicom.multival.MultiValue) and not len(value) else value

    def _raw(self, key):
        try:
            value = self._dataset.get_item(key).value
            return repr(value.decode('ascii', 'replace').strip() if isinstance(value, bytes) else str(value))
        except Exception:  # it is named all the same
            return 'damaged'

    def text(self, key):
        value = self._value(key)
        return '' if value is None else '\\'.join(map(str, value)) if isinstance(value, pydicom.multival.MultiValue) else str(value)

    def numbers(self, key, count):
        """Finite numbers of an element, None where it is absent."""
        value = self._value(key)
        if value is None:
            return None
        parts = list(value) if isinstance(value, pydicom.multival.MultiValue) else [value]
        try:
            numbers = [float(part) for part in parts]
        except (TypeError, ValueError):
            numbers = []
        if len(numbers) != count or not all(map(math.isfinite, numbers)):
            wanted = 'a number' if count == 1 else f'{count} numbers'
            raise VolumeError(f'{self.file}: {key} is {self._raw(key)}, not {wanted} with decimal points; export the original series')
        return numbers

    def number(self, key, absent=None):
        value = self.numbers(key, 1)
        return absent if value is None else value[0]

    def rounded(self, key):
        """A number as text that is the same for what DICOM's decimals do not tell apart; '' where it is absent."""
        value = self.number(key)
        return '' if value is None else f'{value:.5g}'

    def check(self, path):
        """Whether it is a grey slice of a known place."""
        if self.number('NumberOfFrames', 1) != 1:
            raise VolumeError(f'{path}: {self.name} is a multi-frame image; export it as single slices or as NIfTI')
        if 'MOSAIC' in self.text('ImageType').split('\\'):
            raise VolumeError(f'{path}: {self.name} is a mosaic of slices; convert it to NIfTI')
        if self.number('SamplesPerPixel', 1) != 1:
            raise VolumeError(f'{path}: {self.name} is a colour image; give the MR series itself')
        modality = self.text('Modality').upper()
        if modality not in ('MR', *UNSAID):
            raise VolumeError(f'{path}: Modality of {self.name} is {modality}, not MR; give the folder with the MR series')
        photometric = self.text('PhotometricInterpretation')
        if photometric not in GREY:
            raise VolumeError(f'{path}: PhotometricInterpretation of {self.name} is "{photometric}", not MONOCHROME2 or MONOCHROME1; give '
                              'the MR series itself')
        for key, count in dict(GEOMETRY, ImagePositionPatient=3).items():
            if self.numbers(key, count) is None:
                raise VolumeError(f'{path}: {self.name} has no usable {key}, so its place in the head is unknown; export the '
                                  'original series')
        if min(self.numbers('PixelSpacing', 2)) <= 0:
            raise VolumeError(f'{path}: {self.name} has PixelSpacing {self.text("PixelSpacing")}; export the original series')
        if self.number('RescaleSlope', 1) == 0:
            raise VolumeError(f'{path}: RescaleSlope of {self.name} is 0, which leaves nothing of the image; export the original series')
        self.number('RescaleIntercept')
        self.directions()

    def directions(self):
        """Unit vectors along the rows and down the columns, LPS."""
        orientation = np.array(self.numbers('ImageOrientationPatient', 6))
        row, column = orientation[:3], orientation[3:]
        lengths = np.linalg.norm(row), np.linalg.norm(column)
        if abs(lengths[0] - 1) > 1e-2 or abs(lengths[1] - 1) > 1e-2 or abs(row @ column) > 1e-2:
            raise VolumeError(f'{self.file}: ImageOrientationPatient {list(orientation)} is not two perpendicular unit vectors; export '
                              'the original series')
        return row / lengths[0], column / lengths[1]

    def position(self):
        return np.array(self.numbers('ImagePositionPatient', 3))

    def pixels(self):
        """(columns, rows) float32 after the modality rescale; bright is high."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')
                pixels = self._dataset.pixel_array
        except Exception as error:  # pydicom's decoders raise many types; all mean the same here
            raise VolumeError(f'{self.file}: the pixel data cannot be read: they are cut off, or compressed in a way that is not '
                              f'known here ({self._syntax()}); export them uncompressed') from error
        pixels = self._stored(pixels).astype(np.float32)
        if self.text('PhotometricInterpretation') == 'MONOCHROME1':
            signed = self.number('PixelRepresentation', 0) == 1
            pixels = (-1 if signed else 2 ** self.number('BitsStored', 16) - 1) - pixels
        return (pixels * np.float32(self.number('RescaleSlope', 1)) + np.float32(self.number('RescaleIntercept', 0))).T

    def _stored(self, pixels):
        """(rows, columns) values of the stored bits alone (PS3.5 8.1.1); overlays may lie above and below them, which pydicom keeps.

        pixels: (rows, columns) whole numbers of BitsAllocated.
        """
        allocated = int(self.number('BitsAllocated'))
        stored = int(self.number('BitsStored', allocated))
        high = int(self.number('HighBit', stored - 1))
        if stored == allocated or str(self._transfer_syntax()).startswith(DECODED):
            return pixels
        if not 1 <= stored <= high + 1 <= allocated <= 32:
            raise VolumeError(f'{self.file}: BitsStored {stored} with HighBit {high} do not fit into BitsAllocated {allocated}; export the '
                              'original series')
        bits = pixels.astype(np.int64)
        field = bits >> high + 1 - stored & (1 << stored) - 1
        values = field - (field >> stored - 1 << stored) if self.number('PixelRepresentation', 0) == 1 else field
        whole = (1 << allocated) - 1
        kept = [(known << high + 1 - stored) & whole for known in (field, values)]  # without, and with an extended sign
        self.stray = bool(((bits & whole != kept[0]) & (bits & whole != kept[1])).any())
        if self.stray and not self._overlaid():
            raise VolumeError(f'{self.file}: values need more bits than its BitsStored {stored} says, and no overlay lies in them; export the '
                              'original series')
        return values

    def _overlaid(self):
        """Whether an overlay lies in the bits of the pixels (PS3.3 C.9.2: OverlayBitPosition; retired, and still met)."""
        return any(group & 0xff00 == 0x6000 and element == 0x0102 and self._dataset[group, element].value
                   for group, element in ((tag.group, tag.element) for tag in self._dataset.keys()))

    def _transfer_syntax(self):
        return getattr(getattr(self._dataset, 'file_meta', None), 'TransferSyntaxUID', None)

    def _syntax(self):
        syntax = self._transfer_syntax()
        return 'no transfer syntax' if syntax is None else syntax.name


def _one_series(path, slices, series):
    if series is not None:
        slices = {uid: members for uid, members in slices.items() if uid.endswith(series)}
        if not slices:
            raise VolumeError(f'{path}: no series ends in "{series}"')
    if len(slices) > 1:
        listing = '; '.join(f'{uid[-24:] or "without SeriesInstanceUID"} "{members[0].text("SeriesDescription")}" ({len(members)} images)'
                            for uid, members in sorted(slices.items()))
        raise VolumeError(f'{path}: holds {len(slices)} series; name one by the end of its UID (--series): {listing}')
    return next(iter(slices.values()))


def _check_alike(path, members):
    """Whether all are slices of one image: one size and orientation, one echo, one kind of picture."""
    first = members[0]
    for key, count in GEOMETRY.items():
        for slice_ in members[1:]:
            if not np.allclose(slice_.numbers(key, count), first.numbers(key, count), rtol=0, atol=GEOMETRY_TOLERANCE):
                raise VolumeError(f'{path}: {key} of {slice_.name} differs from that of {first.name}: not one stack of parallel '
                                  'slices (a localiser or rotated projections?); choose another series')
    for key in SAME_WORDS:
        told = [(' '.join(slice_.text(key).casefold().split()) if key in TYPED else slice_.text(key), slice_.name) for slice_ in members]
        _check_one_kind(path, key, [(text, name) for text, name in told if text or key not in LEFT_OUT])
    for key in SAME_NUMBERS:
        _check_one_kind(path, key, [(slice_.rounded(key), slice_.name) for slice_ in members])
    for key, share in SAME_ABOUT.items():
        grouped = zip(_grouped(members, key, share), members)
        _check_one_kind(path, key, [(value, slice_.name) for value, slice_ in grouped if value])   # where it is absent nothing is known
    for key in ('RescaleSlope', 'RescaleIntercept'):
        _check_one_kind(path, key, [('' if slice_.number(key) is None else 'a number', slice_.name) for slice_ in members])


def _grouped(members, key, share):
    """A number of each slice as text, '' where it is absent; the same for all that lie within a share above the least of them."""
    numbers = [slice_.number(key) for slice_ in members]
    begins = []
    for number in sorted({number for number in numbers if number is not None}):
        if not begins or number > begins[-1] * (1 + share):
            begins.append(number)
    return ['' if number is None else f'{max(begin for begin in begins if begin <= number):.5g}' for number in numbers]


def _doubts(members):
    """Warnings of the slices, after their pixels are read."""
    stray = [slice_.name for slice_ in members if slice_.stray]
    doubts = [f'bits outside BitsStored are set and left out (an overlay?): {_listing(stray)}'] if stray else []
    modality = members[0].text('Modality').upper()
    return doubts + ([f'Modality is {modality or "absent"}; taken as MR'] if modality in UNSAID else [])


def _check_one_kind(path, key, told):
    """told: (value, file) of each slice."""
    first = dict(reversed(told))  # value: first file that has it
    if len(first) > 1:
        two = sorted(first.items(), key=lambda entry: entry[1])[:2]
        several = ' and '.join(f'{"one" if value and key in PRIVATE else value or "none"} ({name})' for value, name in two)
        raise VolumeError(f'{path}: {key} differs within the series: {several}; these are several images, export one of them alone')


def _sorted_slices(path, members):
    """Slices by position along their normal (never by file name or instance number), the step between them [mm], and warnings."""
    normal = np.cross(*members[0].directions())
    members = sorted(members, key=lambda slice_: normal @ slice_.position())
    if len(members) == 1:
        thickness = members[0].number('SpacingBetweenSlices') or members[0].number('SliceThickness')
        if not thickness or not thickness > 0:
            raise VolumeError(f'{path}: a single slice without SliceThickness; give the whole series')
        return members, normal * thickness, ['a single slice; its thickness is taken as the spacing']
    positions = np.array([slice_.position() for slice_ in members])
    steps = np.diff(positions, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if lengths.min() < SAME_PLACE:
        n = int(lengths.argmin())
        raise VolumeError(f'{path}: {members[n].name} and {members[n + 1].name} lie at the same place: a doubled slice, or images of '
                          'several times or contrasts; give one series of one time and contrast')
    typical = np.median(lengths)
    step = (positions[-1] - positions[0]) / (len(members) - 1)
    if np.linalg.norm(steps - step, axis=1).max() > SLICE_TOLERANCE * typical + SAME_PLACE:
        n = int(np.linalg.norm(steps - np.median(steps, axis=0), axis=1).argmax())
        raise VolumeError(f'{path}: uneven slices: {lengths[n]:.3f} mm between {members[n].name} and {members[n + 1].name}, usually '
                          f'{typical:.3f} mm; {"a slice is missing there" if lengths[n] > typical else "one is doubled or moved"}, export '
                          'the whole series')
    return members, step, []
