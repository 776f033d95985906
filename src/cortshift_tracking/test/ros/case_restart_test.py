#!/usr/bin/python3
"""A shift_tracker that is killed and started again on its case folder: what it knew is there, and nothing is shown that is not."""
import os
import shutil
import signal
import sys
import tempfile
import unittest

import numpy as np
import rospy
import rostest
from geometry_msgs.msg import Point32, Polygon, Vector3
from sensor_msgs.msg import PointCloud2

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import Diagnostics, TrackerProcess, field_arrays  # noqa: E402
from sheet import SIZE, SheetSource, sheet  # noqa: E402

LIFT = 0.001       # m, of the later surface
STATE = 'shift_tracker: state'
COARSE = {'resolution': 0.0004, 'coarse_resolution': 0.0004, 'capture_timeout': 5.0}
SQUARE = [[0.025, 0.025], [0.035, 0.025], [0.035, 0.035], [0.025, 0.035]]  # m, in the projection frame: the middle of the sheet
OUTLINE = [[0.01, 0.01], [0.04, 0.01], [0.04, 0.05], [0.01, 0.05]]


class CaseRestart(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('case_restart')
        cls.diagnostics = Diagnostics()
        cls.surfaces = SheetSource(cls.diagnostics)

    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix='cortshift_restart_')
        self.addCleanup(shutil.rmtree, self.folder)
        self.node = TrackerProcess()
        self.addCleanup(lambda: self.node.is_running() and self.node.end(signal.SIGKILL))

    def start(self, **parameters):
        self.tracker = self.node.start(case_folder=self.folder, **COARSE, **parameters)
        self.surfaces.connect()

    def capture(self, key, lift=0.0):
        self.surfaces.send(lift)
        answer = self.tracker.capture_stage(key, '')
        self.assertTrue(answer.success, answer.message)

    def compute(self, from_key, to_key):
        answer = self.tracker.compute_shift(from_key, to_key)
        self.assertTrue(answer.success, answer.message)
        return answer.summary

    def test_stages_gravity_and_exclusions_are_there_again(self):
        self.start(surround='off')  # all of the sheet is lifted, what lies around the outline too
        self.diagnostics.wait_for(STATE, gravity='not known', gravity_from='', excluded_stages='', live='off')
        self.capture('a')
        self.capture('b', LIFT)
        whole = self.compute('a', 'b')
        self.assertTrue(np.isnan(whole.gravity_mean))
        self.assertTrue(self.tracker.set_gravity(Vector3(0, 0, -2)).success)
        answer = self.tracker.exclude_regions('a', [Polygon([Point32(x, y, 0) for x, y in SQUARE])])
        self.assertTrue(answer.success, answer.message)
        answer = self.tracker.set_outline('a', [Polygon([Point32(x, y, 0) for x, y in OUTLINE])])
        self.assertTrue(answer.success, answer.message)
        before = self.compute('a', 'b')
        self.assertGreater(before.brain_points, 0)
        self.assertLess(before.brain_points, before.valid_points)
        self.assertEqual(before.outline, 'drawn by hand')
        self.assertEqual(whole.brain_points, 0)
        self.assertIn('not known', whole.outline)
        self.assertAlmostEqual(before.gravity_mean, -LIFT, delta=2e-5)
        self.assertLess(before.valid_points, whole.valid_points)
        self.assertTrue(self.tracker.track('a', True).success)
        self.diagnostics.wait_for(STATE, gravity='0.0000 0.0000 -1.0000', gravity_from='set_gravity', excluded_stages='a',
                                  live='on', live_from='a')
        self.node.end(signal.SIGKILL)

        self.start(surround='off')
        self.assertEqual([s.key for s in self.tracker.list_stages().stages], ['a', 'b'])
        state = self.diagnostics.wait_for(STATE, gravity='0.0000 0.0000 -1.0000', gravity_from='kept with the case',
                                          excluded_stages='a', live='on', live_from='a')
        self.assertEqual(state['message'], 'live from a')
        self.assertTrue(self.tracker.track('', False).success)
        after = self.compute('a', 'b')
        def numbers(summary):
            return (summary.valid_points, summary.gravity_mean, summary.magnitude_mean, summary.brain_points,
                    summary.brain_magnitude_mean, summary.brain_gravity_mean, summary.outline, summary.common_sd)
        self.assertEqual(numbers(after), numbers(before))

        # What was drawn on a stage goes with it, over a restart too; and so does live mode.
        self.assertTrue(self.tracker.track('a', True).success)
        self.assertTrue(self.tracker.delete_stage('a').success)
        with open(os.path.join(self.folder, 'case_log.txt'), encoding='utf-8') as file:
            self.assertRegex(file.read(), r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ deleted stage 'a', captured \S+Z, asked by /case_restart\S*\n$")
        self.node.end(signal.SIGKILL)
        self.start(gravity=[0.0, -1.0, 0.0])
        self.capture('a')
        self.capture('c', LIFT)
        self.diagnostics.wait_for(STATE, gravity='0.0000 0.0000 -1.0000', excluded_stages='', live='off',
                                  gravity_from='the parameter gravity, 90.0 degrees from it, does not count')
        self.assertEqual(self.compute('a', 'c').valid_points, whole.valid_points)
        self.assertEqual(self.node.end(), 0)

    def test_the_file_of_exclusions_and_own_points(self):
        path = os.path.join(self.folder, 'excluded.yaml')
        with open(path, 'w', encoding='utf-8') as file:
            file.write(f'a: [{SQUARE}]\n')
        self.start(exclusions=path, own_points=True, gravity=[0.0, 0.0, -1.0])
        for key, lift in (('a', 0.0), ('other', 0.0), ('b', LIFT)):
            self.capture(key, lift)
        state = self.diagnostics.wait_for(STATE, excluded_stages='a', gravity_from='the parameter gravity')
        self.assertEqual(state['excluded_stages'], 'a')
        self.compute('other', 'b')
        self.compute('a', 'b')
        row = column = int(0.03 / 0.0004)  # the middle of the square
        self.assertTrue(np.isnan(field_arrays(self.tracker.field('a', 'b'))[1][row, column]).all())
        whole = field_arrays(self.tracker.field('other', 'b'))[1]
        self.assertTrue(np.isfinite(whole[row, column]).all())

        own = rospy.wait_for_message('/shift/own_points', PointCloud2, timeout=20)
        self.assertEqual((own.height, own.width), (SIZE, SIZE))
        self.assertEqual([f.name for f in own.fields[:6]], ['x', 'y', 'z', 'dx', 'dy', 'dz'])
        values = np.frombuffer(own.data, np.float32).reshape(SIZE, SIZE, own.point_step // 4)
        self.assertEqual(own.header.stamp, self.tracker.field('a', 'b').header.stamp)
        there = np.isfinite(values[..., 3])
        self.assertGreater(there.mean(), 0.5)
        self.assertLess(np.abs(values[there][:, 3:6] - [0, 0, LIFT]).max(), 1e-4)
        surface = np.frombuffer(sheet(rospy.Time()).data, np.float32).reshape(SIZE, SIZE, 5)
        self.assertTrue((values[there][:, :3] == surface[there][:, :3]).all())
        self.assertFalse(there[SIZE // 2, SIZE // 2])  # in the excluded square

    def test_a_case_state_that_is_damaged_is_named(self):
        with open(os.path.join(self.folder, 'case_state.json'), 'w', encoding='utf-8') as file:
            file.write('{"format": "cort')
        self.start()
        state = self.diagnostics.wait_for(STATE, message='case_state.json is damaged', gravity='not known')
        self.assertIn('give gravity and excluded regions again', state['message'])


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'case_restart', CaseRestart)
