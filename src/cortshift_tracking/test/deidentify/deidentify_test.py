"""script/deidentify: nothing of names and dates is left in any byte, and the numbers are the same."""
import csv
import glob
import gzip
import json
import os
import pathlib
import re
import shutil
import subprocess
import zlib

import cv2
import nibabel
import numpy as np
import planting
import pydicom
import pytest
import recorded_cases as cases
import rosbag
import rospy
from cortshift_tracking.case.folder import read_case
from cortshift_tracking.deidentify import pictures, words
from cortshift_tracking.deidentify.case import deidentify
from cortshift_tracking.errors import CaseError
from cortshift_tracking.mr.reader import load_volume
from cortshift_tracking.report.picks import read_picks
from cortshift_tracking.report.tables import table_2, table_3
from dicom_series import series
from offline_tools import ROOT, run_tool
from std_msgs.msg import String

FIRST, SECOND = f'opening_{planting.NAME}', 'after_1957'   # keys may name somebody, too
SECRETS = (planting.NAME, planting.PLACE, planting.DATE, '19570412', '1957', 'tumour_left', '2023-11', '17000000')
YEAR_2000 = 946684800
NIFTI = ('descrip', 'aux_file', 'db_name', 'intent_name')


@pytest.fixture(scope='module')
def plain(tmp_path_factory):
    """What process_bag makes of a small recording, with everything that may lie beside it; nothing planted."""
    folder = tmp_path_factory.mktemp('case')
    bag, _ = cases.record(str(folder), 'case')
    case = folder / 'out'
    first, second = (f'{key}@{capture.split("@")[1]}' for key, capture in zip((FIRST, SECOND), cases.CAPTURES))
    run_tool('process_bag', bag, '--capture', first, second, '--shift', f'{FIRST}:{SECOND}', '--output', case, '--config', cases.CONFIG)
    places = {stage.key: stage.points[120, 150:180:10].mean(0) for stage in read_case(str(case)).stages}
    stamp = [1700000007, 250000000]
    points = [{'stage': key, 'label': 'tumour_left', 'stamp': stamp, 'position': list(map(float, place)), 'spread': 0.0002, 'samples': 20}
              for key, place in places.items()]
    points += [{'stage': '', 'label': f'gravity_{name}', 'stamp': stamp, 'position': [0.0, 0.0, height], 'spread': 0.0, 'samples': 20}
               for name, height in (('upper', 0.2), ('lower', 0.1))]
    (case / 'probe_points.json').write_text(json.dumps(
        {'format': 'cortshift probe points, version 1', 'unit': 'm', 'frame': 'pmr', 'points': points}))
    (case / 'picks.csv').write_text('stage,label,column_px,row_px\n' + ''.join(f'{key},tumour_left,160.5,120.5\n' for key in places))
    with rosbag.Bag(glob.glob(f'{case}/stages/0001*')[0]) as stage:
        (_, info, _), = stage.read_messages('/stage/info')
    square = [[[0.0, 0.0], [0.002, 0.0], [0.002, 0.002], [0.0, 0.002]]]
    (case / 'stages/case_state.json').write_text(json.dumps({
        'format': 'cortshift case state, version 1', 'unit': 'm',
        'gravity': {'direction_pmr': [0.0, 0.0, -1.0], 'source': 'the service set_gravity, kept with the case'},
        'excluded': {FIRST: {'stamp': [info.stamp.secs, info.stamp.nsecs], 'regions': square}}, 'outlines': {},
        'live': {'from': FIRST, 'stamp': [info.stamp.secs, info.stamp.nsecs], 'run': planting.NAME}}))
    image = nibabel.Nifti1Image(np.arange(60 ** 3, dtype=np.int16).reshape(60, 60, 60), np.diag([3.1, 3.2, 3.3, 1]))
    image.header.set_xyzt_units('mm')
    image.set_qform(image.affine, 1)
    image.set_sform(image.affine, 1)
    nibabel.save(image, str(case / 'pmr.nii'))
    return case


@pytest.fixture(scope='module')
def planted(plain, tmp_path_factory):
    """The same with names and dates wherever a case can hold them."""
    case = tmp_path_factory.mktemp('planted') / planting.NAME
    shutil.copytree(plain, case)
    text = f'{planting.NAME} {planting.PLACE} {planting.DATE} 19570412'

    def change(topic, message, time):
        planting.plant(message, text)
        if topic.endswith('/compressed'):
            message.data = planting.png_with_text(bytes(message.data), text)
        return topic, message, time

    for path in glob.glob(f'{case}/stages/*.bag') + glob.glob(f'{case}/*.bag'):
        extra = [('/rosout_agg', String(text), rospy.Time(1700000009)), ('/patient', String(text), rospy.Time(1700000010))]
        planting.rewritten(path, change, extra)
    state = json.loads((case / 'stages/case_state.json').read_text())
    state['gravity']['source'], state[planting.NAME] = text, text
    (case / 'stages/case_state.json').write_text(json.dumps(state))
    (case / 'case_log.txt').write_text(f'2023-11-14T22:13:20Z deleted stage \'x\' asked by /{planting.NAME}\n')
    (case / f'{planting.NAME}.yaml').write_text(
        f'date: 1957-04-12T10:00:00Z\ndevice: {text}\npatient: 19570412\nreprojection_rms_px: 0.21\ncamera_name: {text}\n'
        f'views:\n  - {{name: "{planting.NAME}.png", reprojection_rms_px: 0.2}}\nverdict: good\nreasons: [{planting.NAME}]\n'
        f'image_width: 320\n{planting.NAME}: 4\nD: [0.1, 19570412]\n')
    for name in ('report.html', 'table_2.csv', 'table_3.csv', 'notes.txt', 'report.pdf'):
        (case / name).write_text(text)
    (case / 'deleted').mkdir()
    shutil.copy(case / 'notes.txt', case / 'deleted/0003_x_00000000.bag')
    with open(case / 'summary.csv') as file:
        rows = list(csv.reader(file))
    rows[0].append(planting.NAME)
    rows[1].append(text)
    for column in ('warnings', 'outline', 'surround'):
        rows[1][rows[0].index(column)] += f' | {text}'
    with open(case / 'summary.csv', 'w') as file:
        csv.writer(file).writerows(rows)
    image = nibabel.load(str(case / 'pmr.nii'), mmap=False)   # it is written to the same file
    for key in NIFTI:
        image.header[key] = planting.NAME
    image.header.extensions.append(nibabel.nifti1.Nifti1Extension('comment', text.encode()))
    nibabel.save(image, str(case / 'pmr.nii'))
    return case


@pytest.fixture(scope='module')
def handed_on(planted, tmp_path_factory):
    out = tmp_path_factory.mktemp('handed') / 'on'
    before = {path: pathlib.Path(path).read_bytes() for path in planting.files_below(str(planted))}
    done = subprocess.run([ROOT / 'script/deidentify', planted, out], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert before == {path: pathlib.Path(path).read_bytes() for path in planting.files_below(str(planted))}   # the case is untouched
    return out, done.stdout


def test_what_is_planted_can_be_found(planted):
    """The search sees into chunks and compressed files, or its silence would prove nothing."""
    hits = planting.found(str(planted), *SECRETS)
    for ending in ('.bag', '.nii', '.yaml', '.json', '.csv', '.txt', '.html'):
        assert any(path.endswith(ending) for path, _ in hits), ending
    assert {secret for _, secret in hits} == set(SECRETS)
    stage, = (path for path in planting.files_below(str(planted)) if '/0001_' in path)
    assert planting.NAME.encode() not in pathlib.Path(stage).read_bytes().split(b'op=\x05')[1][200:2000]   # it is compressed
    assert planting.bytes_of(stage).count(planting.NAME.encode()) > 15


def test_nothing_of_it_is_left(handed_on):
    out, said = handed_on
    assert planting.found(str(out), *SECRETS) == []
    seconds = [number.to_bytes(4, 'little') for number in (1700000005, 1700000007, 1700000012)]
    assert planting.found(str(out), *seconds) == []
    assert 'left out: case_log.txt' in said and 'left out: deleted' in said and '/patient' in said
    assert f'stage {FIRST} is stage_1 (for you alone)' in said and 'shows the face' in said
    assert 'stage_1' not in planting.NAME and not any('.part' in path for path in planting.files_below(str(out)))


def test_every_time_is_shifted_alike(plain, handed_on):
    """Each stamp of a message and of its record lies as far from the first stage as before."""
    def times(folder):
        stamps = []
        for path in sorted(glob.glob(f'{folder}/stages/*.bag')) + glob.glob(f'{folder}/*.bag'):
            with rosbag.Bag(path) as bag:
                for topic, message, time in bag.read_messages():
                    stamps += [(topic, t.secs, t.nsecs) for t in [time, *planting.stamps_of(message)]]
        return stamps
    before, after = times(plain), times(handed_on[0])
    assert len(before) == len(after) > 30
    shift = before[0][1] - after[0][1]
    assert [(topic, secs - shift if secs else 0, nsecs) for topic, secs, nsecs in before] == after
    assert all(not secs or abs(secs - YEAR_2000) < 60 for _, secs, _ in after)
    points = json.loads((handed_on[0] / 'probe_points.json').read_text())['points']
    state = json.loads((handed_on[0] / 'stages/case_state.json').read_text())
    assert points[0]['stamp'] == [1700000007 - shift, 250000000]
    assert state['excluded']['stage_1']['stamp'][0] == YEAR_2000


def renamed(text):
    return text.replace(FIRST, 'stage_1').replace(SECOND, 'stage_2')


def test_recomputing_gives_the_same_numbers(plain, handed_on):
    def table(folder):
        said, _ = run_tool('recompute', folder, '--config', cases.CONFIG)
        lines = [re.sub(r'_[0-9a-f]{8}\.bag', '', renamed(line)) for line in said.splitlines()]
        return [' '.join(line.split()) for line in lines if 'configuration' not in line and 'withheld' not in line]
    before, after = table(plain), table(handed_on[0])
    assert before == after and len(before) > 5 and any(line.startswith('shift stage_1 to stage_2') for line in after)


def test_the_report_gives_the_same_numbers(plain, handed_on, tmp_path):
    def tables(folder):
        case = read_case(str(folder))
        left_out = []
        assert not case.left_out
        return table_2(case, read_picks(str(folder / 'picks.csv'))[0], left_out), table_3(case)
    (second, third), (second_now, third_now) = tables(plain), tables(handed_on[0])
    assert len(third_now) == 1 and len(second_now) >= 1

    def same(a, b):
        rename = {'tumour_left': 'point_1'}
        numbers = ([[str(cell) for cell in row if not isinstance(cell, str)] for row in table] for table in (a, b))   # NaN is none
        names = ([rename.get(cell, renamed(cell)) for row in table for cell in row if isinstance(cell, str)] for table in (a, b))
        remarks = [now for was, now in zip(*names) if was != now]
        return len(set(map(str, numbers))) == 1 and all(remark == words.WITHHELD for remark in remarks)
    assert same(second, second_now) and same(third, third_now)
    copy = shutil.copytree(handed_on[0], tmp_path / 'copy')
    run_tool('case_report', copy, '--no-pdf')
    page = re.sub('data:image/[^"]*', '', (copy / 'report.html').read_text())   # four digits are in any long picture by chance
    assert '2000-01-01 00:00:00 UTC' in page and 'there is a remark here, withheld' in page
    assert not any(secret in page for secret in SECRETS)


def test_files_beside_the_bags(plain, handed_on):
    out = handed_on[0]
    assert sorted(os.listdir(out)) == ['calibration_1.yaml', 'deidentified.txt', 'picks.csv', 'pmr.nii.gz', 'probe_points.json',
                                       'stage_1__stage_2.bag', 'stages', 'summary.csv']
    was, now = (list(csv.DictReader((folder / 'summary.csv').read_text().splitlines())) for folder in (plain, out))
    numbers = [name for name in was[0] if name not in ('from_key', 'to_key', 'warnings', 'outline', 'surround')]
    assert [now[0][name] for name in numbers] == [was[0][name] for name in numbers]
    assert now[0]['outline'].startswith(was[0]['outline']) and now[0]['outline'].endswith(words.WITHHELD)
    assert (out / 'picks.csv').read_text().splitlines()[1] == 'stage_1,point_1,160.5,120.5'
    calibration = (out / 'calibration_1.yaml').read_text()
    assert 'reprojection_rms_px: 0.21' in calibration and 'verdict: good' in calibration and 'image_width: 320' in calibration
    assert re.search(r"date: '?1933-", calibration)   # shifted as far as all the rest
    name, = glob.glob(f'{out}/stages/0001_stage_1_*.bag')
    assert int(name[-12:-4], 16) == zlib.crc32(pathlib.Path(name).read_bytes())


def test_the_mr_keeps_its_geometry_alone(plain, handed_on):
    before, after = load_volume(plain / 'pmr.nii'), load_volume(handed_on[0] / 'pmr.nii.gz')
    assert np.array_equal(before.data, after.data) and np.allclose(before.T_pmr_voxel, after.T_pmr_voxel, rtol=0, atol=1e-9)
    header = nibabel.load(str(handed_on[0] / 'pmr.nii.gz')).header
    assert all(not bytes(header[key]).strip(b'\0') for key in NIFTI) and not header.extensions
    assert gzip.open(handed_on[0] / 'pmr.nii.gz').read(352)[348:] == bytes(4)


def test_a_dicom_series_becomes_one(plain, tmp_path):
    def named(dataset, _):
        dataset.PatientName, dataset.PatientBirthDate, dataset.InstitutionName = planting.NAME, '19570412', planting.PLACE
    folder = series(tmp_path / 'mr', named)
    assert pydicom.dcmread(f'{folder}/00.dcm').PatientName == planting.NAME
    run_tool('deidentify', plain, tmp_path / 'out', '--mr', folder)
    assert planting.found(str(tmp_path / 'out'), *SECRETS) == []
    before, after = load_volume(folder), load_volume(tmp_path / 'out/pmr.nii.gz')
    assert np.array_equal(before.data, after.data) and np.allclose(before.T_pmr_voxel, after.T_pmr_voxel, rtol=0, atol=1e-9)


def test_keys_stay_where_they_name_nobody(plain, tmp_path):
    deidentify(str(plain), str(tmp_path / 'out'), keep_keys=True)
    case = read_case(str(tmp_path / 'out'))
    assert [stage.key for stage in case.stages] == [FIRST, SECOND] and case.points[0].label == 'tumour_left'


@pytest.mark.parametrize('ending', ['.png', '.jpg'])
def test_pictures_keep_their_pixels_alone(ending):
    random = np.random.default_rng(3)
    data = cv2.imencode(ending, random.integers(0, 255, (40, 60, 3), np.uint8))[1].tobytes()
    put = planting.png_with_text if ending == '.png' else planting.jpeg_with_text
    dirty = put(data, planting.NAME)
    clean = pictures.pixels_only(dirty)
    decoded = [cv2.imdecode(np.frombuffer(d, np.uint8), cv2.IMREAD_UNCHANGED) for d in (dirty, clean)]
    assert planting.NAME.encode() in dirty and planting.NAME.encode() not in clean and np.array_equal(*decoded)
    for cut in (len(clean) // 2, 20, 3):
        with pytest.raises(CaseError, match='cut or damaged'):
            pictures.pixels_only(clean[:cut] if cut > 10 else clean[:10])
    with pytest.raises(CaseError, match='neither PNG nor JPEG'):
        pictures.pixels_only(b'BM' + bytes(100))


@pytest.mark.parametrize('text, stays', [
    ('proposed by relief and colour', True),
    ('not known: bone stands up around the brain on only 12 % of the way around', True),
    ('not known: an edge of the craniotomy is in view on only 46 % of the way around', True),
    ('not known: colours differ at the edge of bone on only 9 % of the way around', True),
    ('not known: relief and colours agree on an edge on only 70 % of the way around', True), ('what does not move agrees with tracking to 0.01 mm on 7.2 cm2', True),
    ('corrected by 0.31 mm and 0.05 deg, which what does not move seemed to move on 6.9 cm2', True),
    ('tracking: what should not move moved by 0.31 mm and 0.05 deg on 5.0 cm2; not corrected (surround: check)', True),
    ('configured; the surround knows it better', True), ('residuals of its calibration file', True), ('', True),
    ('proposed by Mustermann', False), ('drawn on 1957', False), ('moved 12.04.1957', False), ('place 19570412', False),
    ('drawn by hand, Łuk', False)])
def test_sentences_of_the_software_stay(text, stays):
    assert words.sentence(text) == (text if stays else words.WITHHELD)


def test_what_cannot_be_handed_on_is_refused(plain, tmp_path):
    with pytest.raises(CaseError, match='exists already; nothing is overwritten'):
        deidentify(str(plain), str(plain))
    with pytest.raises(CaseError, match='lies in the case itself'):
        deidentify(str(plain), str(plain / 'stages/new'))
    with pytest.raises(CaseError, match='no such folder'):
        deidentify(str(tmp_path / 'none'), str(tmp_path / 'out'))
    (tmp_path / 'empty').mkdir()
    with pytest.raises(CaseError, match='holds no stage'):
        deidentify(str(tmp_path / 'empty'), str(tmp_path / 'out'))
    assert os.listdir(tmp_path) == ['empty']   # nothing half done stays


def test_a_stamp_of_another_clock_is_left_out_with_its_file(plain, tmp_path):
    """Shifted as the others, seconds since a machine's start would lie before 1970."""
    case = tmp_path / 'case'
    shutil.copytree(plain, case)
    path = glob.glob(f'{case}/stages/0002*.bag')[0]

    def change(topic, message, time):
        if topic == '/microscope/settings':
            message.header.stamp = rospy.Time(4000)
        return topic, message, time
    planting.rewritten(path, change)
    done = deidentify(str(case), str(tmp_path / 'out'))
    assert done.stages == 1 and any('another clock' in why for _, why in done.left_out)
