#!/usr/bin/python3
"""The probe node in a graph: a simulated tracker and a stand-in for the shift tracker's list of stages."""
import os
import shutil
import subprocess
import sys
import threading
import time
import unittest

import numpy as np
import rospy
import rostest
import tf2_ros
from cortshift_msgs.msg import StageInfo
from cortshift_msgs.srv import (DeletePoint, DigitizeGravity, DigitizePoint, ListPoints, ListStages, ListStagesResponse,
                                SetGravity, SetGravityResponse)
from cortshift_tracking.probe.store import read_points
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TransformStamped
from scipy.spatial.transform import Rotation

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import wait_until  # noqa: E402
from programs import program  # noqa: E402

T_PMR_REFERENCE = np.array([0.021, -0.113, 0.047]), Rotation.from_rotvec([0.2, 2.9, -0.6])
NOISE = 0.0003  # [m]
DOWN_PMR = np.array([0.3, -0.4, -0.86]) / np.linalg.norm([0.3, -0.4, -0.86])


def transform(translation, rotation, parent, child, stamp):
    message = TransformStamped()
    message.header.stamp, message.header.frame_id, message.child_frame_id = stamp, parent, child
    t, r = message.transform.translation, message.transform.rotation
    t.x, t.y, t.z = translation
    r.x, r.y, r.z, r.w = rotation.as_quat()
    return message


class Tracker:
    """Sends reference -> probe_tip at 20 Hz for a tip given in pmr, and a microscope that looks along DOWN_PMR.

    Stamps are 0.05 s apart however late a busy machine sends them, so that only what a test asks for looks like a dropout.
    """

    def __init__(self):
        self.tip_pmr = np.array([0.03, -0.02, 0.06])
        self.velocity = np.zeros(3)
        self.pattern = None  # (seconds visible, seconds hidden), repeated; None: always visible
        self.sent = 0
        self.stamp = rospy.Time.now()
        self._random = np.random.default_rng(3)
        self._broadcaster = tf2_ros.TransformBroadcaster()
        self._static = tf2_ros.StaticTransformBroadcaster()
        looking = Rotation.align_vectors([DOWN_PMR], [[0, 0, 1]])[0]
        self._static.sendTransform([
            transform(*T_PMR_REFERENCE, 'pmr', 'reference', self.stamp),
            transform(np.zeros(3), T_PMR_REFERENCE[1].inv() * looking, 'reference', 'left_optical', self.stamp)])
        threading.Thread(target=self._run, daemon=True).start()

    def hold(self, tip_pmr):
        """Moves the tip and waits until it has been seen there."""
        self.tip_pmr = np.array(tip_pmr)
        self.wait(4)

    def wait(self, samples):
        until = self.sent + samples
        wait_until(lambda: self.sent >= until, 20, 'samples of the tip')

    def show(self, pattern):
        self.pattern, self._phase = pattern, 0.0

    def _visible(self):
        if self.pattern is None:
            return True
        self._phase += 0.05
        return self._phase % sum(self.pattern) < self.pattern[0]

    def _run(self):
        while not rospy.is_shutdown():
            self.tip_pmr = self.tip_pmr + 0.05 * self.velocity
            self.stamp += rospy.Duration(0.05)
            if self._visible():
                tip = self.tip_pmr + self._random.normal(0, NOISE, 3)
                tip_reference = T_PMR_REFERENCE[1].inv().apply(tip - T_PMR_REFERENCE[0])
                turning = Rotation.from_rotvec(self._random.normal(0, 1, 3))  # the tip stays, the handle turns
                self._broadcaster.sendTransform(transform(tip_reference, turning, 'reference', 'probe_tip', self.stamp))
                self.sent += 1
            time.sleep(0.05)


class ProbeNode(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('test_probe_node')
        rospy.Service('/shift_tracker/list_stages', ListStages,
                      lambda _: ListStagesResponse([StageInfo(key='first'), StageInfo(key='second')]))
        cls.gravity, cls.refuse = [], False
        rospy.Service('/shift_tracker/set_gravity', SetGravity, cls.take_gravity)
        for name, kind in (('digitize_point', DigitizePoint), ('digitize_gravity', DigitizeGravity), ('list_points', ListPoints),
                           ('delete_point', DeletePoint)):
            rospy.wait_for_service(f'/probe/{name}', timeout=30)
            setattr(cls, name, staticmethod(rospy.ServiceProxy(f'/probe/{name}', kind)))

    @classmethod
    def take_gravity(cls, request):
        cls.gravity.append([request.gravity.x, request.gravity.y, request.gravity.z])
        return SetGravityResponse(not cls.refuse, 'gravity is set')

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(rospy.get_param('/probe/case'))

    def test_1_never_tracked(self):
        answer = self.digitize_point('first', 'too_early')
        self.assertFalse(answer.success)
        self.assertIn('not tracked', answer.message)
        ProbeNode.tracker = Tracker()
        self.tracker.wait(20)

    def test_2_points_in_pmr(self):
        for stage, place in (('first', [0.03, -0.02, 0.06]), ('second', [0.032, -0.021, 0.052])):
            self.tracker.hold(place)
            answer = self.digitize_point(stage, 'vein')
            self.assertTrue(answer.success, answer.message)
            position = answer.point.position
            error = np.linalg.norm(np.subtract([position.x, position.y, position.z], place))
            self.assertLess(error, 0.0005)
            self.assertGreater(answer.point.samples, 15)
            self.assertLess(abs((answer.point.stamp - self.tracker.stamp).to_sec()), 3.0)
            self.assertTrue(0.0002 < answer.point.spread < 0.0009)
        self.assertEqual([(p.stage, p.label) for p in self.list_points().points], [('first', 'vein'), ('second', 'vein')])

    def test_3_refusals(self):
        for stage, label, reason in (('third', 'vein', 'no stage "third".*first, second'), ('first', 'vein', 'exists already'),
                                     ('first', 'a b', 'use 1-64 of'), ('', 'vein', 'use 1-64 of')):
            answer = self.digitize_point(stage, label)
            self.assertFalse(answer.success)
            self.assertRegex(answer.message, reason)
        self.tracker.velocity = np.array([0.01, 0, 0])
        answer = self.digitize_point('first', 'moving')
        self.assertFalse(answer.success)
        self.assertIn('tip moves', answer.message)
        self.tracker.velocity = np.zeros(3)
        self.tracker.show((0.4, 60))
        answer = self.digitize_point('first', 'hidden')
        self.assertFalse(answer.success)
        self.assertRegex(answer.message, 'dropped|not tracked')
        self.tracker.show((0.6, 0.5))
        self.tracker.wait(5)
        answer = self.digitize_point('first', 'flickering')
        self.assertFalse(answer.success)
        self.assertRegex(answer.message, r'dropped for 0\.5')
        self.tracker.show(None)
        self.tracker.wait(5)
        self.assertEqual(len(self.list_points().points), 2)

    def test_4_gravity(self):
        upper = np.array([0.05, 0.02, 0.4])
        self.tracker.hold(upper)
        self.assertIn('use upper or lower', self.digitize_gravity('top').message)
        first = self.digitize_gravity('upper')
        self.assertTrue(first.success and not first.complete, first.message)
        self.assertTrue(np.isnan(first.gravity.x))
        sideways = np.cross(DOWN_PMR, [0, 1, 0])
        for place, reason in ((upper + 0.3 * sideways, 'horizontal'), (upper - 0.3 * DOWN_PMR, 'swapped'),
                              (upper + 0.01 * DOWN_PMR, 'mm apart')):
            self.tracker.hold(place)
            answer = self.digitize_gravity('lower')
            self.assertFalse(answer.success)
            self.assertIn(reason, answer.message)
        down = Rotation.from_rotvec([0.2, 0.1, 0]).apply(DOWN_PMR)
        self.tracker.hold(upper + 0.3 * down)
        second = self.digitize_gravity('lower')
        self.assertTrue(second.success and second.complete, second.message)
        measured = np.array([second.gravity.x, second.gravity.y, second.gravity.z])
        self.assertLess(np.degrees(np.arccos(measured @ down)), 0.2)
        self.assertEqual(len(self.gravity), 1)  # the shift tracker was told, once
        self.assertTrue(np.allclose(self.gravity[0], measured))
        self.assertIn('delete it first', self.digitize_gravity('lower').message)

        # A shift_tracker that comes back without gravity is told again; one that knows it is left alone.
        states = rospy.Publisher('/diagnostics', DiagnosticArray, queue_size=10)
        wait_until(lambda: states.get_num_connections() > 0, 20, 'the subscription of the probe node')
        for gravity in ('0.1 0.2 -0.9', 'not known', '0.1 0.2 -0.9'):
            states.publish(DiagnosticArray(status=[DiagnosticStatus(name='shift_tracker: state',
                                                                    values=[KeyValue('gravity', gravity)])]))
        wait_until(lambda: len(self.gravity) > 1, 20, 'the second hand-over')
        self.assertTrue(np.allclose(self.gravity[1], measured))
        type(self).refuse = True  # as where the case cannot be written: it is offered again, though not at once
        states.publish(DiagnosticArray(status=[DiagnosticStatus(name='shift_tracker: state',
                                                                values=[KeyValue('gravity', 'not known')])]))
        wait_until(lambda: len(self.gravity) > 2, 20, 'the third hand-over')
        type(self).refuse = False
        known = DiagnosticArray(status=[DiagnosticStatus(name='shift_tracker: state', values=[KeyValue('gravity', '1 0 0')])])

        def offered_again():
            states.publish(known)
            return len(self.gravity) > 3
        wait_until(offered_again, 30, 'the hand-over of what was not taken')
        self.assertEqual(len(self.gravity), 4)

    def test_5_deleting_and_the_file(self):
        self.assertIn('there are: first/vein', self.delete_point('first', 'artery').message)
        self.assertTrue(self.delete_point('second', 'vein').success)
        self.assertTrue(self.delete_point('', 'gravity_lower').success)
        folder = rospy.get_param('/probe/case')
        self.assertEqual([(p.stage, p.label) for p in read_points(folder)], [('first', 'vein'), ('', 'gravity_upper')])

    def test_6_faulty_parameters_stop_the_node(self):
        for arguments, reason in (([], 'probe_bad/case is missing'), (['_case:=/tmp', '_window:=-1'], 'allowed is 0.2 ... 10.0'),
                                  (['_case:=/tmp', '_wind:=1'], 'probe_bad/wind is unknown')):
            for key in ('case', 'window', 'wind'):
                if rospy.has_param(f'/probe_bad/{key}'):
                    rospy.delete_param(f'/probe_bad/{key}')
            run = subprocess.run([program('probe'), '__name:=probe_bad'] + arguments, stdout=subprocess.PIPE,
                                 stderr=subprocess.STDOUT, universal_newlines=True, timeout=60)
            self.assertEqual(run.returncode, 1, run.stdout)
            self.assertIn(reason, run.stdout)

    def test_7_diagnostics(self):
        seen = []
        rospy.Subscriber('/diagnostics', DiagnosticArray, lambda message: seen.extend(message.status))
        wait_until(lambda: any(s.message == 'tip tracked' for s in seen), 20, 'a report on the tip')


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'probe_node', ProbeNode)
