#!/usr/bin/python3
"""Real photographs through the running graph: chessboard pairs (Debian: opencv-doc) that took no part in the
calibration become surfaces in pmr, on which the board has its true size and is flat."""
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import unittest
import xmlrpc.client

import cv2
import numpy as np
import rosgraph
import rosnode
import rospy
import rostest
import tf2_ros
import yaml
from cortshift_msgs.srv import TriggerCapture
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import PointCloud2

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph_programs import CONFIG, program, wait_until  # noqa: E402

PHOTOGRAPHS = '/usr/share/doc/opencv-doc/examples/data'
CALIBRATED = ('01', '03', '05', '07', '09', '12', '14')
CHECKED = ('06', '13')  # both cameras see nearly the whole board in sharp light
BOARD, SQUARE = (9, 6), 0.025

# Where the cameras stand: all three edges turn and shift.
EDGES = {'reference': ('pmr', (0.10, -0.05, 0.30), (0.5, -0.5, 0.5, 0.5)),
         'microscope': ('reference', (0.02, 0.40, -0.10), (0.0, 0.6, 0.0, 0.8)),
         'left_optical': ('microscope', (0.06, -0.12, 0.03), (0.36, 0.48, 0.0, 0.8))}


def matrix(translation, quaternion):
    x, y, z, w = quaternion
    T = np.eye(4)
    T[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                 [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    T[:3, 3] = translation
    return T


def transform(child):
    parent, translation, rotation = EDGES[child]
    message = TransformStamped()
    message.header.frame_id, message.child_frame_id = parent, child
    message.header.stamp = rospy.Time.now()
    t, q = message.transform.translation, message.transform.rotation
    (t.x, t.y, t.z), (q.x, q.y, q.z, q.w) = translation, rotation
    return message


def camera(path):
    with open(path) as file:
        info = yaml.safe_load(file)
    return [np.array(info[name]['data'], float) for name in
            ('camera_matrix', 'distortion_coefficients', 'rectification_matrix', 'projection_matrix')]


def points_of(cloud):
    """(H, W, 3) [m], NaN where there is none."""
    offsets = [field.offset for field in cloud.fields if field.name in 'xyz']
    raw = np.frombuffer(cloud.data, np.uint8).reshape(cloud.height, cloud.width, cloud.point_step)
    return np.stack([np.ascontiguousarray(raw[..., o:o + 4]).view(np.float32)[..., 0] for o in offsets], -1).astype(float)


class RealPair(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp()
        for name, numbers in (('boards', CALIBRATED), ('pairs', CHECKED)):
            os.mkdir(os.path.join(cls.folder, name))
            for number in numbers:
                for side in ('left', 'right'):
                    shutil.copy(os.path.join(PHOTOGRAPHS, f'{side}{number}.jpg'), os.path.join(cls.folder, name))
        cls.calibration = os.path.join(cls.folder, 'calibration')
        subprocess.run([program('cortshift_stereo', 'calibrate_stereo'), '--images', os.path.join(cls.folder, 'boards'),
                        '--board', '9x6', '--square', str(SQUARE), '--output', cls.calibration], check=True)
        cls.start_tracker()
        rospy.set_param('/stereo_driver', {'source': 'folder', 'rate': 0.0, 'folder': os.path.join(cls.folder, 'pairs'),
                                           'calibration_left': os.path.join(cls.calibration, 'left.yaml'),
                                           'calibration_right': os.path.join(cls.calibration, 'right.yaml')})
        with open(os.path.join(CONFIG, 'surface_reconstruction.yaml')) as file:
            parameters = yaml.safe_load(file)
        parameters['max_working_distance'] = 1.5  # the room behind the board is in the picture
        rospy.set_param('/surface_reconstruction', parameters)
        cls.nodes = [subprocess.Popen([program('cortshift_stereo', f'{name}_node')])
                     for name in ('surface_reconstruction', 'stereo_driver')]
        cls.clouds = {}
        rospy.Subscriber('/surface/points', PointCloud2, lambda cloud: cls.clouds.setdefault(cloud.header.stamp, cloud))
        rospy.wait_for_service('/stereo_driver/trigger', timeout=60)
        rospy.wait_for_service('/surface_reconstruction/average_pairs', timeout=60)
        # No pair may be lost: images and poses must arrive.
        wait_until(cls.images_reach_reconstruction, 60, 'a connection for the images of both cameras')
        wait_until(cls.poses.pub_tf.get_num_connections, 60, 'a connection for the poses')
        sent = cls.poses_sent
        wait_until(lambda: cls.poses_sent > sent + 10, 60, 'poses')
        cls.trigger = rospy.ServiceProxy('/stereo_driver/trigger', TriggerCapture)

    @staticmethod
    def images_reach_reconstruction():
        driver = xmlrpc.client.ServerProxy(rosnode.get_api_uri(rosgraph.Master('/test_real_pair'), '/stereo_driver'))
        connected = {link[4] for link in driver.getBusInfo('/test_real_pair')[2] if link[1] == '/surface_reconstruction'}
        return {f'/stereo/{side}/{topic}' for side in ('left', 'right') for topic in ('image_raw', 'camera_info')} <= connected

    @classmethod
    def start_tracker(cls):
        fixed = tf2_ros.StaticTransformBroadcaster()
        fixed.sendTransform([transform('reference'), transform('left_optical')])
        cls.poses, cls.poses_sent = tf2_ros.TransformBroadcaster(), 0
        cls.stop = threading.Event()

        def track():
            while not cls.stop.wait(0.03):
                cls.poses.sendTransform(transform('microscope'))
                cls.poses_sent += 1
        cls.fixed, cls.tracker = fixed, threading.Thread(target=track)
        cls.tracker.start()

    @classmethod
    def tearDownClass(cls):
        cls.stop.set()
        cls.tracker.join()
        for node in cls.nodes:
            node.terminate()
            node.wait(timeout=20)
        shutil.rmtree(cls.folder)

    def corners_of(self, number, cloud):
        """Corners (54, 3) of the board in the raw left camera [m], where the surface has them."""
        grey = cv2.imread(os.path.join(PHOTOGRAPHS, f'left{number}.jpg'), cv2.IMREAD_GRAYSCALE)
        found, corners = cv2.findChessboardCorners(grey, BOARD)
        self.assertTrue(found)
        corners = cv2.cornerSubPix(grey, corners, (5, 5), (-1, -1), (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3))
        K, D, R, P = camera(os.path.join(self.calibration, 'left.yaml'))
        at = cv2.undistortPoints(corners, K.reshape(3, 3), D, R=R.reshape(3, 3), P=P.reshape(3, 4))[:, 0]
        points = points_of(cloud)
        x, y = np.floor(at).astype(int).T
        u, v = (at[:, :1] - x[:, None]), (at[:, 1:] - y[:, None])
        in_pmr = ((1 - v) * ((1 - u) * points[y, x] + u * points[y, x + 1]) +
                  v * ((1 - u) * points[y + 1, x] + u * points[y + 1, x + 1]))
        T_pmr_left = matrix(*EDGES['reference'][1:]) @ matrix(*EDGES['microscope'][1:]) @ matrix(*EDGES['left_optical'][1:])
        return (np.linalg.inv(T_pmr_left) @ np.c_[in_pmr, np.ones(len(in_pmr))].T).T[:, :3], at, R.reshape(3, 3), P.reshape(3, 4)

    def test_the_board_has_its_size_and_is_flat_on_the_surface(self):
        for number in CHECKED:
            with self.subTest(pair=number):
                fired = self.trigger()
                self.assertTrue(fired.success, fired.message)
                wait_until(lambda: fired.stamp in self.clouds, 60, f'the surface of pair {number}')
                cloud = self.clouds[fired.stamp]
                self.assertEqual(cloud.header.frame_id, 'pmr')
                corners, at, R, P = self.corners_of(number, cloud)
                # In the left camera each point lies on the ray of its own pixel: the pose was applied, and the right way.
                rectified = corners @ R.T
                seen = rectified @ P[:, :3].T
                known = np.isfinite(corners[:, 0])
                self.assertGreaterEqual(known.sum(), 40)  # of 54; some lie where glare or a hand left no point
                self.assertLess(np.abs(seen[known, :2] / seen[known, 2:] - at[known]).max(), 0.05)
                grid = corners.reshape(BOARD[1], BOARD[0], 3)
                gaps = np.concatenate([np.linalg.norm(np.diff(grid, axis=axis), axis=2).ravel() for axis in (0, 1)])
                gaps = gaps[np.isfinite(gaps)]
                flat = corners[known] - corners[known].mean(0)
                off_plane = np.abs(flat @ np.linalg.svd(flat)[2][2])
                print(f'pair {number}: {known.sum()} corners, spacing {1e3 * gaps.mean():.3f} mm, '
                      f'mean error {1e3 * np.abs(gaps - SQUARE).mean():.3f} mm, off plane {1e3 * off_plane.mean():.3f} mm')
                self.assertLess(np.abs(gaps - SQUARE).mean(), 0.25e-3)
                self.assertLess(abs(gaps.mean() - SQUARE), 0.1e-3)
                self.assertLess(off_plane.mean(), 0.5e-3)


if __name__ == '__main__':
    rospy.init_node('test_real_pair')
    rostest.rosrun('cortshift_stereo', 'test_real_pair', RealPair)
