#!/usr/bin/python3
"""shift_tracker with a tracker, cameras and a reconstruction that the test plays: which poses make a stage, and epochs."""
import math
import os
import sys
import threading
import time
import unittest

import numpy as np
import rospy
import rostest
import tf2_ros
from cortshift_msgs.srv import ComputeShift, TriggerCapture, TriggerCaptureResponse
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import PointCloud2

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import ShiftTracker, wait_until  # noqa: E402
from sheet import sheet  # noqa: E402

RATE = 20.0  # of the tracker [Hz]


def transform(parent, child, translation, angle=0.0, stamp=None):
    """Pose of the child, turned about x."""
    message = TransformStamped()
    message.header.frame_id, message.child_frame_id = parent, child
    message.header.stamp = stamp or rospy.Time.now()
    t, q = message.transform.translation, message.transform.rotation
    t.x, t.y, t.z = translation
    q.x, q.w = math.sin(angle / 2), math.cos(angle / 2)
    return message


class Tracker:
    """reference -> microscope at 20 Hz, moving as told; None: hidden."""

    def __init__(self):
        self.speed, self.turn, self.jitter = 0.0, 0.0, 0.0  # m/s along x, rad/s about x, m
        self.hidden = False
        self._broadcaster = tf2_ros.TransformBroadcaster()
        self._random = np.random.default_rng(3)
        self._place = np.array([0.0, 0.0])  # m, rad
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self):
        last, due = time.time(), time.time()
        while not rospy.is_shutdown():
            due += 1 / RATE
            time.sleep(max(0.0, due - time.time()))
            now = time.time()
            self._place += np.array([self.speed, self.turn]) * (now - last)
            last = now
            if not self.hidden:
                noise = self._random.normal(0, max(self.jitter, 1e-6), 3)  # no tracker says one pose twice to the last bit
                self._broadcaster.sendTransform(transform('reference', 'microscope', noise + [self._place[0], 0.1, 0.2],
                                                          self._place[1], rospy.Time.from_sec(now)))


class PoseDiscipline(unittest.TestCase):
    hide_at_exposure = False

    @classmethod
    def setUpClass(cls):
        rospy.init_node('pose_discipline')
        cls.fixed = tf2_ros.StaticTransformBroadcaster()
        cls.fixed.sendTransform([transform('pmr', 'reference', (0.1, 0.2, 0.3)),
                                 transform('microscope', 'left_optical', (0.01, 0.02, 0.03)),
                                 transform('left_optical', 'right_optical', (0.025, 0, 0))])
        cls.tool = Tracker()
        cls.surfaces = rospy.Publisher('/surface/points', PointCloud2, queue_size=2)
        cls.status = {}
        rospy.Subscriber('/diagnostics', DiagnosticArray, cls.diagnose)
        cls.tracker = ShiftTracker()
        wait_until(lambda: cls.surfaces.get_num_connections() > 0, 20, 'subscription')
        cls.triggers = 0
        rospy.Service('/stereo_driver/trigger', TriggerCapture, cls.trigger)
        time.sleep(1)

    @classmethod
    def trigger(cls, _):
        cls.triggers += 1
        stamp = rospy.Time.now()
        if cls.hide_at_exposure:
            cls.tool.hidden = True
            stamp += rospy.Duration(0.1)
        threading.Timer(0.7, lambda: cls.surfaces.publish(sheet(stamp))).start()
        return TriggerCaptureResponse(True, '', stamp)

    @classmethod
    def diagnose(cls, message):
        for status in message.status:
            cls.status[status.name] = (status.level, status.message, {v.key: v.value for v in status.values})

    def setUp(self):
        self.tool.speed = self.tool.turn = self.tool.jitter = 0.0
        self.tool.hidden = False
        time.sleep(1.0)

    def accepted(self, key):
        answer = self.tracker.capture_stage(key, '')
        self.assertTrue(answer.success, answer.message)
        return answer.stage

    def refused(self, key, pattern):
        answer = self.tracker.capture_stage(key, '')
        self.assertFalse(answer.success)
        self.assertRegex(answer.message, pattern)
        self.assertNotIn(key, [s.key for s in self.tracker.list_stages().stages])

    def test_a_still_microscope(self):
        stage = self.accepted('still')
        self.assertEqual(stage.epoch, 1)
        p = stage.registration.position
        self.assertEqual((p.x, p.y, p.z), (0.1, 0.2, 0.3))

    def test_moving_and_turning_microscope(self):
        self.tool.speed = 0.020
        time.sleep(0.5)
        self.refused('moving', r'moved at (19|20|21)\.\d mm/s .*max_speed is 5.0 mm/s.*capture again')
        self.tool.speed, self.tool.turn = 0.0, 0.05  # the microscope stays, what it looks at moves by 15 mm/s
        time.sleep(0.5)
        self.refused('turning', r'moved at \d+\.\d mm/s')
        wait_until(lambda: 'moves' in self.status['shift_tracker: pose'][1], 10, 'diagnostics of the movement')

    def test_a_slow_drift_with_jitter(self):
        self.tool.speed, self.tool.jitter = 0.001, 0.0002
        time.sleep(0.6)
        self.accepted('drifting')
        wait_until(lambda: 0.1 < float(self.status['shift_tracker: pose'][2].get('jitter_mm', 0)) < 0.6, 10, 'its jitter')

    def test_hidden_tool_is_refused_before_anything_is_fired(self):
        wait_until(lambda: 'pose_age_s' in self.status['shift_tracker: pose'][2], 10, 'a pose')
        self.accepted('seen')
        self.tool.hidden = True
        time.sleep(2)
        fired = self.triggers
        self.refused('hidden', r'has not seen the microscope for .* s; clear its line of sight')
        self.assertEqual(self.triggers, fired)
        wait_until(lambda: 'does not see' in self.status['shift_tracker: pose'][1]
                   or 'not known' in self.status['shift_tracker: pose'][1], 10, 'diagnostics of the hidden tool')

    def test_tool_that_is_hidden_at_the_exposure(self):
        self.accepted('before')
        type(self).hide_at_exposure = True
        self.addCleanup(setattr, type(self), 'hide_at_exposure', False)
        self.refused('blinking', 'did not see the microscope when the pair was exposed')

    def test_registration_makes_epochs(self):
        self.assertEqual(self.accepted('first').epoch, 1)
        self.fixed.sendTransform(transform('pmr', 'reference', (0.1, 0.2, 0.302)))
        time.sleep(0.1)
        self.refused('mixed', 'registration changed at .*capture again')
        time.sleep(1)
        self.assertEqual(self.accepted('second').epoch, 2)
        answer = self.tracker.compute_shift('first', 'second')
        self.assertFalse(answer.success)
        self.assertRegex(answer.message, r"registration changed between 'first' \(epoch 1\) and 'second' \(epoch 2\)")
        across = rospy.ServiceProxy('/shift_tracker/compute_shift_across_epochs', ComputeShift)
        answer = across('first', 'second')
        self.assertTrue(answer.success, answer.message)
        self.assertEqual(self.tracker.field('first', 'second').to_key, 'second')
        self.fixed.sendTransform(transform('pmr', 'reference', (0.1, 0.2, 0.3)))
        time.sleep(1.2)
        self.assertEqual(self.accepted('third').epoch, 1)
        answer = self.tracker.compute_shift('first', 'third')
        self.assertTrue(answer.success, answer.message)
        self.assertLess(answer.summary.magnitude_mean, 1e-5)

    def test_diagnostics_of_the_case(self):
        self.accepted('last')
        wait_until(lambda: self.status['shift_tracker: case'][2].get('last_stage') == 'last', 10, 'the last stage')
        values = self.status['shift_tracker: case'][2]
        self.assertGreater(float(values['disk_left_GB']), 0)
        self.assertEqual(values['stages'], str(len(self.tracker.list_stages().stages)))


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'pose_discipline', PoseDiscipline)
