#!/usr/bin/python3
"""phantom.launch: stages captured by service, fields against the phantom's truth, and requests that must be refused."""
import os
import pathlib
import sys
import tempfile
import unittest

import rospy
import rostest
from cortshift_msgs.srv import SetPhantomStage
from sensor_msgs.msg import Image

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import ShiftTracker, error_of_phantom_field  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parents[4]
CASE = str(ROOT / 'config/phantom/phantom_case.yaml')
STAGES = ('dural_opening', 'early_resection', 'after_resection')


class PhantomGraph(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('test_phantom_graph')
        cls.tracker = ShiftTracker(120)
        rospy.wait_for_service('/stereo_driver/set_stage', timeout=120)
        set_stage = rospy.ServiceProxy('/stereo_driver/set_stage', SetPhantomStage)
        for stage in STAGES:
            for answer in (set_stage(stage), cls.tracker.capture_stage(stage, 'test')):
                assert answer.success, answer.message

    def shift(self, from_key, to_key):
        answer = self.tracker.compute_shift(from_key, to_key)
        self.assertTrue(answer.success, answer.message)
        return answer.summary, self.tracker.field(from_key, to_key)

    def test_first_to_third_against_truth(self):
        summary, field = self.shift(STAGES[0], STAGES[2])
        with tempfile.TemporaryDirectory() as folder:
            error = error_of_phantom_field(CASE, STAGES[0], STAGES[2], field, folder)
        self.assertLess(error['error_median_mm'], 0.033)
        self.assertLess(error['error_p95_mm'], 0.115)
        self.assertGreater(error['coverage'], 0.95)
        self.assertLess(summary.normal_mean, 0)     # it sags
        self.assertGreater(summary.gravity_mean, 0)
        self.assertGreater(summary.gravity_normal_angle, 2.0)
        self.assertEqual(field.header.stamp, field.to_stamp)
        self.assertLess(field.from_stamp, field.to_stamp)

    def test_history_is_in_order_of_capture(self):
        stages = self.tracker.list_stages().stages
        self.assertEqual(tuple(s.key for s in stages[:3]), STAGES)
        self.assertTrue(all(s.coverage > 0.9 and s.valid_points > 700000 for s in stages[:3]))

    def test_pictures_are_published(self):
        self.shift(STAGES[0], STAGES[1])
        for topic in ('/shift/overlay_before', '/shift/overlay_after', '/shift/magnitude'):
            picture = rospy.wait_for_message(topic, Image, timeout=20)
            self.assertEqual(picture.encoding, 'bgr8')
            self.assertGreater(len(set(picture.data)), 50)

    def refused(self, answer, *words):
        self.assertFalse(answer.success)
        for word in words:
            self.assertIn(word, answer.message)

    def test_bad_requests_are_refused_and_the_graph_goes_on(self):
        self.refused(self.tracker.compute_shift(STAGES[0], 'nowhere'), 'nowhere', STAGES[0])
        self.refused(self.tracker.compute_shift(STAGES[0], STAGES[0]), STAGES[0], 'different')
        self.refused(self.tracker.compute_shift(STAGES[2], STAGES[0]), STAGES[2], 'swap')
        self.refused(self.tracker.capture_stage(STAGES[0], ''), STAGES[0])
        self.refused(self.tracker.delete_stage('nowhere'), 'nowhere')
        for malformed in ('', 'a b', 'ä', 'x' * 65, '../x'):
            self.refused(self.tracker.capture_stage(malformed, ''), 'A-Z')
        answer = self.tracker.capture_stage('once_more', '')
        self.assertTrue(answer.success, answer.message)
        self.assertTrue(self.tracker.delete_stage('once_more').success)


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'phantom_graph', PhantomGraph)
