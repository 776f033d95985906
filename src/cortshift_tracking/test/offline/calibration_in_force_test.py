"""A pair is rectified with the calibration in force at its exposure, whenever that was recorded: as the node does it."""
import glob

import numpy as np
import pytest
import rosbag
from cortshift_tracking.case.messages import stage_from_messages

import recorded_cases as cases
from offline_tools import run_tool

KEY = 'after_resection'
ASIDE = 2.0   # [px] that the later calibration has the right camera's centre aside: disparities grow by it


def captured(bag, output):
    """(stage, its camera_info of the right) of the pair at 12.2 s."""
    run_tool('process_bag', bag, '--capture', f'{KEY}@12.2', '--output', output, '--config', cases.CONFIG)
    path, = glob.glob(f'{output}/stages/*_{KEY}_*.bag')
    with rosbag.Bag(path) as stage:
        topics = {topic: message for topic, message, _ in stage.read_messages()}
    return stage_from_messages(topics['/stage/info'], topics['/surface/points']), topics['/stereo/right/camera_info']


def depths(stage):
    """Of each point in front of the left camera [m]."""
    return (stage.points - stage.T_pmr_left[:3, 3]) @ stage.T_pmr_left[:3, 2]


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    folder = str(tmp_path_factory.mktemp('recorded'))
    bag, _ = cases.record(folder, 'case')
    return bag, captured(bag, f'{folder}/out')


def with_one_change(source, target, exposure, since, late):
    """The recording with two camera_info of each camera: the first, and another calibration that holds `since` [s] after an
    exposure and comes `late` [s] after its pair."""
    told = set()

    def change(topic, message, time):
        if not topic.endswith('/camera_info'):
            return [(topic, message, time)]
        if topic not in told:
            told.add(topic)
            return [(topic, message, time)]
        if message.header.stamp.to_sec() != exposure:
            return []
        message.header.stamp = cases.seconds(exposure + since)
        message.K = list(message.K)
        message.K[2] += ASIDE if 'right' in topic else 0
        return [(topic, message, cases.seconds(time.to_sec() + late))]
    return cases.rewrite(source, target, change, order=lambda time: time)


@pytest.mark.parametrize('since, late, aside', [(-0.05, 0.3, ASIDE), (0.05, -0.3, 0.0)],
                         ids=['in force, recorded after the pair', 'not yet in force, recorded before the pair'])
def test_the_calibration_in_force_at_the_pair_counts(recorded, tmp_path, since, late, aside):
    bag, (before, info_before) = recorded
    changed = with_one_change(bag, str(tmp_path / 'case.bag'), before.stamp, since, late)
    stage, info = captured(changed, tmp_path / 'out')
    assert stage.stamp == before.stamp
    assert info.K[2] == info_before.K[2] + aside
    disparity = -info_before.P[3] / np.nanmedian(depths(before))
    ratio = depths(stage) / depths(before)
    assert np.isfinite(ratio).mean() > 0.5
    assert np.nanmedian(ratio) == pytest.approx(disparity / (disparity + aside), abs=2e-3)
