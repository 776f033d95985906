#!/usr/bin/python3
"""case_recorder: compressed parts, each whole and understood alone; lost messages are noticed; a recording that ends is begun
again; a full disk pauses it."""
import glob
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
from cortshift_msgs.msg import DisplacementField, MicroscopeSettings
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import wait_until  # noqa: E402
from programs import program  # noqa: E402


class Renumbered(Image):
    """An image whose sequence number is the sender's own: rospy counts for itself where a type says that it has a header."""
    _has_header = False


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
        process = subprocess.Popen([program('case_recorder')], start_new_session=True)

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
        sent = self.sent
        wait_until(lambda: self.sent > sent + 20, 30, 'something to record')
        self.stop()
        self.assertEqual(len(self.bags()), 1)  # the second one, whole

    def killed(self):
        """A recorder whose node is killed. Returns a time some seconds later, when it is still without it."""
        node = self.recorder()
        wait_until(self.images.get_num_connections, 30, 'a recording')
        sent = self.sent
        wait_until(lambda: self.sent > sent + 20, 30, 'something to record')
        os.kill(node.pid, signal.SIGKILL)
        node.wait()
        sent = self.sent
        wait_until(lambda: self.sent > sent + 40, 30, 'time without the node')
        return rospy.Time.now()

    def headers(self, path):
        with rosbag.Bag(path) as bag:
            return [message.header for _, message, _ in bag.read_messages('/stereo/left/image_raw')]

    def test_a_recording_goes_on_while_its_node_is_started_again(self):
        called = self.killed()
        folder = self.folder.name
        self.assertEqual(self.bags(), [])
        self.recorder(folder=folder)
        wait_until(lambda: glob.glob(folder + '/*.bag'), 30, 'the end of the first recording')
        first, = glob.glob(folder + '/*.bag')
        wait_until(lambda: any(os.path.getsize(path) > 20000 for path in glob.glob(folder + '/*.active')), 30, 'the next recording')
        type(self).status = None
        wait_until(lambda: self.status is not None, 30, 'diagnostics')
        self.assertEqual((self.status.level, self.status.message), (DiagnosticStatus.OK, 'recording'))   # the first did not end the next one
        self.stop()
        headers = self.headers(first)
        self.assertEqual([h.seq for h in headers], list(range(headers[0].seq, headers[0].seq + len(headers))))   # without a gap
        self.assertGreater(headers[-1].stamp, called)   # and for as long as there was no node
        following, = set(glob.glob(folder + '/*.bag')) - {first}
        self.assertGreater(self.headers(following)[0].stamp, headers[-1].stamp)

    def test_a_recording_that_nobody_takes_over_ends(self):
        later = self.killed()
        wait_until(self.bags, 60, 'the end of the recording')
        path, = self.bags()
        self.assertGreater(self.headers(path)[-1].stamp, later)
        wait_until(lambda: not self.images.get_num_connections(), 30, 'the end of its connection')

    def test_little_disk_pauses(self):
        self.recorder(min_disk_gb=1000.0)
        wait_until(lambda: self.status is not None, 30, 'diagnostics')
        self.assertEqual(self.status.level, DiagnosticStatus.ERROR)
        self.assertIn('pauses', self.status.message)
        self.assertEqual(os.listdir(self.folder.name), [])

    def part(self, number):
        """Messages of a part by topic, once it is whole."""
        def whole():
            return [b for b in self.bags() if b.endswith(f'_{number:04d}.bag')]
        wait_until(whole, 60, f'part {number}')
        found = {}
        with rosbag.Bag(whole()[0]) as bag:
            for topic, message, stamp in bag.read_messages():
                found.setdefault(topic, []).append((message, stamp.to_sec()))
            self.begin = bag.get_start_time()
        return found

    def latched(self, topic, kind):
        publisher = rospy.Publisher(topic, kind, latch=True, queue_size=5)
        self.addCleanup(publisher.unregister)
        return publisher

    def test_every_part_begins_with_what_holds(self):
        def edge(child, x):
            transform = TransformStamped()
            transform.header.frame_id, transform.child_frame_id = 'pmr', child
            transform.transform.translation.x, transform.transform.rotation.w = x, 1.0
            return TFMessage([transform])
        static, settings = self.latched('/tf_static', TFMessage), self.latched('/microscope/settings', MicroscopeSettings)
        field, info = self.latched('/shift/field', DisplacementField), rospy.Publisher('/stereo/left/camera_info', CameraInfo, queue_size=5)
        self.recorder(minutes=0.1, files=4)
        wait_until(lambda: static.get_num_connections() and info.get_num_connections(), 30, 'the recorder')
        static.publish(edge('reference', 0.001))
        static.publish(edge('left_optical', 0.002))  # the publisher's latch holds this one alone
        settings.publish(MicroscopeSettings(magnification=2.0))
        field.publish(DisplacementField(from_key='a', to_key='b'))
        info.publish(CameraInfo(width=640))
        self.part(0)
        static.publish(edge('reference', 0.007))
        settings.publish(MicroscopeSettings(magnification=3.0))
        self.part(1)
        field.unregister()  # who said it is gone; what it said holds
        for number in (2, 3):
            said = self.part(number)
            edges = {m.transforms[0].child_frame_id: m.transforms[0].transform.translation.x for m, _ in said['/tf_static']}
            self.assertEqual(edges, {'reference': 0.007, 'left_optical': 0.002}, number)
            self.assertEqual([m.magnification for m, _ in said['/microscope/settings']], [3.0])
            self.assertEqual([m.to_key for m, _ in said['/shift/field']], ['b'])
            self.assertEqual([m.width for m, _ in said['/stereo/left/camera_info']], [640])
            for topic in ('/tf_static', '/microscope/settings', '/shift/field', '/stereo/left/camera_info'):
                self.assertTrue(all(abs(stamp - self.begin) < 0.01 for _, stamp in said[topic]), topic)
            self.assertGreater(len(said['/stereo/left/image_raw']), 20)

    def test_lost_messages_are_noticed(self):
        numbered = rospy.Publisher('/stereo/right/image_raw', Renumbered, queue_size=50)
        self.addCleanup(numbered.unregister)
        self.recorder()
        wait_until(numbered.get_num_connections, 30, 'the recorder')
        for number in (1, 2, 3, 7, 8, 20, 2, 3):  # 3 and 11 are missing; then the publisher begins anew
            message = Renumbered(height=1, width=1, encoding='mono8', step=1, data=b'0')
            message.header.seq = number
            numbered.publish(message)
        wait_until(lambda: self.status is not None and 'messages are lost: 14 of /stereo/right/image_raw' in self.status.message, 30,
                   'the warning')
        self.assertEqual(self.status.level, DiagnosticStatus.WARN)
        self.assertIn(('lost_messages', '14'), [(v.key, v.value) for v in self.status.values])

    def test_refuses_bad_parameters(self):
        for bad in ({'files': 1}, {'compression': 'zip'}, {'colour': 'red'}, {'folder': '/proc/nowhere'}):
            self.assertEqual(self.recorder(**bad).wait(30), 1, bad)


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'recorder', Recorder)
