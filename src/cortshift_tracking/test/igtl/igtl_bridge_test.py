#!/usr/bin/python3
"""igtl_bridge against an independent OpenIGTLink client: poses in, fields and pictures out, requests, hostile peers."""
import os
import random
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import numpy as np
import rospkg
import rospy
import rostest
import tf2_ros
import vtk
import yaml
from cortshift_msgs.msg import DisplacementField, ShiftSummary, StageInfo
from cortshift_msgs.srv import (CaptureStage, CaptureStageResponse, ComputeShift, ComputeShiftResponse, ListStages,
                                ListStagesResponse)
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Image, PointCloud2, PointField
from tf2_msgs.msg import TFMessage
from vtk.util.numpy_support import vtk_to_numpy

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import wait_until  # noqa: E402
from igtl_client import Client, Command, GetStatus, Position, Raw, Status, TrackingData, pyigtl  # noqa: E402

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
        client = Client('127.0.0.1', self.port)
        wait_until(client.is_connected, 20, 'connection')
        return client

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
                                   gravity_normal_angle=float('nan'), compute_time=0.7)
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


class IgtlBridge(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('test_igtl_bridge')
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
        self.client.get_latest_messages()

    def edge(self, child, since):
        """Transforms to `child` published since the list had this length."""
        return [t for t in self.transforms[since:] if t.child_frame_id == child]

    def test_landmark_from_tracker_to_client(self):
        T_reference_pmr_mm = pose_mm([3, -1, 2], 0.8, [120.5, -43.25, 17.125])  # patient in LPS
        T_reference_microscope_mm = pose_mm([-1, 2, 0.5], -1.1, [-35.5, 210.75, 260.0])
        landmark_microscope_mm = np.array([11.0, -23.0, 41.0])
        since, sent = len(self.transforms), time.time()
        self.client.transform('PatientToReference', T_reference_pmr_mm, sent)
        self.client.transform('ScopeToReference', T_reference_microscope_mm, sent)
        wait_until(lambda: self.edge('microscope', since), 20, 'tf of the microscope')
        stamp = self.edge('microscope', since)[0].header.stamp
        self.assertLess(abs(stamp.to_sec() - (sent - 0.03)), 2e-6)
        found = self.buffer.lookup_transform('pmr', 'microscope', stamp, rospy.Duration(20)).transform
        T_pmr_microscope = np.eye(4)
        q, t = found.rotation, found.translation
        T_pmr_microscope[:3, :3] = quaternion_matrix([q.x, q.y, q.z, q.w])
        T_pmr_microscope[:3, 3] = t.x, t.y, t.z
        landmark_pmr = apply(T_pmr_microscope, landmark_microscope_mm / 1000)

        truth_lps_mm = apply(np.linalg.inv(T_reference_pmr_mm) @ T_reference_microscope_mm, landmark_microscope_mm)
        self.assertLess(np.abs(LPS_OF_RAS @ landmark_pmr * 1000 - truth_lps_mm).max(), MICROMETRE)

        displacement_lps_mm = np.array([1.5, -2.25, 7.0])
        points = np.full((1, 1, 3), landmark_pmr)
        self.fields.publish(field(points, np.full((1, 1, 3), LPS_OF_RAS @ displacement_lps_mm / 1000)))
        received = self.client.expect('ShiftField')
        error = max(np.abs(received.points[0] - truth_lps_mm).max(),
                    np.abs(received.attributes['displacement'][0] - displacement_lps_mm).max())
        print(f'landmark from tracker to client: {1000 * error:.3f} um')
        self.assertLess(error, MICROMETRE)

    def test_field_arrives_whole(self):
        random_numbers = np.random.default_rng(7)
        projection = np.eye(4)
        projection[:3, :3], projection[:3, 3] = rotation([1, 3, -2], 0.9), [0.05, -0.06, 0.11]
        height, width, resolution = 40, 60, 0.0005
        rows, columns = np.meshgrid(np.arange(height), np.arange(width), indexing='ij')
        local = np.stack([columns * resolution, rows * resolution, random_numbers.normal(0, 0.001, rows.shape)], -1)
        points = apply(projection, local)
        displacement = random_numbers.normal(0, 0.004, points.shape)
        hole = random_numbers.random(rows.shape) < 0.2
        points[hole], displacement[hole] = np.nan, np.nan
        message = field(points, displacement, projection, resolution, ('dura_open', 'resected'))
        self.fields.publish(message)

        since = message.header.stamp.to_sec()
        received = self.client.expect('ShiftField', since=since)
        self.assertAlmostEqual(received.timestamp, message.header.stamp.to_sec(), places=5)
        truth_mm = 1000 * points[~hole] @ LPS_OF_RAS
        vectors_mm = 1000 * displacement[~hole] @ LPS_OF_RAS
        self.assertLess(np.abs(received.points - truth_mm).max(), MICROMETRE)
        self.assertLess(np.abs(received.attributes['displacement'] - vectors_mm).max(), MICROMETRE)
        confidence = np.linspace(0, 1, height * width).reshape(height, width)[~hole]
        self.assertLess(np.abs(received.attributes['confidence'][:, 0] - confidence).max(), 1e-6)
        colour = np.stack([rows, columns, np.full_like(rows, 7), np.full_like(rows, 255)], -1)[~hole]
        self.assertLess(np.abs(255 * received.attributes['rgba'] - colour).max(), 1e-3)
        whole = ~(hole[:-1, :-1] | hole[1:, :-1] | hole[:-1, 1:] | hole[1:, 1:])
        self.assertEqual(len(received.polygons), whole.sum())
        corners = received.points[received.polygons]
        sides = np.linalg.norm((corners - np.roll(corners, 1, axis=1)) @ (LPS_OF_RAS @ projection[:3, :2]), axis=-1)
        self.assertLess(np.abs(sides - 0.5).max(), 1e-3)

        texture = self.client.expect('FieldTexture', since=since)
        self.assertEqual(texture.image.shape, (1, height, width, 3))
        lps_mm = apply(texture.ijk_to_world_matrix, np.stack([columns, rows, 0 * rows], -1))
        grid_mm = 1000 * apply(projection, np.stack([columns, rows, 0 * rows], -1) * resolution) @ LPS_OF_RAS
        self.assertLess(np.abs(lps_mm - grid_mm).max(), MICROMETRE)
        self.assertEqual(texture.world_coordinate_system, 'lps')
        self.assertTrue((texture.image[0][~hole][:, :2] == colour[:, :2]).all())
        self.assertTrue((texture.image[0][hole] == 0).all())

        text = self.client.expect('ShiftSummary').string
        self.assertIn('dura_open -> resected: magnitude 6.10 +- 1.20 mm, along gravity not known', text)
        values = self.client.expect('ShiftSummaryValues').values
        self.assertEqual(len(values), 12)
        self.assertLess(np.abs(values[[0, 1, 2, 6, 11]] - [12, 0.9, 6.1, -5, 0.7]).max(), 1e-9)
        self.assertTrue(np.isnan(values[4]))

        path = os.path.join(self.folder.name, 'dura_open__resected.vtk')
        wait_until(lambda: os.path.exists(path), 20, 'the vtk file')
        reader = vtk.vtkPolyDataReader()
        reader.SetFileName(path)
        reader.ReadAllColorScalarsOn()
        reader.Update()
        data = reader.GetOutput()
        self.assertLess(np.abs(vtk_to_numpy(data.GetPoints().GetData()) - truth_mm).max(), MICROMETRE)
        arrays = data.GetPointData()
        self.assertLess(np.abs(vtk_to_numpy(arrays.GetArray('displacement')) - vectors_mm).max(), MICROMETRE)
        self.assertTrue((vtk_to_numpy(arrays.GetArray('rgb')) == colour[:, :3]).all())
        self.assertEqual(data.GetNumberOfPolys(), whole.sum())
        self.assertIn('SPACE=LPS', reader.GetHeader())

    def test_late_client_gets_the_last_field(self):
        points = np.zeros((2, 2, 3))
        self.fields.publish(field(points + 0.1, points))
        self.client.expect('ShiftField')
        self.fields.publish(field(points + 0.2, points))
        self.client.expect('ShiftField')
        late = self.bridge.client()
        self.addCleanup(late.stop)
        self.assertAlmostEqual(late.expect('ShiftField').points[0, 2], 200, places=3)

    def test_faulty_field_is_not_sent(self):
        points = np.zeros((2, 2, 3))
        for fault in ('frame', 'short', 'resolution', 'fields'):
            message = field(points, points)
            if fault == 'frame':
                message.points.header.frame_id = 'map'
            elif fault == 'short':
                message.points.data = message.points.data[:-1]
            elif fault == 'resolution':
                message.resolution = 0
            else:
                message.points.fields[2].datatype = PointField.FLOAT64
            self.fields.publish(message)
        self.fields.publish(field(points + 0.3, points))
        wait_until(lambda: self.sees_point(300), 20, 'the good field after the faulty ones')

    def sees_point(self, z_mm):
        message = self.client.wait_for_message('ShiftField', timeout=1)
        return message is not None and abs(message.points[0, 2] - z_mm) < MICROMETRE

    def test_surface_and_pictures(self):
        points = np.random.default_rng(3).normal(0, 0.02, (30, 40, 3))
        points[4, 8] = np.nan
        self.surfaces.publish(cloud(points))
        received = self.client.expect('Surface')
        kept = points[::4, ::4].reshape(-1, 3)
        kept = kept[np.isfinite(kept[:, 0])]
        self.assertLess(np.abs(received.points - 1000 * kept @ LPS_OF_RAS).max(), MICROMETRE)

        picture = np.random.default_rng(4).integers(0, 256, (33, 50, 3), np.uint8)  # blue green red
        for topic, device in (('overlay_before', 'OverlayBeforePict'), ('overlay_after', 'OverlayAfterPict'),
                              ('magnitude', 'MagnitudePict')):
            publisher = rospy.Publisher('/shift/' + topic, Image, queue_size=1, latch=True)
            publisher.publish(Image(height=33, width=50, encoding='bgr8', step=150, data=picture.tobytes()))
            self.assertTrue((self.client.expect(device).image[0] == picture[..., ::-1]).all())

    def test_tools_in_every_message_type(self):
        matrix = pose_mm([1, 1, 2], 0.6, [5, 6, 7])
        since = len(self.transforms)
        self.client.send_message(TrackingData('Polaris', tools={'StylusToReference': matrix, 'Other': np.eye(4)}))
        wait_until(lambda: self.edge('probe_tip', since), 20, 'pose from TDATA')
        self.client.send_message(Position('StylusToReference', position=[8, 9, 10], quaternion=quaternion_of(matrix[:3, :3])))
        wait_until(lambda: len(self.edge('probe_tip', since)) == 2, 20, 'pose from POSITION')
        first, second = self.edge('probe_tip', since)
        for transform, expected in ((first, [5, 6, 7]), (second, [8, 9, 10])):
            t, q = transform.transform.translation, transform.transform.rotation
            self.assertLess(np.abs(1000 * np.array([t.x, t.y, t.z]) - expected).max(), MICROMETRE)
            self.assertLess(np.abs(quaternion_matrix([q.x, q.y, q.z, q.w]) - matrix[:3, :3]).max(), 1e-6)

    def test_state_of_tools(self):
        def state():
            return self.bridge.value('tools', 'StylusToReference')
        stylus = pose_mm([0, 0, 1], 0.1, [1, 2, 3])
        tracker = Tracker(self.client, StylusToReference=stylus)
        wait_until(lambda: state() == 'OK', 20, 'state OK')
        tracker.stop()
        wait_until(lambda: state() == 'STALE', 20, 'state STALE')
        since = len(self.transforms)
        faults = {'INVALID': lambda: self.client.transform('StylusToReference', stylus, time.time(), Status='INVALID'),
                  'no time stamp': lambda: self.client.transform('StylusToReference', stylus, 0),
                  'synchronise': lambda: self.client.transform('StylusToReference', stylus, time.time() - 30),
                  'rigid': lambda: self.client.transform('StylusToReference', 1.01 * stylus, time.time()),
                  'finite': lambda: self.client.transform('StylusToReference', np.nan * stylus, time.time()),
                  'status 16': lambda: self.client.send_message(Status('StylusToReference', code=16))}
        for reason, send in faults.items():
            send()
            wait_until(lambda: state() == 'INVALID' and reason in self.bridge.status['tools'][0], 20, f'INVALID: {reason}')
        self.assertEqual(self.edge('probe_tip', since), [])

    def test_requests(self):
        stages, asked = [], []

        def capture(request):
            asked.append((request.key, request.note))
            if request.key in [s.key for s in stages]:
                return CaptureStageResponse(False, f'key {request.key} exists', StageInfo())
            stages.append(StageInfo(key=request.key, note=request.note, valid_points=5, coverage=0.5))
            return CaptureStageResponse(True, f'stored {request.key}', stages[-1])

        def ask(text):
            self.client.send_message(pyigtl.StringMessage(text, device_name='cortshift'))
            return self.client.expect('CortshiftReply').string

        self.assertRegex(ask('capture_stage early'), 'REFUSED .*shift_tracker')
        services = [rospy.Service('/shift_tracker/capture_stage', CaptureStage, capture),
                    rospy.Service('/shift_tracker/list_stages', ListStages, lambda _: ListStagesResponse(list(stages))),
                    rospy.Service('/shift_tracker/compute_shift', ComputeShift, lambda r: ComputeShiftResponse(
                        True, f'from {r.from_key} to {r.to_key}', ShiftSummary()))]
        self.addCleanup(lambda: [s.shutdown() for s in services])
        self.client.expect('Stages')
        self.assertEqual(ask('capture_stage dura_open before the cut'), 'OK capture_stage dura_open: stored dura_open')
        self.assertIn('captured dura_open', self.client.expect('StageEvent').string)
        self.assertIn('dura_open', self.client.expect('Stages').string)
        self.assertEqual(ask('capture_stage dura_open'), 'REFUSED capture_stage dura_open: key dura_open exists')
        self.assertEqual(ask('compute_shift a b'), 'OK compute_shift a b: from a to b')
        for wrong in ('capture_stage ../../x', 'shutdown', '', 'capture_stage a\nb'):
            self.assertTrue(ask(wrong).startswith('REFUSED'), wrong)
        for number, name, text in ((4, 'capture_stage', 'second'), (5, 'Slicer', 'capture_stage third')):
            command = Command('Slicer', number=number, name=name, text=text)
            command.header_version = 2
            self.client.send_message(command)
            reply = self.client.expect('CortshiftReply')
            self.assertEqual((reply.message_type, reply.number, reply.name), ('RTS_COMMAND', number, name))
            self.assertEqual(reply.metadata['Status'], 'SUCCESS')
        self.assertEqual(asked, [('dura_open', 'before the cut'), ('dura_open', ''), ('second', ''), ('third', '')])
        wait_until(lambda: 'third' in self.client.expect('Stages').string, 20, 'list with the third stage')
        stages.pop()
        wait_until(lambda: 'deleted third' in self.client.expect('StageEvent').string, 20, 'event of the deletion')
        self.client.send_message(GetStatus('anything'))
        self.assertEqual(self.client.expect('cortshift').code, 1)

    def test_hostile_peers_disturb_nobody(self):
        """10 000 random, truncated and mutated messages while another client works."""
        seed = random.Random(1169)
        good = pyigtl.TransformMessage(np.eye(4), device_name='ScopeToReference').pack()
        text = pyigtl.StringMessage('capture_stage k' * 20, device_name='cortshift').pack()
        victim = self.bridge.client()
        self.addCleanup(victim.stop)
        tracker = Tracker(victim, ScopeToReference=pose_mm([0, 1, 0], 0.2, [1, 2, 3]))
        self.addCleanup(tracker.stop)
        time.sleep(0.3)
        since, tracked_from, began = len(self.transforms), tracker.sent, time.time()
        memory = self.memory()

        def hostile():
            kind = seed.randrange(6)
            if kind == 5:  # everything right but the content
                raw = Raw('ScopeToReference', content=seed.randbytes(seed.choice([12, 48, 70, seed.randrange(300)])))
                raw._message_type = seed.choice(['TRANSFORM', 'POSITION', 'TDATA', 'STATUS', 'STRING', 'COMMAND', 'BIND'])
                raw.header_version = seed.choice([1, 2])
                return raw.pack()
            if kind == 0:
                return seed.randbytes(seed.randrange(1, 300))
            message = bytearray(seed.choice([good, text]))
            if kind == 1:
                return message[:seed.randrange(1, len(message))]
            if kind == 2:  # a body of any size, announced
                message[42:50] = seed.randbytes(8)
            elif kind == 3:
                message[2:14] = seed.randbytes(12)
            for _ in range(seed.randrange(1, 9)):
                message[seed.randrange(len(message))] = seed.randrange(256)
            return message

        attacks = 0
        while attacks < 10000:
            with socket.create_connection(('127.0.0.1', self.bridge.port)) as attacker:
                # Several in one connection, until it is closed on us.
                for _ in range(seed.randrange(1, 6)):
                    attacks += 1
                    try:
                        attacker.sendall(hostile())
                    except OSError:
                        break
            if attacks % 1000 < 3:
                z = 0.001 * (attacks // 1000 + 1)
                self.fields.publish(field(np.full((2, 2, 3), z), np.zeros((2, 2, 3))))
                wait_until(lambda: abs(victim.expect('ShiftField').points[0, 2] - 1000 * z) < MICROMETRE, 20, 'field')
        seconds = time.time() - began
        tracker.stop()
        sent = tracker.sent - tracked_from
        wait_until(lambda: len(self.edge('microscope', since)) >= sent, 20, f'{sent} poses of the other client')
        stamps = np.array([t.header.stamp.to_sec() for t in self.edge('microscope', since)])
        print(f'{attacks} hostile messages in {seconds:.1f} s: {len(stamps)} of {sent} poses of the other client arrived, '
              f'longest gap {1000 * np.diff(stamps).max():.0f} ms, memory {memory:.0f} -> {self.memory():.0f} MB')
        self.assertIsNone(self.bridge.process.poll())
        self.assertLess(self.memory(), memory + 50)
        wait_until(lambda: int(self.bridge.value('connections', 'connections closed for malformed messages')) > 1000, 20,
                   'count of malformed messages')
        self.assertTrue(victim.is_connected() and self.client.is_connected())

    def memory(self):
        with open(f'/proc/{self.bridge.process.pid}/status') as file:
            return int(re.search(r'VmRSS:\s+(\d+)', file.read()).group(1)) / 1024

    def test_half_a_message_ends_the_connection(self):
        with socket.create_connection(('127.0.0.1', self.bridge.port)) as slow:
            slow.settimeout(20)
            slow.sendall(pyigtl.StringMessage('capture_stage k', device_name='cortshift').pack()[:70])
            while slow.recv(65536):  # what every client is sent; then the end
                pass

    def test_who_may_connect(self):
        port = self.bridge.port
        with socket.socket() as stranger:
            stranger.bind(('127.0.0.9', 0))
            stranger.connect(('127.0.0.1', port))
            stranger.settimeout(20)
            self.assertEqual(stranger.recv(100), b'')
        with self.assertRaises(ConnectionRefusedError):  # it listens on 127.0.0.1 alone
            socket.create_connection(('127.0.0.2', port))

    def test_as_a_client_of_a_tracker(self):
        with socket.socket() as probe:
            probe.bind(('127.0.0.1', 0))
            port = probe.getsockname()[1]
        matrix = pose_mm([1, 0, 0], 0.3, [4, 5, 6])
        bridge = Bridge('igtl_client', listen=False, servers=[f'127.0.0.1:{port}'], reconnect_min=0.1, reconnect_max=0.5,
                        tools=[{'device': 'RefToTracker', 'parent': 'tracker', 'child': 'reference'},
                               {'device': 'DrillToTracker', 'parent': 'tracker', 'child': 'drill'}])
        self.addCleanup(bridge.stop)
        reference = pose_mm([0, 2, 1], 1.3, [100, -200, -1500])
        wait_until(lambda: 'no connection' in bridge.status.get('connections', [''])[0], 20, 'warning without the server')
        for _ in range(2):  # the second time after the server was away
            server = pyigtl.OpenIGTLinkServer(port=port, local_server=True)
            wait_until(server.is_connected, 20, 'connection to the server')
            since = len(self.transforms)
            server.send_message(TrackingData('Polaris', tools={'DrillToTracker': reference @ matrix, 'RefToTracker': reference}))
            wait_until(lambda: self.edge('drill', since), 20, 'pose of the drill')
            t = self.edge('drill', since)[0]
            self.assertEqual(t.header.frame_id, 'reference')
            t = t.transform.translation
            # Single precision at 1.5 m from the tracker: 0.1 um, twice.
            self.assertLess(np.abs(1000 * np.array([t.x, t.y, t.z]) - [4, 5, 6]).max(), MICROMETRE)
            server.stop()
            wait_until(lambda: 'no connection' in bridge.status['connections'][0], 20, 'warning without the server')

    def test_refuses_to_start(self):
        for changes, expected in (({'listen_port': 70000}, 'listen_port = 70000 is not allowed; allowed is 0 ... 65535'),
                                  ({'colour': 1}, 'colour is unknown'),
                                  ({'link_axes': 'RAS'}, 'allowed is one of ras, lps'),
                                  ({'listen_address': 'everywhere'}, "listen_address = 'everywhere'"),
                                  ({'tools': [{'device': 'M', 'parent': 'floor', 'child': 'microscope'}]}, "parent = 'floor'"),
                                  ({'tools': [{'device': 'M', 'frame': 'microscope'}]}, "key 'frame' is unknown"),
                                  ({'listen_port': self.bridge.port}, 'cannot listen')):
            bridge = Bridge('igtl_refused', **changes)
            output = bridge.wait()
            self.assertEqual(bridge.process.returncode, 1, output)
            self.assertIn(expected, output)


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'igtl_bridge', IgtlBridge)
