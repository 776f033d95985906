#!/usr/bin/python3
"""Each node of the graph is killed once, with live mode and the recording on: it is there again, with all that it knew, and the
graph captures."""
import glob
import os
import shutil
import signal
import subprocess
import sys
import time
import unittest
import xmlrpc.client

import rosbag
import rosgraph
import rospy
import rostest
from cortshift_msgs.srv import SetPhantomStage

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import Diagnostics, ShiftTracker, wait_until  # noqa: E402

NODES = ('shift_tracker', 'surface_reconstruction', 'stereo_driver', 'probe', 'igtl_bridge', 'case_recorder')
STATE = 'shift_tracker: state'


def pid_of(node):
    """None where nobody answers by that name."""
    try:
        address = rosgraph.Master(rospy.get_name()).lookupNode('/' + node)
        return xmlrpc.client.ServerProxy(address).getPid(rospy.get_name())[2]
    except (rosgraph.MasterException, OSError, xmlrpc.client.Error):
        return None


class AnyNodeDies(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('any_node_dies')
        cls.folder = rospy.get_param('/any_node_dies/folder')
        cls.diagnostics = Diagnostics()
        cls.tracker = ShiftTracker(120)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder, ignore_errors=True)

    def capture(self, key):
        """Asked again while something is missing: what is refused is refused, and a call may end with the node."""
        def captured():
            try:
                self.said = self.tracker.capture_stage(key, '')
                return self.said.success
            except rospy.ServiceException as error:
                self.said = error
                return False
        try:
            wait_until(captured, 90, f'the capture of {key}')
        except AssertionError as error:
            raise AssertionError(f'{error}: {self.said}') from None

    def killed(self, node):
        """Seconds until it is there again."""
        before = pid_of(node)
        os.kill(before, signal.SIGKILL)
        began = time.monotonic()
        wait_until(lambda: pid_of(node) not in (None, before), 60, f'the restart of {node}')
        return time.monotonic() - began

    def test_every_node(self):
        rospy.wait_for_service('/stereo_driver/set_stage', timeout=60)
        set_stage = rospy.ServiceProxy('/stereo_driver/set_stage', SetPhantomStage)
        self.capture('first')
        answer = self.tracker.track('first', True)
        self.assertTrue(answer.success, answer.message)
        keys = ['first']
        for node in NODES:
            wait_until(lambda: pid_of(node), 60, node)  # noqa: B023
            seconds = self.killed(node)
            keys.append('after_' + node)
            self.capture(keys[-1])
            self.assertEqual([s.key for s in self.tracker.list_stages().stages], keys, node)
            self.diagnostics.wait_for(STATE, live='on', live_from='first')
            told = rospy.get_param(f'/restarts/{node}')
            self.assertEqual((told['count'], told['why']), (1, 'signal 9 (SIGKILL) ended it'))
            print(f'{node} is there again after {seconds:.1f} s')
        # Stopped and told again, as ever; and off stays off.
        self.assertTrue(self.tracker.track('', False).success)
        self.killed('shift_tracker')
        self.diagnostics.wait_for(STATE, live='off')
        # The phantom goes on at the stage it was at.
        self.assertTrue(set_stage('second').success)
        self.killed('stereo_driver')
        self.diagnostics.wait_for('stereo_driver: phantom', stage='second')
        self.recording_went_on()

    def recording_went_on(self):
        """What was recorded before is whole; one recorder is at work, and no other."""
        folder = os.path.join(self.folder, 'recordings')
        wait_until(lambda: glob.glob(folder + '/*.bag') and glob.glob(folder + '/*.bag.active'), 60, 'a second recording')
        for path in glob.glob(folder + '/*.bag'):
            with rosbag.Bag(path) as bag:
                self.assertGreater(bag.get_message_count('/tf'), 0, path)
        # The shell that is to become one of them counts as none.
        told = subprocess.run(['pgrep', '-fc', f'record_parts .*{folder}'], capture_output=True, text=True, check=False).stdout
        self.assertEqual(told.strip(), '1')


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'any_node_dies', AnyNodeDies)
