#!/usr/bin/python3
"""Captures under a zoom lens: stages at different settings compare, refusals quote the calibrated range, and a stage
may be the mean of several pairs."""
import os
import sys
import unittest

import rospy
import rostest
from cortshift_msgs.srv import CaptureMeanStage, SetPhantomStage
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import ShiftTracker


class ZoomCapture(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.tracker = ShiftTracker()
        cls.capture_mean = rospy.ServiceProxy('/shift_tracker/capture_mean_stage', CaptureMeanStage)
        for name in ('/stereo_driver/set_stage', '/surface_reconstruction/average_pairs', cls.capture_mean.resolved_name):
            rospy.wait_for_service(name, timeout=60)
        cls.set_stage = rospy.ServiceProxy('/stereo_driver/set_stage', SetPhantomStage)

    def go_to(self, stage):
        moved = self.set_stage(stage)
        self.assertTrue(moved.success, moved.message)

    def test_a_mean_at_one_setting_and_one_pair_at_another_show_no_shift(self):
        self.go_to('reference')
        mean = self.capture_mean('at_reference', '', 4)
        self.assertTrue(mean.success, mean.message)
        self.assertIn('mean of 4 pairs', mean.message)
        self.assertEqual(mean.stage.key, 'at_reference')
        self.go_to('zoomed_in')
        single = self.tracker.capture_stage('zoomed_in', '')
        self.assertTrue(single.success, single.message)
        self.assertAlmostEqual(single.stage.settings.magnification, 1.25)
        shift = self.tracker.compute_shift('at_reference', 'zoomed_in')
        self.assertTrue(shift.success, shift.message)
        print(shift.message)
        self.assertLess(shift.summary.magnitude_mean, 0.15e-3)  # it is the same cortex

    def test_beyond_the_calibrated_settings_captures_are_refused_with_the_range(self):
        self.go_to('beyond')
        for refused in (self.tracker.capture_stage('beyond', ''), self.capture_mean('beyond', '', 2)):
            self.assertFalse(refused.success)
            self.assertIn('magnification 1.7', refused.message)
            self.assertIn('magnification 0.75 to 1.4, focal length 255 to 348 mm', refused.message)
        self.assertNotIn('beyond', [stage.key for stage in self.tracker.list_stages().stages])

    def test_means_that_cannot_be_are_refused(self):
        self.go_to('reference')
        for pairs in (0, 65):
            refused = self.capture_mean('many', '', pairs)
            self.assertFalse(refused.success)
            self.assertIn(f'a mean of {pairs} pairs is not possible; allowed is 2 to 64', refused.message)
        self.assertTrue(self.capture_mean('one', '', 1).success)
        self.assertIn('exists', self.capture_mean('one', '', 2).message)


if __name__ == '__main__':
    rospy.init_node('test_zoom_capture')
    rostest.rosrun('cortshift_tracking', 'zoom_capture', ZoomCapture)
