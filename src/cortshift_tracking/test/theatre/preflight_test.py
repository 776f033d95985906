"""preflight against a site that is ready, and against every way in which one is not."""
import datetime
import os
import pathlib
import socket
import struct
import subprocess
import threading
import time

import pytest
import yaml
from cortshift_tracking.theatre import preflight as pf
from graph import wait_until

ROOT = pathlib.Path(__file__).resolve().parents[4]
NOW = datetime.datetime(2026, 5, 1, tzinfo=datetime.timezone.utc).timestamp()


def camera_yaml(date, side, width=320):
    tx = 0 if side == 'left' else -22.5
    return (f'# Calibrated {date} from 20 views of a 9x6 board.\nimage_width: {width}\nimage_height: 240\ncamera_name: {side}\n'
            'distortion_model: plumb_bob\n'
            'camera_matrix: {rows: 3, cols: 3, data: [900, 0, 160, 0, 900, 120, 0, 0, 1]}\n'
            'distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n'
            'rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n'
            f'projection_matrix: {{rows: 3, cols: 4, data: [900, 0, 160, {tx}, 0, 900, 120, 0, 0, 0, 1, 0]}}\n')


class Tracker:
    """An OpenIGTLink server that sends TRANSFORM messages of two tools."""

    def __init__(self, clock_offset=0.0, devices=('ScopeToReference', 'PatientToReference')):
        self._server = socket.create_server(('127.0.0.1', 0))
        self.address = f'127.0.0.1:{self._server.getsockname()[1]}'
        self._offset, self._devices = clock_offset, devices
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self):
        while True:
            try:
                client, _ = self._server.accept()
                while True:
                    for device in self._devices:
                        stamp = int((time.time() + self._offset) * 2 ** 32)
                        client.sendall(struct.pack('> H 12s 20s Q Q Q', 1, b'TRANSFORM', device.encode(), stamp, 48, 0) + bytes(48))
                    time.sleep(0.05)
            except OSError:
                if self._server.fileno() < 0:
                    return

    def stop(self):
        self._server.close()


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A site that is ready, but for cameras: source folder."""
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    monkeypatch.setattr(pf, 'LISTEN', 0.5)
    for name, text in (('left', camera_yaml('2026-04-20T10:00:00Z', 'left')), ('right', camera_yaml('2026-04-20T10:00:00Z', 'right')),
                       ('hand_eye', 'date: 2026-04-20T11:00:00Z\ntranslation: [0, 0, 0]\nrotation: [0, 0, 0, 1]\n')):
        (tmp_path / f'{name}.yaml').write_text(text)
    tracker = Tracker()
    yield {'stereo_driver': {'source': 'folder', 'calibration_left': str(tmp_path / 'left.yaml'),
                             'calibration_right': str(tmp_path / 'right.yaml'), 'hand_eye': str(tmp_path / 'hand_eye.yaml')},
           'igtl_bridge': {'servers': [tracker.address], 'tools': [{'device': 'ScopeToReference'}]},
           'shift_tracker': {'case_folder': str(tmp_path / 'case' / 'new')}, 'preflight': {'disk_gb': 0.001}}
    tracker.stop()


def findings(site, level=pf.FAIL):
    return {f.check: f.text for f in pf.preflight(site, NOW) if f.level == level}


def test_a_ready_site(site):
    assert findings(site) == {}
    good = findings(site, pf.OK)
    assert 'baseline 25.00 mm' in good['calibration match']
    assert '11 days old' in good['calibration_left']
    assert 'heard' in good['tool ScopeToReference']


@pytest.mark.parametrize('date, level', [('2026-01-20T10:00:00Z', pf.WARN), ('2025-01-20T10:00:00Z', pf.FAIL),
                                         ('2026-06-20T10:00:00Z', pf.FAIL)])
def test_age_of_the_calibration(site, tmp_path, date, level):
    for side in ('left', 'right'):
        (tmp_path / f'{side}.yaml').write_text(camera_yaml(date, side))
    assert {'calibration_left', 'calibration_right'} <= set(findings(site, level))


def test_calibrations_that_do_not_match(site, tmp_path):
    right = tmp_path / 'right.yaml'
    right.write_text(camera_yaml('2026-04-20T10:00:00Z', 'right', 640))
    assert 'left is for (320, 240)' in findings(site)['calibration match']
    right.write_text(camera_yaml('2026-04-21T10:00:00Z', 'right'))
    assert 'different dates' in findings(site)['calibration match']
    right.write_text(camera_yaml('2026-04-20T10:00:00Z', 'left'))  # twice the left one: no baseline
    assert 'not of one stereo calibration' in findings(site)['calibration match']
    right.write_text(camera_yaml('2026-04-20T10:00:00Z', 'right'))
    (tmp_path / 'hand_eye.yaml').write_text('date: 2026-04-19T11:00:00Z\n')
    assert 'hand_eye is older' in findings(site)['calibration match']


@pytest.mark.parametrize('model, terms, complaint', [
    ('rational_polynomial', [0.1] * 8, None), ('equidistant', [0.1] * 4, None), ('plumb_bob', [0.1] * 4, None),
    ('rational_polynomial', [0.1] * 8 + [0] * 6, None),
    ('fisheye', [0.1] * 4, 'supported are plumb_bob, rational_polynomial, equidistant'),
    ('rational_polynomial', [0.1] * 5, '5 distortion_coefficients; rational_polynomial has 8'),
    ('plumb_bob', [0.1] * 12, '12 distortion_coefficients; plumb_bob has 5')])
def test_lenses_and_flat_lists(site, tmp_path, model, terms, complaint):
    for side in ('left', 'right'):
        camera = yaml.safe_load(camera_yaml('2026-04-20T10:00:00Z', side))
        camera = {'width': 320, 'height': 240, 'distortion_model': model, 'D': terms, 'K': camera['camera_matrix']['data'],
                  'R': camera['rectification_matrix']['data'], 'P': camera['projection_matrix']['data']}
        (tmp_path / f'{side}.yaml').write_text('# verdict: good\n# Calibrated 2026-04-20T10:00:00Z from 20 views\n' + yaml.safe_dump(camera))
    found = findings(site)
    if complaint:
        assert complaint in found['calibration_left']
    else:
        assert found == {}
        assert '320 x 240 pixels, baseline 25.00 mm' in findings(site, pf.OK)['calibration match']


def test_calibration_that_is_missing_or_broken(site, tmp_path):
    (tmp_path / 'left.yaml').write_text('- 1\n')
    site['stereo_driver']['calibration_right'] = ''
    found = findings(site)
    assert 'holds no calibration' in found['calibration_left'] and 'set stereo_driver/calibration_right' in found['calibration_right']


def test_no_tracker(site):
    site['igtl_bridge']['servers'] = ['127.0.0.1:9']
    assert 'start the navigation system' in findings(site)['tracker']
    site['igtl_bridge'] = {}
    assert 'no tools' in findings(site)['tracker']


def test_tool_that_is_not_heard(site):
    site['igtl_bridge']['tools'].append({'device': 'Stylus'})
    assert 'heard: PatientToReference, ScopeToReference' in findings(site, pf.WARN)['tool Stylus']


def test_clock_of_the_tracker(site):
    tracker = Tracker(clock_offset=-2.0)
    site['igtl_bridge']['servers'] = [tracker.address]
    assert 'differs from ours by -2.0' in findings(site)['tool ScopeToReference']
    tracker.stop()


def test_no_cameras(site):
    site['stereo_driver']['source'] = 'none'
    assert 'source is none' in findings(site)['cameras']
    site['stereo_driver'].update(source='aravis', aravis={'left': {'device': '127.0.0.7'}})  # nobody's address
    found = findings(site)
    assert 'does not answer' in found['left camera'] and 'aravis/right/device' in found['right camera']


def test_cameras_and_their_size(site):
    program = next(path for path in (pathlib.Path(folder) / 'lib/cortshift_stereo/fake_gige_camera'
                                     for folder in os.environ['CMAKE_PREFIX_PATH'].split(':')) if path.exists())
    with subprocess.Popen([program, '127.0.0.1', 'GV0']) as camera:
        try:
            site['stereo_driver'].update(source='aravis', aravis={'left': {'device': '127.0.0.1'}})
            wait_until(lambda: 'does not answer' not in findings(site).get('left camera', ''), 60, 'a camera that answers')
            assert '512 x 512 pixels, the calibration is for 320 x 240' in findings(site)['left camera']
            site['stereo_driver']['aravis']['left']['features'] = ['Width=320', 'Height=240']
            assert 'answers' in findings(site, pf.OK)['left camera']
        finally:
            camera.kill()


@pytest.mark.parametrize('text, check, said', [
    ('stereo_driver: {source: aravis, aravis: {left: , right: {device: 127.0.0.7}}}', 'left camera', 'set stereo_driver/aravis/left/device'),
    ('stereo_driver: {source: aravis, aravis: }', 'right camera', 'set stereo_driver/aravis/right/device'),
    ('stereo_driver: {source: aravis, aravis: fake}', 'cameras',
     "stereo_driver/aravis is 'fake', not a dictionary; write left: and right: below it, indented"),
    ('stereo_driver: {source: aravis, aravis: {left: 192.168.1.11}}', 'cameras',
     "stereo_driver/aravis/left is '192.168.1.11', not a dictionary; write left: {device: 192.168.1.11}"),
    ('stereo_driver: {source: aravis, aravis: {left: {device: [a]}}}', 'cameras', "stereo_driver/aravis/left/device is ['a'], not an address"),
    ('stereo_driver: {source: aravis, aravis: {left: {device: a, features: Width=320}}}', 'cameras',
     "stereo_driver/aravis/left/features is 'Width=320', not a list; write features: [\"Width=1920\""),
    ('stereo_driver: {source: aravis, aravis: {left: {device: a, features: [Width: 320]}}}', 'cameras',
     "stereo_driver/aravis/left/features holds {'Width': 320}, not text"),
    ('stereo_driver: {source: [aravis]}', 'cameras', "stereo_driver/source is ['aravis'], not text; write source: aravis"),
    ('stereo_driver: {calibration_left: 1}', 'calibration_left',
     'stereo_driver/calibration_left is 1, not text; write calibration_left: /var/lib/cortshift/calibration_left.yaml'),
    ('stereo_driver: {hand_eye: {a: b}}', 'hand_eye', "stereo_driver/hand_eye is {'a': 'b'}, not text"),
    ('igtl_bridge: {tools: [MicroscopeToRef]}', 'tracker', "igtl_bridge/tools holds 'MicroscopeToRef', not a dictionary with the name of a "
     'device; write tools: [{device: MicroscopeToRef, '),
    ('igtl_bridge: {tools: {device: A}}', 'tracker', "igtl_bridge/tools is {'device': 'A'}, not a list; write tools: [{device: "),
    ('igtl_bridge: {tools: [{device: }]}', 'tracker', "igtl_bridge/tools holds {'device': None}, not a dictionary with the name"),
    ('igtl_bridge: {tools: [{device: 3}]}', 'tracker', "igtl_bridge/tools holds {'device': 3}, not a dictionary with the name"),
    ('igtl_bridge: {servers: "1.2.3.4:18944"}', 'tracker',
     "igtl_bridge/servers is '1.2.3.4:18944', not a list; write servers: [\"192.168.1.20:18944\"]"),
    ('igtl_bridge: {servers: [{host: a}]}', 'tracker', "igtl_bridge/servers holds {'host': 'a'}, not text"),
    *[(f'igtl_bridge: {{servers: ["{server}"]}}', 'tracker', f"igtl_bridge/servers holds '{server}', not ADDRESS:PORT in numbers; write "
       '192.168.1.20:18944') for server in ('192.168.1.20', 'navigation:18944', '127.0.0.1:99999', '127.0.0.1:x', '')],
    ('shift_tracker: {case_folder: 3}', 'case folder', 'shift_tracker/case_folder is 3, not text; write case_folder: /data/cases'),
    ('shift_tracker: {case_folder: "~nobody of here/a"}', 'case folder', "shift_tracker/case_folder: '~nobody of here/a' cannot be looked at"),
    ('case_recorder: {folder: [a]}', 'recording', "case_recorder/folder is ['a'], not text")])
def test_what_people_write_is_named_by_its_key(site, monkeypatch, text, check, said):
    """One finding, and the other checks go on."""
    monkeypatch.setattr(pf, 'listen', lambda *_: {'ScopeToReference': (time.time(), time.time())})
    monkeypatch.setattr(pf, 'check_simulated_time', lambda: [pf.Finding(pf.OK, 'use_sim_time', 'not asked here')])
    monkeypatch.setattr(pf.shutil, 'which', lambda _: '/bin/false')
    for node, values in yaml.safe_load(text).items():
        site.setdefault(node, {}).update(values)
    found = pf.preflight(site, NOW)
    failed = [finding for finding in found if finding.level == pf.FAIL]
    assert [finding.text for finding in failed if finding.check == check and said in finding.text], failed
    assert len(failed) <= 2 and {'calibration_right', 'recording', 'clock', 'use_sim_time'} <= {finding.check for finding in found}


def test_a_camera_that_keeps_the_tool_waiting(site, monkeypatch):
    def wait(*_, timeout, **__):
        raise subprocess.TimeoutExpired('arv-tool-0.8', timeout)
    monkeypatch.setattr(pf.shutil, 'which', lambda _: '/bin/false')
    monkeypatch.setattr(pf.subprocess, 'run', wait)
    site['stereo_driver'].update(source='aravis', aravis={'left': {'device': 'a'}, 'right': {'device': 'b'}})
    assert findings(site) == {f'{side} camera': f'{device} does not answer within 60 s; check power, cable and address'
                              for side, device in (('left', 'a'), ('right', 'b'))}


def opencv_yaml(side):
    """A camera as OpenCV's FileStorage writes it."""
    camera = yaml.safe_load(camera_yaml('2026-04-20T10:00:00Z', side))
    words = {0: '0e0', 900: '9e2'}  # numbers to yaml-cpp, text to PyYAML
    lines = ['%YAML:1.0', '---', '# Calibrated 2026-04-20T10:00:00Z']
    for key, value in camera.items():
        if isinstance(value, dict):
            lines += [f'{key}: !!opencv-matrix', f'   rows: {value["rows"]}', f'   cols: {value["cols"]}', '   dt: d',
                      f'   data: [ {", ".join(words.get(number, f"{number:.1f}") for number in value["data"])} ]']
        else:
            lines.append(f'{key}: {value}')
    return '\n'.join(lines) + '\n'


def test_calibrations_of_opencv_are_read_as_the_nodes_read_them(site, tmp_path):
    for side in ('left', 'right'):
        (tmp_path / f'{side}.yaml').write_text(opencv_yaml(side))
    assert findings(site) == {} and '320 x 240 pixels, baseline 25.00 mm' in findings(site, pf.OK)['calibration match']


@pytest.mark.parametrize('old, new, check, said', [
    ('data: [900, 0, 160, 0, 0, 900, 120, 0, 0, 0, 1, 0]', 'data: here', 'calibration match', 'projection_matrix is missing or incomplete'),
    ('plumb_bob', '[plumb_bob]', 'calibration_left', "distortion_model is ['plumb_bob']; supported are"),
    ('data: [0, 0, 0, 0, 0]', 'data: [0, 0, 0, 0, x]', 'calibration_left', 'distortion_coefficients are missing, or no list of numbers'),
    ('data: [0, 0, 0, 0, 0]', 'data: [0, 0, 0, 0, .nan]', 'calibration_left', 'distortion_coefficients are missing, or no list of numbers'),
    ('image_width: 320', 'image_width: wide', 'calibration_left', "image_width and image_height are ('wide', 240), not whole numbers"),
    ('2026-04-20T10:00:00Z', '2026-13-20T10:00:00Z', 'calibration_left', '2026-13-20T10:00:00Z is no date; calibrate, or correct the path')])
def test_calibrations_with_a_fault_are_named(site, tmp_path, old, new, check, said):
    text = camera_yaml('2026-04-20T10:00:00Z', 'left')
    assert old in text
    (tmp_path / 'left.yaml').write_text(text.replace(old, new))
    assert said in findings(site)[check]


def test_little_disk_and_folder_that_may_not_be_written(site):
    site['preflight']['disk_gb'] = 1e9
    assert 'free some' in findings(site)['case folder']
    site['shift_tracker']['case_folder'] = '/proc/cortshift'
    site['preflight']['disk_gb'] = 0.001
    assert 'case folder' in findings(site)


def test_the_script(site, tmp_path):
    def run(*arguments):
        return subprocess.run([str(ROOT / 'script/preflight'), *arguments], capture_output=True, text=True)
    path = tmp_path / 'site.yaml'
    path.write_text(yaml.safe_dump(site))
    assert run('--help').returncode == 0 and run('--nothing').returncode == 2
    shipped = run()  # no hardware in the shipped one
    assert shipped.returncode == 1 and 'source is none' in shipped.stdout and 'set stereo_driver/calibration_left' in shipped.stdout
    for text in ('[]', 'preflight: {colour: 1}', 'stereo_driver: 3', '{'):
        path.write_text(text)
        refused = run('--site', str(path))
        assert refused.returncode == 1 and str(path) in refused.stderr, refused


class Master:
    """A ROS master that holds these parameters, or does not answer."""

    def __init__(self, parameters):
        self._parameters = parameters

    def __call__(self, _):
        return self

    def hasParam(self, name):
        if self._parameters is None:
            raise ConnectionRefusedError(111, 'Connection refused')
        return name in self._parameters

    def getParam(self, name):
        return self._parameters[name]


@pytest.mark.parametrize('parameters, level, text', [
    ({'/use_sim_time': True}, pf.FAIL, 'rosparam set use_sim_time false'), ({'/use_sim_time': False}, pf.OK, 'not set'),
    ({}, pf.OK, 'not set'), (None, None, '')], ids=['left behind', 'false', 'never set', 'no master'])
def test_simulated_time_that_was_left_behind_is_named(monkeypatch, parameters, level, text):
    monkeypatch.setattr(pf.rosgraph, 'Master', Master(parameters))
    found = pf.check_simulated_time()
    assert [f.level for f in found] == ([level] if level else []) and all(text in f.text for f in found)


@pytest.mark.parametrize('content, reason', [
    (b'\xff\xfes\0t\0', 'is not a dictionary of nodes'), ('a: [1,\n'.encode(), 'is not YAML (line 2)'), (b'\0\1\2', 'is not a text file'),
    (b'preflight: {disk_gb: much}', "preflight/disk_gb = 'much' is not a number"), (b'preflight: {days: 3}', 'preflight/days is unknown')])
def test_a_site_file_that_cannot_be_used_is_refused_without_the_words_of_a_library(tmp_path, capsys, content, reason):
    (tmp_path / 'my site.yaml').write_bytes(content)
    assert pf.main(['--site', str(tmp_path / 'my site.yaml')]) == 1
    said = capsys.readouterr().err
    assert reason in said and 'my site.yaml' in said and 'Error' not in said


def test_names_that_openigtlink_has_no_room_for():
    long = [{'device': 'MicroscopeToReference'}, {'device': 'StylusToReference'}]
    found = pf.check_tracker({'tools': long, 'servers': ['127.0.0.1:1']})
    assert [f.check for f in found] == ['tool MicroscopeToReference'] and '21 characters and OpenIGTLink has room for 20' in found[0].text
    assert pf.check_tracker({'tools': [{'device': 'ü' * 11}]})[0].level == pf.FAIL
