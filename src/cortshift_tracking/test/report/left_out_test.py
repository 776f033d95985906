"""What cannot be read of a case is left out and named; the rest is reported."""
import json
import os
import shutil
import sys

import genpy.dynamic
import pytest
import rosbag
from cortshift_tracking.case.folder import read_case
from cortshift_tracking.errors import CaseError
from cortshift_tracking.report.case_report import make_report
from cortshift_tracking.report.picks import read_picks
from cortshift_tracking.report.tables import table_2
from cortshift_tracking.report.warnings import warnings_of

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
import synthetic_case as synthetic  # noqa: E402

FIRST, SECOND, THIRD = synthetic.STAGES
OLD_INFO = 'string key\nstring note\ntime stamp\n'
OLD_FIELD = 'string from_key\nstring to_key\n'


@pytest.fixture(scope='module')
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp('whole')
    synthetic.write_case(str(folder))
    return folder


@pytest.fixture
def case(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / 'case')


def rewrite(path, change):
    """The bag with change(topic, message) in place of each message; None leaves it out."""
    with rosbag.Bag(str(path)) as bag:
        messages = [(topic, change(topic, message), stamp) for topic, message, stamp in bag.read_messages()]
    with rosbag.Bag(str(path), 'w') as bag:
        for topic, message, stamp in messages:
            if message is not None:
                bag.write(topic, message, stamp)


def of_older_type(name, definition, **values):
    return genpy.dynamic.generate_dynamic(name, definition)[name](**values)


def live_field(case):
    """/shift/field recorded while live mode ran: no later stage."""
    def change(_, message):
        message.to_key = ''
        return message
    shutil.copy(case / f'{FIRST}__{SECOND}.bag', case / 'recording.bag')
    rewrite(case / 'recording.bag', change)


def test_the_report_shows_the_rest(case):
    live_field(case)
    os.remove(next(case.glob(f'*_{THIRD}_*.bag')))
    page, tables = make_report(str(case))
    assert 'recording.bag: 1 field of the live mode: no later stage was captured with it' in page
    assert f'{FIRST} \u2192 {THIRD}: the case holds no readable stage {THIRD}: no overlay' in page
    assert tables['table_3.csv'].count('\n') == 4 and tables['table_2.csv'].count('\n') == 2
    assert page.count('overlays of') == 1 and page.count('vectors of') == 3


@pytest.mark.parametrize('damage, reason', [
    (lambda path: path.write_bytes(path.read_bytes()[:9000]), 'the bag has no index, so its recording was cut off'),
    (lambda path: path.write_text('a letter'), 'damaged, or not a bag; restore it from a copy'),
    (lambda path: rewrite(path, lambda t, m: of_older_type('cortshift_msgs/StageInfo', OLD_INFO, key=m.key)
                          if t == '/stage/info' else m),
     'written by another version of cortshift, whose cortshift_msgs/StageInfo has other fields; make it again'),
    (lambda path: rewrite(path, lambda t, m: m.header if t == '/surface/points' else m),
     '/surface/points holds std_msgs/Header, not sensor_msgs/PointCloud2')], ids=['cut', 'text', 'older', 'other topic'])
def test_stages_that_cannot_be_read(case, damage, reason):
    path = next(case.glob(f'*_{SECOND}_*.bag'))
    damage(path)
    case = read_case(str(case))
    assert case.left_out[0].startswith(f'{path.name}: {reason}') and 'rosbag.' not in case.left_out[0]
    assert [stage.key for stage in case.stages] == [FIRST, THIRD] and len(case.fields) == 3
    assert any(f'{FIRST} \u2192 {SECOND}: the case holds no readable stage {SECOND}' in text for text in warnings_of(case, []))


def test_a_field_of_an_older_version_is_left_out(case):
    rewrite(case / f'{FIRST}__{SECOND}.bag', lambda _, m: of_older_type('cortshift_msgs/DisplacementField', OLD_FIELD, from_key=m.from_key))
    case = read_case(str(case))
    assert len(case.fields) == 2 and 'whose cortshift_msgs/DisplacementField has other fields' in case.left_out[0]


def test_a_field_of_another_capture_of_the_stage_is_left_out(case):
    def later(topic, message):
        if topic == '/stage/info':
            message.stamp.secs += 60
        return message
    rewrite(next(case.glob(f'*_{SECOND}_*.bag')), later)
    case = read_case(str(case))
    assert [(f.from_key, f.to_key) for f in case.fields] == [(FIRST, THIRD)]
    assert len(case.left_out) == 2 and all(f'of another capture of "{SECOND}"' in reason for reason in case.left_out)


def test_one_key_is_one_stage(case):
    (case / 'copy').mkdir()
    shutil.copy(next(case.glob(f'*_{SECOND}_*.bag')), case / 'copy')
    assert not read_case(str(case)).left_out  # the same twice
    synthetic.write_stage(str(case / 'copy'), 9, SECOND, 77)
    assert f'another stage "{SECOND}" is in 0002_' in read_case(str(case)).left_out[0]


def test_probe_picks_and_calibration_that_cannot_be_used(case):
    points = json.loads((case / 'probe_points.json').read_text())
    far = next(p for p in points['points'] if (p['stage'], p['label']) == (FIRST, 'p1'))
    far['position'][2] += 0.1
    for point in points['points']:
        if point['label'] == 'gravity_lower':
            point['position'] = next(p['position'] for p in points['points'] if p['label'] == 'gravity_upper')
    (case / 'probe_points.json').write_text(json.dumps(points))
    kept = [line for line in (case / 'picks.csv').read_text().splitlines() if not line.startswith(f'{FIRST},p2,')]
    (case / 'picks.csv').write_text('\n'.join(kept) + f'\n{SECOND},p2,12;4,7\n{THIRD},p3,1\n{FIRST},p2,1,1\n')
    (case / 'left.yaml').write_text('a: [1,\nb: 2\n')
    read, left_out = read_case(str(case)), []
    picks, bad = read_picks(str(case / 'picks.csv'))
    assert len(table_2(read, picks, left_out)) == 3
    told = '\n'.join(warnings_of(read, left_out + bad))
    for reason in ('left out: point "p1" of stage "dural_opening" is', 'mm from the surface', 'the two gravity positions are only 0.0 mm apart',
                   'column column_px: "12;4" is not a number', 'it has 3 columns, the first line 4',
                   'no surface at column 1, row 1, where "p2" was picked', 'left.yaml: is not YAML (line 3)'):
        assert reason in told, reason
    assert read.gravity_pmr is None
    (case / 'probe_points.json').write_text('{')
    (case / 'picks.csv').write_text('stage,label\n')
    assert 'probe_points.json: not a whole file of probe points' in read_case(str(case)).left_out[0]
    with pytest.raises(CaseError, match='columns missing: column_px, row_px'):
        read_picks(str(case / 'picks.csv'))


def test_a_label_that_was_picked_twice_is_left_out_with_both_lines(tmp_path):
    (tmp_path / 'picks.csv').write_text('stage,label,column_px,row_px\ns,p,1,2\ns,q,3,4\nt,p,5,6\ns,p,700,8\n')
    picks, bad = read_picks(str(tmp_path / 'picks.csv'))
    assert picks == {('s', 'q'): (3, 4), ('t', 'p'): (5, 6)}
    assert bad == [f'{tmp_path}/picks.csv, line {line}: label "p" of stage "s" stands twice, in lines 2 and 5; keep one of them'
                   for line in (2, 5)]


def test_nothing_left_is_refused_with_every_reason(case):
    for path in case.glob('0*.bag'):
        path.write_text('')
    with pytest.raises(CaseError, match='holds no stage.*0001_.*damaged.*0003_.*damaged'):
        read_case(str(case))
