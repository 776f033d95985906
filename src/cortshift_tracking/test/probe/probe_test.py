"""What counts as a digitised point, gravity from two of them, and a store that survives."""
import json
import os
import re
import subprocess
import sys
import threading

import numpy as np
import pytest
import rospy
from cortshift_tracking.errors import CaseError, ProbeError
from cortshift_tracking.probe.node import ProbeNode
from cortshift_tracking.probe.points import ProbePoint, StillSettings, check_key, gravity_direction, still_point
from cortshift_tracking.probe.store import FILE_NAME, ProbeStore, read_points
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

TIMES = np.arange(0, 1.0001, 0.05)
PLACE = np.array([0.031, -0.042, 0.077])


def tips(noise=0.0003, seed=0, **motion):
    random = np.random.default_rng(seed)
    path = PLACE + random.normal(0, noise, (len(TIMES), 3))
    path[:, 0] += motion.get('speed', 0) * TIMES
    return path


def point(stage='first', label='a', position=(0.01, 0.02, 0.03)):
    return ProbePoint(stage, label, (100, 5), position, 0.0003, 20)


def test_still_tip_gives_the_median_within_its_noise():
    errors = []
    for seed in range(300):
        position, spread = still_point(TIMES, tips(seed=seed))
        errors.append(np.linalg.norm(position - PLACE))
        assert 0.0003 < spread < 0.0008
    # The median of 21 samples of 0.3 mm each: 0.3 * sqrt(pi / 2 / 21) mm per axis.
    assert np.isclose(np.sqrt(np.mean(np.square(errors))), 0.0003 * np.sqrt(3 * np.pi / 2 / 21), rtol=0.1)


def test_one_wild_sample_does_not_count():
    path = tips()
    path[7] += [0.003, 0, 0]
    position, _ = still_point(TIMES, path)
    assert np.linalg.norm(position - PLACE) < 0.0004


@pytest.mark.parametrize('speed', [0.003, 0.02, 0.2])
def test_moving_tip_is_refused(speed):
    with pytest.raises(ProbeError, match='tip moves.*hold it still'):
        still_point(TIMES, tips(speed=speed))


def test_lifted_tip_and_back_is_refused():
    path = tips()
    path[8:12] += [0, 0, 0.006]
    with pytest.raises(ProbeError, match='tip moves'):
        still_point(TIMES, path)


def test_dropped_tracking_is_refused():
    with pytest.raises(ProbeError, match='not tracked'):
        still_point([], np.empty((0, 3)))
    keep = np.r_[0:6, 12:21]
    with pytest.raises(ProbeError, match='dropped for 0.35 s'):
        still_point(TIMES[keep], tips()[keep])
    with pytest.raises(ProbeError, match='dropped: 10 samples over 0.45 s'):
        still_point(TIMES[:10], tips()[:10])
    sparse = StillSettings(max_gap=0.3)
    with pytest.raises(ProbeError, match='dropped: 5 samples'):
        still_point(TIMES[::5], tips()[::5], sparse)
    broken = tips()
    broken[3] = np.nan
    with pytest.raises(ProbeError, match='not numbers'):
        still_point(TIMES, broken)
    with pytest.raises(ProbeError, match='do not ascend'):
        still_point(TIMES[::-1], tips())


def test_gravity_from_two_positions():
    true_down = np.array([0.2, -0.5, -0.8]) / np.linalg.norm([0.2, -0.5, -0.8])
    assert np.allclose(gravity_direction(PLACE, PLACE + 0.3 * true_down, true_down), true_down)
    assert np.allclose(gravity_direction(PLACE, PLACE + 0.3 * true_down), true_down)


def test_useless_gravity_pairs_are_refused():
    down = np.array([0.0, 0.0, -1.0])
    with pytest.raises(ProbeError, match='horizontal: 88 degrees'):
        gravity_direction(PLACE, PLACE + [0.3, 0, -0.0105], down)
    with pytest.raises(ProbeError, match='upper and lower are swapped'):
        gravity_direction(PLACE, PLACE - 0.3 * down, down)
    with pytest.raises(ProbeError, match='only 20.0 mm apart'):
        gravity_direction(PLACE, PLACE + 0.02 * down, down)
    with pytest.raises(ProbeError, match='2.00 m apart'):
        gravity_direction(PLACE, PLACE + 2 * down, down)


@pytest.mark.parametrize('key', ['', 'a b', 'ä', 'x' * 65, '../a', 'a\n'])
def test_malformed_keys_are_refused(key):
    with pytest.raises(ProbeError, match='use 1-64 of'):
        check_key('label', key)
    check_key('label', 'Vein_2-b')


def test_store_keeps_order_and_refuses_what_is_there(tmp_path):
    store = ProbeStore(tmp_path)
    store.add(point(label='b'))
    store.add(point(label='a', position=(1e-9, 0.1234567890123456, -3.0)))
    with pytest.raises(ProbeError, match='"b" of stage "first" exists already'):
        store.add(point(label='b', position=(0, 0, 0)))
    again = ProbeStore(tmp_path)
    assert again.points == store.points and [p.label for p in again.points] == ['b', 'a']
    with pytest.raises(ProbeError, match='no point "c" of stage "first"; there are: first/b, first/a'):
        again.delete('first', 'c')
    again.delete('first', 'b')
    assert [p.label for p in ProbeStore(tmp_path).points] == ['a']
    assert os.listdir(tmp_path) == [FILE_NAME]


def test_gravity_pair_is_kept(tmp_path):
    store = ProbeStore(tmp_path)
    assert store.gravity_pair() == (None, None)
    store.add(point('', 'gravity_lower', (0, 0, -1.0)))
    upper, lower = ProbeStore(tmp_path).gravity_pair()
    assert upper is None and np.allclose(lower, [0, 0, -1])


@pytest.mark.parametrize('damage', ['', '{"format": "cortshift probe', '[]', '{"format": "other", "unit": "m", "frame": "pmr"}',
                                    '{"format": "cortshift probe points, version 1", "unit": "mm", "frame": "pmr", "points": []}'])
def test_damaged_file_is_set_aside(tmp_path, damage):
    (tmp_path / FILE_NAME).write_text(damage)
    with pytest.raises(CaseError, match=FILE_NAME):
        read_points(tmp_path)
    store = ProbeStore(tmp_path)
    assert store.points == [] and 'damaged-1' in store.set_aside
    assert (tmp_path / (FILE_NAME + '.damaged-1')).read_text() == damage
    store.add(point())
    assert ProbeStore(tmp_path).points == [point()]


@pytest.mark.parametrize('stamp', ['1e999, 5', '-1, 5', '4294967296, 5', '1700000000, 1000000000'])   # the first found by script/fuzz
def test_a_stamp_that_is_none_is_damage(tmp_path, stamp):
    ProbeStore(tmp_path).add(point())
    text = (tmp_path / FILE_NAME).read_text()
    (tmp_path / FILE_NAME).write_text(re.sub(r'"stamp": \[[^]]*\]', f'"stamp": [{stamp}]', text))
    with pytest.raises(CaseError, match=FILE_NAME):
        read_points(tmp_path)
    assert ProbeStore(tmp_path).set_aside


def test_point_that_is_not_finite_is_damage(tmp_path):
    ProbeStore(tmp_path).add(point())
    content = json.loads((tmp_path / FILE_NAME).read_text())
    content['points'][0]['position'][1] = float('nan')
    (tmp_path / FILE_NAME).write_text(json.dumps(content))
    with pytest.raises(CaseError):
        read_points(tmp_path)


def test_failed_write_leaves_the_old_points(tmp_path, monkeypatch):
    store = ProbeStore(tmp_path)
    store.add(point(label='a'))

    def full_disk(_):
        raise OSError(28, 'No space left on device')
    monkeypatch.setattr(os, 'fsync', full_disk)
    with pytest.raises(OSError, match='No space'):
        store.add(point(label='b'))
    monkeypatch.undo()
    assert [p.label for p in store.points] == ['a']
    assert ProbeStore(tmp_path).points == store.points and os.listdir(tmp_path) == [FILE_NAME]


WRITER = '''
import sys
from cortshift_tracking.probe.points import ProbePoint
from cortshift_tracking.probe.store import ProbeStore
store = ProbeStore(sys.argv[1])
for n in range(len(store.points), 100000):
    store.add(ProbePoint("first", f"p{n}", (n, 0), (0.001 * n, 0.0, 0.0), 0.0003, 20))
    print(n, flush=True)
'''


def test_kill_at_any_instant_loses_no_acknowledged_point(tmp_path):
    random = np.random.default_rng(5)
    acknowledged = -1
    for _ in range(12):
        writer = subprocess.Popen([sys.executable, '-c', WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True)
        for _ in range(int(random.integers(1, 40))):
            acknowledged = int(writer.stdout.readline())
        writer.kill()
        rest = writer.stdout.read().split('\n')
        acknowledged = max([acknowledged] + [int(line) for line in rest if line])
        writer.wait()
        points = read_points(tmp_path)
        assert len(points) > acknowledged  # one more than was acknowledged may be there, none less
        assert [p.label for p in points] == [f'p{n}' for n in range(len(points))]


def test_stamps_of_the_run_before_are_forgotten():
    """A replay that is started again: its stamps lie before those of the run that ended."""
    node = ProbeNode.__new__(ProbeNode)   # without a master
    node._values, node._stamps, node._arrival = {'tip_frame': 'probe_tip'}, [], threading.Condition()

    def hear(*stamps):
        for stamp in stamps:
            tip = TransformStamped(child_frame_id='probe_tip')
            tip.header.stamp = rospy.Time.from_sec(stamp)
            node._note_tip(TFMessage([tip]))
        return [round(stamp.to_sec(), 3) for stamp in node._stamps]

    assert hear(100.0, 100.05, 100.04) == [100.0, 100.05, 100.04]   # one that comes late is no other run
    assert hear(10.0, 10.05) == [10.0, 10.05]
