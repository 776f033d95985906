#!/usr/bin/python3
"""case_recorder: parts that roll, compressed, whole; a recording that ends is begun again; a full disk pauses it."""
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import rosbag
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import Image

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import wait_until  # noqa: E402


class Recorder(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('test_recorder')
        cls.status = None
        rospy.Subscriber('/diagnostics', DiagnosticArray, cls.diagnose)
        cls.images = rospy.Publisher('/stereo/left/image_raw', Image, queue_size=10)
        cls.sent = 0
        threading.Thread(target=cls.send, daemon=True).start()

    @classmethod
    def send(cls):
        while not rospy.is_shutdown():
            image = Image(height=100, width=100, encoding='mono8', step=100, data=bytes(10000))
            image.header.seq, image.header.stamp = cls.sent, rospy.Time.now()
            cls.images.publish(image)
            cls.sent += 1
            time.sleep(0.05)

    @classmethod
    def diagnose(cls, message):
        for status in message.status:
            if status.name == 'case_recorder: recording':
                cls.status = status

    def recorder(self, **parameters):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        rospy.set_param('/case_recorder', {'folder': self.folder.name, **parameters})
        type(self).status = None
        process = subprocess.Popen(['rosrun', 'cortshift_tracking', 'case_recorder'], start_new_session=True)

        def stop():
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)
            process.wait(20)
        self.stop = stop
        self.addCleanup(stop)
        return process

    def bags(self):
        return sorted(os.path.join(self.folder.name, f) for f in os.listdir(self.folder.name) if f.endswith('.bag'))

    def test_parts_roll(self):
        self.recorder(minutes=0.05, files=2)
        first = []

        def rolled():
            first.extend(b for b in self.bags() if not first)
            return first and first[0] not in self.bags()
        wait_until(rolled, 60, 'the oldest part given up')
        self.stop()
        self.assertLessEqual(len(self.bags()), 3)
        numbers = []
        for path in self.bags():
            with rosbag.Bag(path) as bag:
                self.assertEqual(bag.get_compression_info().compression, 'lz4')
                numbers += [message.header.seq for _, message, _ in bag.read_messages('/stereo/left/image_raw')]
        self.assertGreater(len(numbers), 40)
        stamps = sorted(numbers)
        self.assertEqual(stamps, list(range(stamps[0], stamps[0] + len(stamps))))  # nothing is lost between the parts

    def test_a_recording_that_ends_is_begun_again(self):
        self.recorder()
        wait_until(lambda: os.listdir(self.folder.name), 30, 'a recording')
        pids = subprocess.run(['pgrep', '-f', f'record.*{self.folder.name}'], capture_output=True, text=True).stdout.split()
        self.assertTrue(pids)
        for pid in pids:
            os.kill(int(pid), signal.SIGKILL)
        wait_until(lambda: self.status is not None and 'started again' in self.status.message, 30, 'warning')
        wait_until(lambda: len(os.listdir(self.folder.name)) == 2, 30, 'the second file')
        time.sleep(1)
        self.stop()
        self.assertEqual(len(self.bags()), 1)  # the second one, whole

    def test_little_disk_pauses(self):
        self.recorder(min_disk_gb=1000.0)
        wait_until(lambda: self.status is not None, 30, 'diagnostics')
        self.assertEqual(self.status.level, DiagnosticStatus.ERROR)
        self.assertIn('pauses', self.status.message)
        self.assertEqual(os.listdir(self.folder.name), [])

    def test_refuses_bad_parameters(self):
        for bad in ({'files': 1}, {'compression': 'zip'}, {'colour': 'red'}, {'folder': '/proc/nowhere'}):
            self.assertEqual(self.recorder(**bad).wait(30), 1, bad)


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'recorder', Recorder)
