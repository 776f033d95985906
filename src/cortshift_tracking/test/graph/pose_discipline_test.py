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
        self.wait_for_pose(lambda level, text, values: text == 'ok' and float(values.get('speed_mm_per_s', 9)) < 0.5,
                           'a microscope that is seen and stands still')

    def wait_for_pose(self, condition, what):
        """Until shift_tracker's diagnostics of the pose, from now on, are as said."""
        self.status.pop('shift_tracker: pose', None)
        wait_until(lambda: 'shift_tracker: pose' in self.status and condition(*self.status['shift_tracker: pose']), 30, what)

    def accepted(self, key):
        answer = self.tracker.capture_stage(key, '')
        self.assertTrue(answer.success, answer.message)
        return answer.stage

    def settled(self, key):
        """The stage, as soon as a capture is no longer refused for a change of the registration."""
        answers = []

        def captured():
            answers.append(self.tracker.capture_stage(key, ''))
            return answers[-1].success
        wait_until(captured, 30, 'a registration that is settled')
        for answer in answers[:-1]:
            self.assertIn('registration changed', answer.message)
        return answers[-1].stage

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
        self.wait_for_pose(lambda level, text, values: 'moves' in text and float(values['speed_mm_per_s']) > 19, 'a movement')
        self.refused('moving', r'moved at (19|20|21)\.\d mm/s .*max_speed is 5.0 mm/s.*capture again')
        self.tool.speed, self.tool.turn = 0.0, 0.05  # the microscope stays, what it looks at moves by 15 mm/s
        self.wait_for_pose(lambda level, text, values: 'moves' in text and float(values['speed_mm_per_s']) < 17, 'a turn')
        self.refused('turning', r'moved at (14|15|16)\.\d mm/s')

    def test_a_slow_drift_with_jitter(self):
        self.tool.speed, self.tool.jitter = 0.001, 0.0002
        self.wait_for_pose(lambda level, text, values: 0.1 < float(values.get('jitter_mm', 0)) < 0.6, 'its jitter')
        self.accepted('drifting')

    def test_hidden_tool_is_refused_before_anything_is_fired(self):
        self.accepted('seen')
        self.tool.hidden = True
        self.wait_for_pose(lambda level, text, values: 'not known' in text or
                           'does not see' in text and float(values['pose_age_s']) > 1.1, 'a tool that is hidden')
        fired = self.triggers
        self.refused('hidden', r'has not seen the microscope for .* s; clear its line of sight')
        self.assertEqual(self.triggers, fired)

    def test_tool_that_is_hidden_at_the_exposure(self):
        self.accepted('before')
        type(self).hide_at_exposure = True
        self.addCleanup(setattr, type(self), 'hide_at_exposure', False)
        self.refused('blinking', 'did not see the microscope when the pair was exposed')

    def test_registration_makes_epochs(self):
        self.addCleanup(self.fixed.sendTransform, transform('pmr', 'reference', (0.1, 0.2, 0.3)))
        self.assertEqual(self.accepted('first').epoch, 1)
        self.fixed.sendTransform(transform('pmr', 'reference', (0.1, 0.2, 0.302)))
        self.refused('mixed', 'registration changed at .*capture again')
        self.assertEqual(self.settled('second').epoch, 2)
        answer = self.tracker.compute_shift('first', 'second')
        self.assertFalse(answer.success)
        self.assertRegex(answer.message, r"registration changed between 'first' \(epoch 1\) and 'second' \(epoch 2\)")
        across = rospy.ServiceProxy('/shift_tracker/compute_shift_across_epochs', ComputeShift)
        answer = across('first', 'second')
        self.assertTrue(answer.success, answer.message)
        self.assertEqual(self.tracker.field('first', 'second').to_key, 'second')
        self.fixed.sendTransform(transform('pmr', 'reference', (0.1, 0.2, 0.3)))
        self.assertEqual(self.settled('third').epoch, 1)
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
