#!/usr/bin/python3
"""A driver and a reconstruction that do not answer: requests end, say why, and hold nobody else up."""
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
import unittest

import rospy
import rostest
from cortshift_msgs.srv import AveragePairs, AveragePairsResponse, TriggerCapture, TriggerCaptureResponse
from geometry_msgs.msg import Vector3

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import Diagnostics, TrackerProcess, wait_until  # noqa: E402
from sheet import SheetSource  # noqa: E402

TIMEOUT = 3.0  # s, capture_timeout


class HungNodes(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('hung_nodes')
        cls.folder = tempfile.mkdtemp(prefix='cortshift_hung_')
        cls.surfaces = SheetSource(Diagnostics())
        cls.node = TrackerProcess()
        cls.tracker = cls.node.start(case_folder=cls.folder, capture_timeout=TIMEOUT, resolution=0.0004, coarse_resolution=0.0004)
        cls.surfaces.connect()
        for key in ('first', 'second'):
            cls.surfaces.send()
            assert cls.tracker.capture_stage(key, '').success

    @classmethod
    def tearDownClass(cls):
        cls.node.end(signal.SIGKILL)
        shutil.rmtree(cls.folder)

    def offer(self, name, kind, response):
        """A service that answers only when the returned event is set; counts[0] is how many calls wait."""
        go_on, calls = threading.Event(), []

        def hang(_):
            calls.append(time.monotonic())
            go_on.wait(120)
            return response
        service = rospy.Service(name, kind, hang)
        self.addCleanup(service.shutdown)
        self.addCleanup(go_on.set)
        return go_on, calls

    def in_background(self, call):
        """A thread that makes a call, and the list that its answer comes into."""
        answers = []
        thread = threading.Thread(target=lambda: answers.append(call()), daemon=True)
        thread.start()
        return thread, answers

    def test_a_hung_driver(self):
        go_on, calls = self.offer('/stereo_driver/trigger', TriggerCapture, TriggerCaptureResponse(False, 'too late', rospy.Time()))
        waiting, answers = self.in_background(lambda: self.tracker.capture_stage('hung', ''))
        wait_until(lambda: calls, 30, 'the call of the driver')
        # While one capture waits, others are refused at once and everything else is answered.
        for key in ('x', 'y', 'z'):
            answer = self.tracker.capture_stage(key, '')
            self.assertFalse(answer.success)
            self.assertIn(f"stage '{key}' was not captured: a capture of 'hung' is under way", answer.message)
        self.assertEqual([s.key for s in self.tracker.list_stages().stages], ['first', 'second'])
        self.assertTrue(self.tracker.set_gravity(Vector3(0, 0, -1)).success)
        self.assertFalse(answers)
        answer = self.tracker.compute_shift('first', 'second')
        self.assertTrue(answer.success, answer.message)
        waiting.join(60)
        self.assertFalse(answers[0].success)
        self.assertRegex(answers[0].message, "'hung' was not captured: the driver did not answer /stereo_driver/trigger")
        # Its call is still out: no second one is made.
        for _ in range(3):
            answer = self.tracker.capture_stage('again', '')
            self.assertFalse(answer.success)
            self.assertRegex(answer.message, r'the driver still has not answered the call of /stereo_driver/trigger [\d.]+ s ago')
        self.assertEqual(len(calls), 1)
        go_on.set()
        wait_until(lambda: 'the driver took no pair: too late' in self.tracker.capture_stage('again', '').message, 30,
                   'a new call of the driver')

    def test_a_hung_reconstruction(self):
        _, calls = self.offer('/surface_reconstruction/average_pairs', AveragePairs, AveragePairsResponse())
        waiting, answers = self.in_background(lambda: self.tracker.capture_mean_stage('mean', '', 4))
        wait_until(lambda: calls, 30, 'the call of the reconstruction')
        self.assertIn("a capture of 'mean' is under way", self.tracker.capture_stage('x', '').message)
        waiting.join(20 * TIMEOUT)
        self.assertTrue(answers, 'it waits without end')
        self.assertRegex(answers[0].message, "'mean' was not captured: the reconstruction did not answer .*average_pairs")
        answer = self.tracker.capture_mean_stage('mean', '', 4)
        self.assertRegex(answer.message, 'the reconstruction still has not answered the call of .*average_pairs')
        self.assertEqual(len(calls), 1)
        self.surfaces.send()  # single pairs do not need it
        answer = self.tracker.capture_stage('single', '')
        self.assertTrue(answer.success, answer.message)
        self.assertTrue(self.tracker.delete_stage('single').success)


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'hung_nodes', HungNodes)
