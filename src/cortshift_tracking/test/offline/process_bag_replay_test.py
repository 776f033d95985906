#!/usr/bin/python3
"""The same case through replay.launch and through process_bag: the same stages and the same fields."""
import os
import sys
import tempfile
import unittest

import numpy as np
import rosbag
import rospy
import rostest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import Player, ShiftTracker, field_arrays  # noqa: E402
from offline_tools import PHANTOM_BAG, read_field, run_tool  # noqa: E402

# [s] from the bag's start; 2.5: before the first pair, so that the next one is taken
CAPTURES = (('first', 2.5), ('dural_opening', 5.2), ('early_resection', 12.2), ('after_resection', 21.2))
SHIFTS = (('first', 'after_resection'), ('dural_opening', 'early_resection'), ('early_resection', 'after_resection'))
AGREEMENT = 1e-6  # [m]


class ProcessBagReplay(unittest.TestCase):
    def test_agreement(self):
        rospy.init_node('test_process_bag_replay', disable_rostime=True)
        with rosbag.Bag(PHANTOM_BAG) as bag:
            start = bag.get_start_time()
        tracker = ShiftTracker()
        player = Player(PHANTOM_BAG)
        self.addCleanup(player.stop)
        stages = {}
        for key, seconds in CAPTURES:
            player.wait_for(start + seconds)
            answer = tracker.capture_stage(key, '')
            self.assertTrue(answer.success, answer.message)
            stages[key] = answer.stage
        with tempfile.TemporaryDirectory() as folder:
            output = os.path.join(folder, 'case')
            run_tool('process_bag', PHANTOM_BAG, '--capture', *(f'{key}@{seconds}' for key, seconds in CAPTURES),
                     '--shift', *(':'.join(pair) for pair in SHIFTS), '--output', output)
            for pair in SHIFTS:
                answer = tracker.compute_shift(*pair)
                self.assertTrue(answer.success, answer.message)
                self._compare(tracker.field(*pair), read_field(os.path.join(output, '__'.join(pair) + '.bag')), stages)

    def _compare(self, replayed, offline, stages):
        self.assertEqual(offline.from_stamp.to_nsec(), stages[offline.from_key].stamp.to_nsec())
        self.assertEqual(offline.to_stamp.to_nsec(), stages[offline.to_key].stamp.to_nsec())
        self.assertEqual((offline.from_key, offline.to_key), (replayed.from_key, replayed.to_key))
        self.assertEqual((offline.points.height, offline.points.width), (replayed.points.height, replayed.points.width))
        for ours, theirs in zip(field_arrays(offline), field_arrays(replayed)):
            valid = np.isfinite(ours)
            self.assertTrue((valid == np.isfinite(theirs)).all())
            self.assertGreater(valid.mean(), 0.3)
            self.assertLess(np.abs(ours - theirs)[valid].max(), AGREEMENT)
        self.assertEqual(offline.summary.valid_points, replayed.summary.valid_points)
        self.assertLess(abs(offline.summary.magnitude_mean - replayed.summary.magnitude_mean), AGREEMENT)


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'process_bag_replay', ProcessBagReplay)
