#!/usr/bin/python3
"""What launch files start with paths of any kind, and what a site configures, in a running graph."""
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest

import rospy
import rostest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rosgraph_msgs.msg import Clock
from tf2_msgs.msg import TFMessage

SUPPORT = os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support')
sys.path[:0] = [SUPPORT, os.path.join(SUPPORT, 'project')]
from graph import wait_until  # noqa: E402
from site_example import with_examples  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parents[4]
EDGE = '- {parent: pmr, child: reference, translation: [0, 0, 0.007], rotation: [0, 0, 0, 1]}\n'


class Launched(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('test_launched')

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = os.path.join(folder.name, "Müller, a case")
        os.mkdir(self.folder)

    def start(self, package, program, *words):
        process = subprocess.Popen(['rosrun', package, program, *words], start_new_session=True, stderr=subprocess.PIPE,
                                   universal_newlines=True)

        def stop():
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)
            process.communicate(timeout=30)
        self.addCleanup(stop)
        return process

    def heard(self, topic, kind):
        messages = []
        subscriber = rospy.Subscriber(topic, kind, messages.append)
        self.addCleanup(subscriber.unregister)
        return messages

    def test_a_bag_is_played_whatever_its_name(self):
        path = os.path.join(self.folder, 'a bag.bag')
        shutil.copy(ROOT / 'bags/phantom_case.bag', path)
        rospy.set_param('/player/bag', path)
        clock = self.heard('/clock', Clock)
        self.start('cortshift_tracking', 'play_case', '--clock', '--quiet', '--duration', '1', '__name:=player')
        wait_until(lambda: clock, 60, 'the clock of the bag')

    def test_a_bag_that_is_gone_ends_with_its_name(self):
        rospy.set_param('/player/bag', os.path.join(self.folder, 'gone.bag'))
        process = self.start('cortshift_tracking', 'play_case', '__name:=player')
        self.assertEqual(process.wait(60), 1)
        self.assertIn('Müller, a case/gone.bag: no such file', process.stderr.read())

    def test_static_transforms_are_read_whatever_the_name_of_their_file(self):
        path = os.path.join(self.folder, 'static tf.yaml')
        with open(path, 'w', encoding='utf-8') as file:
            file.write(EDGE)
        rospy.set_param('/static/file', path)
        edges = self.heard('/tf_static', TFMessage)
        self.start('cortshift_stereo', 'publish_static_tf', '__name:=static')
        wait_until(lambda: edges, 60, 'the transform')
        self.assertEqual(edges[0].transforms[0].transform.translation.z, 0.007)

    def test_the_bridge_starts_with_the_example_of_the_site(self):
        with open(ROOT / 'config/igtl_bridge.yaml', encoding='utf-8') as file:
            parameters = yaml.safe_load(file)
        example = yaml.safe_load(with_examples((ROOT / 'config/site.yaml').read_text(encoding='utf-8')))['igtl_bridge']
        self.assertEqual(len(example['tools']), 3)
        rospy.set_param('/igtl_bridge', {**parameters, **example, 'listen_port': 0})
        said = self.heard('/diagnostics', DiagnosticArray)
        process = self.start('cortshift_tracking', 'igtl_bridge', '__name:=igtl_bridge')

        def reports():
            self.assertIsNone(process.poll(), 'the bridge has ended')
            return [s for m in said for s in m.status if s.name.startswith('igtl_bridge')]
        wait_until(reports, 60, 'diagnostics of the bridge')


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'launched', Launched)
