#!/usr/bin/python3
"""shift_tracker while simulated time is near zero and the pose of the camera is known."""
import os
import shutil
import signal
import sys
import tempfile
import unittest

import rospy
import rostest
import tf2_ros
from geometry_msgs.msg import TransformStamped
from rosgraph_msgs.msg import Clock

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import Diagnostics, TrackerProcess, wait_until  # noqa: E402


class ClockZero(unittest.TestCase):
    def test_it_lives(self):
        rospy.init_node('clock_zero')
        clock = rospy.Publisher('/clock', Clock, queue_size=1, latch=True)
        folder = tempfile.mkdtemp(prefix='cortshift_zero_')
        self.addCleanup(shutil.rmtree, folder)
        clock.publish(rospy.Time(0, 1000000))
        edge = TransformStamped()
        edge.header.frame_id, edge.child_frame_id, edge.transform.rotation.w = 'pmr', 'left_optical', 1
        fixed = tf2_ros.StaticTransformBroadcaster()
        fixed.sendTransform(edge)
        diagnostics, node = Diagnostics(), TrackerProcess()
        tracker = node.start(case_folder=folder)
        self.addCleanup(lambda: node.is_running() and node.end(signal.SIGKILL))
        for nanoseconds in (1000000, 100000000, 249000000, 251000000, 600000000):
            clock.publish(rospy.Time(0, nanoseconds))
            wait_until(lambda: rospy.Time.now().to_nsec() == nanoseconds, 20, 'the clock')
            values = diagnostics.wait_for('shift_tracker: pose', pose_age_s='0.00')
            self.assertEqual(values['message'], 'ok')
        self.assertEqual(float(values['speed_mm_per_s']), 0)
        self.assertEqual(tracker.list_stages().stages, [])
        self.assertTrue(node.is_running())


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'clock_zero', ClockZero)
