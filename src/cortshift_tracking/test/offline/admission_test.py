"""What must not enter a result unchecked: refused or warned of by name, by process_bag and by validate_bag alike."""
import copy
import csv
import re

import genpy
import numpy as np
import pytest
import rosbag
import yaml

import faults
import recorded_cases as cases
from fault_trials import process, shipped_entries, tool
from offline_tools import ROOT, read_field

FIELD = 'dural_opening__after_resection.bag'


@pytest.fixture(scope='module')
def shipped(tmp_path_factory):
    """Entries, and (exit status, text, result, warnings, folder) of the untouched recording."""
    entries, folder = shipped_entries(), tmp_path_factory.mktemp('untouched') / 'case'
    return entries, (*process(copy.deepcopy(entries), folder), folder)


def faulty(entries, name, seed=0):
    return faults.FAULTS[name](copy.deepcopy(entries), np.random.default_rng(seed))


def test_untouched_carries_no_warning_and_says_what_it_was_made_with(shipped):
    status, said, _, warnings, folder = shipped[1]
    assert status == 0 and warnings == [] and 'WARNING' not in said
    field = read_field(folder / 'out' / FIELD)
    assert field.provenance.software
    for digest in (field.provenance.configuration, field.provenance.calibration):
        assert re.fullmatch('[0-9a-f]{64}', digest)
    stage, = (folder / 'out' / 'stages').glob('*dural_opening*')
    with rosbag.Bag(str(stage)) as bag:
        topics = {topic: message for topic, message, _ in bag.read_messages()}
    for name in ('software', 'configuration', 'calibration'):
        assert getattr(topics['/stage/info'].provenance, name) == getattr(field.provenance, name)
    assert topics['/stage/info'].warnings == []
    parameters = yaml.safe_load(topics['/stage/parameters'].data.replace('# surface_reconstruction', '').replace('# shift_tracker', ''))
    assert parameters['resolution'] == 0.0005 and parameters['min_coverage'] == 0.25
    status, said = tool('validate_bag', folder / 'case.bag', '--config', cases.CONFIG)
    assert status == 0 and '\nwarnings' not in said and '\nrefused' not in said, said


# name of the fault, what the refusal says, whether validate_bag sees it (it looks at no image)
REFUSED = [
    ('pose_fixed_and_moving', 'reference -> microscope is fixed on /tf_static', True),
    ('pose_of_two_publishers', 'two publishers say different poses in turn', True),
    ('pose_trembles', 'trembles by', True),
    ('pose_stands_still', 'the tracker repeats itself', False),
    ('pose_goes_back', 'the tracker repeats itself', False),
    ('image_repeated', 'the camera or its driver repeats itself', False),
    ('hand_eye_changes', 'the calibration (camera_info, the hand-eye or the stereo edge) changed', True),
    ('camera_info_changes', 'the calibration (camera_info, the hand-eye or the stereo edge) changed', True),
    ('registration_changes', 'the patient registration changed', False),
    ('hand_eye_of_two_publishers', 'came twice on /tf_static', True),
    ('baseline_of_two_truths', 'tf and camera_info differ about the stereo head', True),
    ('image_under_two_names', 'two sources publish under one name', True),
    ('stamps_of_a_pair_differ', 'sync_tolerance', True),
    ('stamp_missing', 'has no stamp', True),
    ('topic_of_another_name', '/cam_', True),
    ('setting_not_calibrated', 'calibrated is only', False),
]


@pytest.mark.parametrize('name, text, seen', REFUSED, ids=[entry[0] for entry in REFUSED])
def test_refused_by_name(shipped, tmp_path, name, text, seen):
    status, said, _, _ = process(faulty(shipped[0], name), tmp_path / 'case')
    assert status == 1 and text in said, said
    status, validated = tool('validate_bag', tmp_path / 'case/case.bag', '--config', cases.CONFIG)
    assert not seen or status == 1, validated


WARNED = [
    ('setting_not_told', 'nothing on /microscope/settings'),
    ('recorder_clock_off', 'its record time'),
    ('camera_clock_off', 'its record time'),
]


@pytest.mark.parametrize('name, text', WARNED, ids=[entry[0] for entry in WARNED])
def test_warned_of_in_everything_that_is_shown(shipped, tmp_path, name, text):
    status, said, _, warnings = process(faulty(shipped[0], name, seed=2), tmp_path / 'case')
    if status == 1:   # a stamp so far off that no pose is known for it
        assert name == 'camera_clock_off' and 'pose' in said
        return
    assert any(text in warning for warning in warnings) and 'WARNING' in said, (said, warnings)
    with open(tmp_path / 'case/out/summary.csv', encoding='utf-8', newline='') as file:
        row, = csv.DictReader(file)
    assert text in row['warnings']
    _, validated = tool('validate_bag', tmp_path / 'case/case.bag', '--config', cases.CONFIG)
    assert text in validated


def test_a_setting_that_is_none_is_not_the_reference(shipped, tmp_path):
    status, said, result, warnings = process(faulty(shipped[0], 'setting_none_first'), tmp_path / 'case')
    assert status == 0 and warnings == [], said
    assert np.linalg.norm(result - shipped[1][2]) < 1e-6


def test_capture_in_record_time_is_found_in_record_time(shipped, tmp_path):
    """3 s between record and stamp must not turn one stage into another."""
    ahead = [[topic, message, time + genpy.Duration(3)] for topic, message, time in copy.deepcopy(shipped[0])]
    status, said, result, warnings = process(ahead, tmp_path / 'case')
    assert status == 0, said
    assert np.linalg.norm(result - shipped[1][2]) < 1e-6
    assert any('3.0' in warning and 'record time' in warning for warning in warnings)


def test_setting_not_told_where_several_are_calibrated(shipped, tmp_path):
    status, said, _, _ = process(faulty(shipped[0], 'setting_not_told'), tmp_path / 'case', '--settings-calibration',
                                 ROOT / 'config/phantom/zoom_settings')
    assert status == 1 and 'the calibration in use knows several' in said


@pytest.mark.parametrize('when', [0.001, 4.294e9], ids=['1970', '2106'])
def test_one_absurd_record_time_does_not_set_the_range(shipped, tmp_path, when):
    entries = copy.deepcopy(shipped[0])
    next(entry for entry in entries if entry[0] == '/microscope/pose')[2] = genpy.Time.from_sec(when)
    changed = next(entry for entry in entries if entry[0] == '/tf')
    changed[2] = genpy.Time.from_sec(when)
    status, said, result, _ = process(entries, tmp_path / 'case')
    assert status == 0 and 'more than a day from all others' in said, said
    assert np.linalg.norm(result - shipped[1][2]) < 1e-6
    status, validated = tool('validate_bag', tmp_path / 'case/case.bag', '--config', cases.CONFIG)
    assert status == 0 and 'more than a day from all others' in validated


def test_tf_of_its_old_name_is_read(shipped, tmp_path):
    status, said, result, warnings = process(copy.deepcopy(shipped[0]), tmp_path / 'case',
                                             types={'/tf': 'tf/tfMessage', '/tf_static': 'tf/tfMessage'})
    assert status == 0 and not warnings, said
    assert np.linalg.norm(result - shipped[1][2]) < 1e-6


def test_recompute_says_what_has_changed(shipped, tmp_path):
    folder = shipped[1][4]
    status, said = tool('recompute', folder / 'out', '--config', cases.CONFIG)
    assert status == 0 and said.count('same software, configuration and calibration') == 3, said
    config = tmp_path / 'config'
    config.mkdir()
    (config / 'surface_reconstruction.yaml').write_text('max_deviation: 0.7\n')
    (config / 'shift_tracker.yaml').write_text('resolution: 0.0005\n')
    status, said = tool('recompute', folder / 'out', '--config', config)
    assert status == 0 and said.count('configuration was ') == 3 and 'calibration was' not in said, said
