#!/usr/bin/python3
"""Two phantom graphs in two namespaces under one master: each has its own stages and fields, and nothing is heard outside."""
import os
import shutil
import signal
import subprocess
import sys
import unittest
import xmlrpc.client

import rosgraph
import rospy
import rostest
from cortshift_msgs.srv import SetPhantomStage

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import Diagnostics, ShiftTracker, field_arrays, wait_until  # noqa: E402

GLOBAL = {'/diagnostics', '/rosout', '/rosout_agg', '/clock'}


class TwoGraphs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('two_graphs')
        cls.diagnostics = Diagnostics()

    def test_each_has_its_own_case(self):
        fields = {}
        for space, stages in (('/or1', ('first', 'second')), ('/or2', ('second', 'first'))):
            tracker = ShiftTracker(120, space)
            set_stage = rospy.ServiceProxy(space + '/stereo_driver/set_stage', SetPhantomStage)
            set_stage.wait_for_service(60)
            for stage in stages:
                for answer in (set_stage(stage), tracker.capture_stage(stage, space)):
                    self.assertTrue(answer.success, answer.message)
            answer = tracker.compute_shift(*stages)
            self.assertTrue(answer.success, answer.message)
            self.assertEqual([(s.key, s.note) for s in tracker.list_stages().stages], [(stage, space) for stage in stages])
            fields[space] = tracker.field(*stages)
        # The one sags and the other rises, by the same.
        there, back = (fields[space].summary.normal_mean for space in ('/or1', '/or2'))
        self.assertLess(there, -0.001)
        self.assertGreater(back, 0.001)
        self.assertTrue(field_arrays(fields['/or1'])[0].size)
        self.diagnostics.wait_for('or1/shift_tracker: state', live='off')
        self.diagnostics.wait_for('or2/shift_tracker: state', live='off')
        self.pixels_without_sockets()
        self.comes_again(tracker, ['second', 'first'])
        self.programs_of_others()
        outside = {name for name, _ in rospy.get_published_topics() if not name.startswith(('/or1/', '/or2/'))}
        self.assertLessEqual(outside, GLOBAL)

    @staticmethod
    def one_process():
        return xmlrpc.client.ServerProxy(rosgraph.Master('/two_graphs').lookupNode('/or2/stereo_to_shift'))

    def comes_again(self, tracker, stages):
        """The one process, killed."""
        killed = self.one_process().getPid('/two_graphs')[2]
        os.kill(killed, signal.SIGKILL)

        def back():
            try:
                return (self.one_process().getPid('/two_graphs')[2] != killed and
                        [stage.key for stage in tracker.list_stages().stages] == stages)
            except (OSError, rospy.ServiceException):
                return False
        wait_until(back, 60, 'the process, with its stages')

    def pixels_without_sockets(self):
        """In one process images and surfaces go from publisher to subscriber as pointers."""
        _, _, connections = self.one_process().getBusInfo('/two_graphs')
        for topic in ('stereo/left/image_raw', 'stereo/right/image_raw', 'surface/points'):
            ways = {connection[3] for connection in connections if connection[4] == '/or2/' + topic}
            self.assertEqual(ways, {'INTRAPROCESS'}, topic)

    def programs_of_others(self):
        """The examples, each in the graph that it is told."""
        for program, space, key in (('first_shift', '/or1', 'cpp'), ('first_shift.py', '/or2', 'py')):
            earlier = {'/or1': 'first', '/or2': 'second'}[space]
            done = subprocess.run(['rosrun', 'cortshift_tracking', program, earlier, key], env={**os.environ, 'ROS_NAMESPACE': space},
                                  capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertRegex(done.stdout, r'^\d+\.\d\d mm over \d+ %')
            again = subprocess.run(['rosrun', 'cortshift_tracking', program, earlier, key], env={**os.environ, 'ROS_NAMESPACE': space},
                                   capture_output=True, text=True, check=False)
            self.assertEqual(again.returncode, 1)
            self.assertIn(f"refused: stage '{key}' exists already", again.stderr)

    @classmethod
    def tearDownClass(cls):
        home = os.environ.get('ROS_HOME') or os.path.expanduser('~/.ros')
        for space in ('or1', 'or2'):   # the folders of cases that nobody named
            shutil.rmtree(os.path.join(home, 'cortshift', f'case-{rospy.get_param("/run_id")}-{space}'), ignore_errors=True)


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'two_graphs', TwoGraphs)
