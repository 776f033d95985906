"""Readers of foreign bytes in Python, by hypothesis: whatever the bytes are, they are read or refused with a reason. script/fuzz runs it.

CORTSHIFT_FUZZ_SECONDS: for all of them together; hypothesis keeps what it found in .hypothesis of the current folder."""
import gzip
import json
import os
import pathlib
import sys
import tempfile
import time

import cv2
import hypothesis
import nibabel
import numpy as np
import pytest
from cortshift_tracking.cohort.sheet import read_sheet
from cortshift_tracking.deidentify.pictures import pixels_only
from cortshift_tracking.errors import CortshiftError
from cortshift_tracking.mr.reader import load_volume
from cortshift_tracking.probe.store import read_points
from cortshift_tracking.report.picks import read_picks
from cortshift_tracking.texts import read_table, read_yaml
from hypothesis import strategies as st

SUPPORT = pathlib.Path(__file__).resolve().parents[1] / 'test/support'
sys.path[:0] = [str(SUPPORT), str(SUPPORT / 'mr')]
import dicom_series  # noqa: E402

SECONDS = float(os.environ.get('CORTSHIFT_FUZZ_SECONDS', '10'))
EXAMPLES = 200    # between looks at the clock
POINTS = {'format': 'cortshift probe points, version 1', 'unit': 'm', 'frame': 'pmr', 'points': [
    {'stage': 's', 'label': 'p', 'stamp': [1700000000, 5], 'position': [0.1, 0.2, 0.3], 'spread': 0.001, 'samples': 20}]}


def nifti():
    image = nibabel.Nifti1Image(np.arange(60, dtype=np.int16).reshape(3, 4, 5), np.diag([10.0, 11, 12, 1]))
    image.header.set_xyzt_units('mm')
    image.set_sform(image.affine, 1)
    image.set_qform(image.affine, 1)
    return image.to_bytes()


def dicom():
    with tempfile.TemporaryDirectory() as folder:
        return pathlib.Path(dicom_series.series(os.path.join(folder, 's')), '00.dcm').read_bytes()


def picture(ending):
    return cv2.imencode(ending, np.arange(75, dtype=np.uint8).reshape(5, 5, 3))[1].tobytes()


#: Name of the file, a good one, and the reader.
READERS = {
    'nifti': ('a.nii', nifti, load_volume),
    'nifti_gz': ('a.nii.gz', lambda: gzip.compress(nifti()), load_volume),
    'dicom': ('a.dcm', dicom, load_volume),
    'table': ('a.csv', lambda: b'a;b;c\n1,5;2;3\n"x";y;z\n', read_table),
    'picks': ('picks.csv', lambda: b'stage,label,column_px,row_px\ns,p,1.5,2\n', read_picks),
    'sheet': ('sheet.csv', lambda: b'case,bag,stages,calibration\none,a.bag,s@1 t@2,\n', read_sheet),
    'points': ('probe_points.json', lambda: json.dumps(POINTS).encode(), lambda path: read_points(os.path.dirname(path))),
    'yaml': ('a.yaml', lambda: b'date: 2024-01-02\nrms: 0.2\nviews: [{name: a, rms: 1}]\nK: &k [1, 2]\nL: *k\n', read_yaml),
    'png': ('a.png', lambda: picture('.png'), lambda path: pixels_only(pathlib.Path(path).read_bytes())),
    'jpeg': ('a.jpg', lambda: picture('.jpg'), lambda path: pixels_only(pathlib.Path(path).read_bytes())),
}


@st.composite
def changed(draw, good):
    """The good bytes with some of them replaced, taken out or put in; or any bytes."""
    data = bytearray(good)
    for _ in range(draw(st.integers(0, 4))):
        place, length = draw(st.integers(0, len(data))), draw(st.integers(0, 8))
        data[place:place + length] = draw(st.one_of(st.binary(min_size=length, max_size=length), st.binary(max_size=16),
                                                    st.sampled_from([b'\xff' * 4, b'\0' * 4, b'nan', b'1e999', b'-1', b'\xef\xbb\xbf'])))
    if draw(st.integers(0, 9)) == 0:
        del data[draw(st.integers(0, len(data))):]
    return bytes(data)


@pytest.mark.parametrize('name', READERS)
def check_read_or_refused(name, tmp_path):
    file, good, read = READERS[name]
    content, path = good(), tmp_path / file
    path.write_bytes(content)
    read(str(path))   # the good one is good

    @hypothesis.settings(max_examples=EXAMPLES, deadline=None, database=None, suppress_health_check=list(hypothesis.HealthCheck))
    @hypothesis.given(changed(content))
    def any_bytes(data):
        path.write_bytes(data)
        try:
            read(str(path))
        except CortshiftError as error:
            assert len(str(error)) > 10   # with its reason

    end, rounds = time.monotonic() + SECONDS / len(READERS), 0
    while time.monotonic() < end:
        hypothesis.seed(rounds)(any_bytes)()
        rounds += 1
    print(f'{name}: {rounds * EXAMPLES} inputs')
