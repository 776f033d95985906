"""What the tests of igtl_bridge share: a bridge with a configuration of its own, poses, and messages to send through it."""
import os
import signal
import subprocess
import tempfile
import threading
import time

import numpy as np
import rospkg
import rospy
import tf2_ros
import yaml
from cortshift_msgs.msg import DisplacementField, Provenance, ShiftSummary
from diagnostic_msgs.msg import DiagnosticArray
from graph import wait_until
from igtl_client import Client
from sensor_msgs.msg import PointCloud2, PointField
from tf2_msgs.msg import TFMessage

PACKAGE = rospkg.RosPack().get_path('cortshift_tracking')
CONFIG = os.path.join(PACKAGE, '..', '..', 'config', 'igtl_bridge.yaml')
MICROMETRE = 1e-3  # mm
LPS_OF_RAS = np.diag([-1.0, -1.0, 1.0])


def executable():
    for folder in os.environ['CMAKE_PREFIX_PATH'].split(':'):
        path = os.path.join(folder, 'lib', 'cortshift_tracking', 'igtl_bridge')
        if os.path.exists(path):
            return path
    raise AssertionError('igtl_bridge is not built')


class Bridge:
    """A bridge of its own name with the shipped configuration, changed as said."""

    def __init__(self, name, **changes):
        with open(CONFIG) as file:
            parameters = yaml.safe_load(file)
        rospy.set_param('/' + name, {**parameters, 'listen_port': 0, **changes})
        self.name = name
        self.status = {}
        self._subscriber = rospy.Subscriber('/diagnostics', DiagnosticArray, self._diagnose)
        self._output = tempfile.TemporaryFile('w+')  # a pipe that nobody reads would stop the node once it is full
        self.process = subprocess.Popen([executable(), '__name:=' + name], stdout=self._output, stderr=subprocess.STDOUT)

    def _diagnose(self, message):
        for status in message.status:
            node, _, task = status.name.partition(': ')
            if node == self.name:
                self.status[task] = (status.message, {v.key: v.value for v in status.values})

    @property
    def port(self):
        wait_until(lambda: self.value('connections', 'listening port'), 20, f'diagnostics of {self.name}')
        return int(self.value('connections', 'listening port'))

    def value(self, task, key):
        return self.status.get(task, ('', {}))[1].get(key)

    def client(self):
        return Client('127.0.0.1', self.port)

    def wait(self):
        """Until it has ended. Returns what it printed."""
        self.process.wait(timeout=20)
        self._subscriber.unregister()
        rospy.delete_param('/' + self.name)
        with self._output:
            self._output.seek(0)
            return self._output.read()

    def stop(self):
        self.process.send_signal(signal.SIGINT)
        return self.wait()


def rotation(axis, angle):
    axis = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def pose_mm(axis, angle, translation_mm):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation(axis, angle), translation_mm
    return matrix


def apply(matrix, points):
    return np.asarray(points) @ matrix[:3, :3].T + matrix[:3, 3]


def quaternion_of(matrix):
    """x y z w of a rotation by less than 180 degrees."""
    w = np.sqrt(1 + np.trace(matrix)) / 2
    return np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1], 4 * w * w]) / (4 * w)


def quaternion_matrix(q):
    x, y, z, w = q
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def cloud(points, displacement=None, stamp=None):
    """Organised (H, W, 3) arrays [m] as a cloud in pmr; confidence and colour follow the position in the grid."""
    height, width, _ = points.shape
    names = ['x', 'y', 'z'] + (['dx', 'dy', 'dz', 'confidence'] if displacement is not None else []) + ['rgb']
    data = np.zeros((height, width, len(names)), np.float32)
    data[..., :3] = points
    if displacement is not None:
        data[..., 3:6] = displacement
        data[..., 6] = np.linspace(0, 1, height * width).reshape(height, width)
    red, green = np.meshgrid(np.arange(height) % 256, np.arange(width) % 256, indexing='ij')
    # Opaque: as floats, half of these are NaN.
    data[..., -1] = (0xff000000 | red << 16 | green << 8 | 7).astype(np.uint32).view(np.float32)
    message = PointCloud2(height=height, width=width, point_step=4 * len(names), row_step=4 * len(names) * width,
                          data=data.tobytes())
    message.header.frame_id = 'pmr'
    message.header.stamp = stamp or rospy.Time.now()
    message.fields = [PointField(n, 4 * i, PointField.FLOAT32, 1) for i, n in enumerate(names)]
    return message


def field(points, displacement, projection=np.eye(4), resolution=0.0005, keys=('before', 'after')):
    message = DisplacementField(from_key=keys[0], to_key=keys[1], resolution=resolution)
    message.header.frame_id, message.header.stamp = 'pmr', rospy.Time.now()
    message.points = cloud(points, displacement, message.header.stamp)
    p, q = message.projection.position, message.projection.orientation
    p.x, p.y, p.z = projection[:3, 3]
    q.x, q.y, q.z, q.w = quaternion_of(projection[:3, :3])
    message.summary = ShiftSummary(from_key=keys[0], to_key=keys[1], valid_points=12, overlap=0.9, magnitude_mean=0.0061,
                                   magnitude_sd=0.0012, gravity_mean=float('nan'), gravity_sd=float('nan'),
                                   normal_mean=-0.005, normal_sd=0.001, lateral_mean=0.002, lateral_sd=0.0005,
                                   gravity_normal_angle=float('nan'), compute_time=0.7, warnings=['the rows do not agree'])
    message.provenance = Provenance('0.1-2-gabc', 'c' * 64, 'd' * 64)
    return message


class Tracker:
    """Sends a client's poses at 50 Hz from a thread."""

    def __init__(self, client, **matrices_mm):
        self.client, self.matrices_mm, self.sent = client, matrices_mm, 0
        self._going = True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        while self._going:
            for device, matrix_mm in self.matrices_mm.items():
                self.client.transform(device, matrix_mm, time.time())
            self.sent += 1
            time.sleep(0.02)

    def stop(self):
        self._going = False
        self._thread.join()


class BridgeTest:
    """One bridge for the tests of a class, with a client, and what it publishes."""

    @classmethod
    def setUpClass(cls):
        rospy.init_node('test_igtl', anonymous=True)
        cls.folder = tempfile.TemporaryDirectory()
        cls.bridge = Bridge('igtl_bridge', link_axes='lps', message_timeout=1.0, stage_poll_period=0.2,
                            vtk_folder=cls.folder.name, tools=[
                                {'device': 'PatientToReference', 'parent': 'reference', 'child': 'pmr'},
                                {'device': 'ScopeToReference', 'parent': 'reference', 'child': 'microscope', 'latency': 0.03},
                                {'device': 'StylusToReference', 'parent': 'reference', 'child': 'probe_tip'}])
        cls.transforms = []
        rospy.Subscriber('/tf', TFMessage, lambda m: cls.transforms.extend(m.transforms), queue_size=1000)
        cls.buffer = tf2_ros.Buffer()
        cls.listener = tf2_ros.TransformListener(cls.buffer)
        cls.fields = rospy.Publisher('/shift/field', DisplacementField, queue_size=1, latch=True)
        cls.surfaces = rospy.Publisher('/surface/points', PointCloud2, queue_size=1, latch=True)
        cls.client = cls.bridge.client()
        wait_until(lambda: cls.fields.get_num_connections() and cls.surfaces.get_num_connections(), 20, 'subscription')

    @classmethod
    def tearDownClass(cls):
        cls.client.stop()
        cls.output = cls.bridge.stop()
        cls.folder.cleanup()
        assert cls.bridge.process.returncode == 0, f'exit status {cls.bridge.process.returncode}: {cls.output}'

    def setUp(self):
        self.client.forget()

    def edge(self, child, since):
        """Transforms to `child` published since the list had this length."""
        return [t for t in self.transforms[since:] if t.child_frame_id == child]
