"""A recorded case that shares nothing with the project's own phantom: numpy renders it, OpenCV rectifies it.

Another surface (a saddle on an ellipsoid), another texture (filtered noise), other cameras (verging, five distortion
terms, principal points that differ), another tf tree. It follows the outside contract, so whatever reads a contract
bag must measure it as well as it measures the phantom.
"""
import copy

import cv2
import numpy as np
import rosbag
import rospy
from geometry_msgs.msg import PoseStamped, TransformStamped
from scipy.ndimage import map_coordinates, spline_filter
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

SIZE = (1024, 768)
TEXTURE_STEP = 0.00006  # [m] per texture pixel
TEXTURE_SIDE = 2000


def pose(translation, rotation_vector):
    """4x4 matrix from metres and a rotation vector in degrees."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(np.deg2rad(rotation_vector)).as_matrix()
    matrix[:3, 3] = translation
    return matrix


def looking_at(position, target, roll):
    """4x4 pose of a camera at `position` with `target` on its axis; roll in degrees."""
    z = np.subtract(target, position) / np.linalg.norm(np.subtract(target, position))
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([x, np.cross(z, x), z]) @ Rotation.from_rotvec([0, 0, np.deg2rad(roll)]).as_matrix()
    matrix[:3, 3] = position
    return matrix


class Camera:
    def __init__(self, focal, centre, distortion):
        self.K = np.array([[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1.0]])
        self.D = np.array(distortion)

    def rays(self):
        """Directions (H, W, 3) with z = 1 through every raw pixel."""
        u, v = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float))
        # OpenCV's own undistortion stops early; fixed-point iterations to convergence keep the truth exact.
        x0 = (u - self.K[0, 2]) / self.K[0, 0]
        y0 = (v - self.K[1, 2]) / self.K[1, 1]
        x, y = x0.copy(), y0.copy()
        k1, k2, p1, p2, k3 = self.D
        for _ in range(40):
            r2 = x * x + y * y
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            x, y = ((x0 - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial,
                    (y0 - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial)
        return np.stack([x, y, np.ones_like(x)], axis=-1)


class IndependentCase:
    """Two stages, `before` and `after`; `displacement` is the truth."""

    T_pmr_reference = pose([0.021, -0.113, 0.047], [12, 171, -33])
    T_microscope_left = pose([-0.011, 0.038, -0.205], [3, -8, 64])
    T_left_right = pose([0.0301, 0.0012, 0.0004], [0.4, -5.2, 0.7])
    T_pmr_patch = pose([-0.052, 0.031, 0.078], [-21, 17, 40])  # origin and axes of the surface's own map, z outward
    # left_optical in the patch's frame at each stage: working distance, tilt and roll differ.
    T_patch_left = {'before': looking_at([0.021, -0.033, 0.290], [0, 0.001, 0], -9),
                    'after': looking_at([0.004, -0.012, 0.303], [0.001, 0, -0.004], 6)}
    pair_times = {'before': (2.0, 2.26, 2.52, 2.78), 'after': (8.0, 8.26, 8.52, 8.78)}  # [s] from the bag's start
    duration = 11.0

    def __init__(self, noise=1.0, seed=7):
        self.random = np.random.default_rng(seed)
        self.noise = noise
        self.left = Camera((3520, 3535), (498.3, 391.2), [-0.31, 0.9, 0.0006, -0.0009, 0.0])
        self.right = Camera((3564, 3549), (531.8, 377.5), [-0.27, 0.4, -0.0004, 0.0007, 0.0])
        spectrum = np.fft.rfft2(self.random.standard_normal((TEXTURE_SIDE, TEXTURE_SIDE, 3)), axes=(0, 1))
        frequency2 = np.fft.fftfreq(TEXTURE_SIDE)[:, None] ** 2 + np.fft.rfftfreq(TEXTURE_SIDE)[None] ** 2
        filters = sum(weight * sigma * np.exp(-2 * (np.pi * sigma) ** 2 * frequency2)
                      for sigma, weight in ((2.6, 0.55), (6, 0.7), (16, 0.9), (45, 1.0), (120, 0.8)))
        texture = np.fft.irfft2(spectrum * filters[..., None], s=(TEXTURE_SIDE, TEXTURE_SIDE), axes=(0, 1))
        texture = texture @ np.array([[1, .5, .4], [.5, 1, .5], [.3, .5, 1]])
        texture = np.clip(0.5 + 0.13 * texture / texture.std(), 0.03, 0.97) * 255
        self.texture = [spline_filter(texture[..., c], order=3, mode='grid-wrap') for c in range(3)]

    @staticmethod
    def _amount(x, y):
        return np.exp(-(x * x + 0.7 * y * y + 0.3 * x * y) / (2 * 0.024 ** 2))

    def displacement_patch(self, x, y):
        """Displacement before -> after of material point (x, y), in the patch's frame [m]."""
        a = self._amount(x, y)
        return np.stack([0.0021 * a + 0.0003 * np.sin(60 * y), -0.0016 * a + 0.0002 * np.cos(50 * x),
                         -0.0068 * a - 0.0008 + 0.01 * x], axis=-1)

    def surface_patch(self, stage, x, y):
        height = -8 * x * x + 3.5 * x * y - 5 * y * y + 0.0007 * np.sin(310 * x + 1) * np.cos(270 * y)
        points = np.stack([x, y, height], axis=-1)
        return points if stage == 'before' else points + self.displacement_patch(x, y)

    def material(self, stage, points_pmr):
        """Material coordinates (x, y) below points near the stage's surface, and their distance from it along z [m]."""
        T = np.linalg.inv(self.T_pmr_patch)
        p = points_pmr @ T[:3, :3].T + T[:3, 3]
        x, y = p[..., 0].copy(), p[..., 1].copy()
        for _ in range(30):
            s = self.surface_patch(stage, x, y)
            x += p[..., 0] - s[..., 0]
            y += p[..., 1] - s[..., 1]
        return x, y, p[..., 2] - self.surface_patch(stage, x, y)[..., 2]

    def displacement(self, start_pmr):
        """True displacement in pmr of points on the surface `before` [m]."""
        x, y, _ = self.material('before', start_pmr)
        return self.displacement_patch(x, y) @ self.T_pmr_patch[:3, :3].T

    def render(self, stage, camera, T_patch_camera):
        rays = camera.rays() @ T_patch_camera[:3, :3].T
        origin = T_patch_camera[:3, 3]
        t = -origin[2] / rays[..., 2]
        x = origin[0] + t * rays[..., 0]
        y = origin[1] + t * rays[..., 1]
        step = 1e-6
        for _ in range(12):  # Newton on surface(x, y) - origin - t ray = 0
            s = self.surface_patch(stage, x, y)
            residual = s - origin - t[..., None] * rays
            sx = (self.surface_patch(stage, x + step, y) - s) / step
            sy = (self.surface_patch(stage, x, y + step) - s) / step
            delta = np.linalg.solve(np.stack([sx, sy, -rays], axis=-1), -residual[..., None])[..., 0]
            x, y, t = x + delta[..., 0], y + delta[..., 1], t + delta[..., 2]
            if np.abs(delta).max() < 1e-9:
                break
        else:
            raise RuntimeError('rays do not meet the surface')
        where = np.stack([y, x]) / TEXTURE_STEP + TEXTURE_SIDE / 2
        return np.stack([map_coordinates(c, where, order=3, mode='grid-wrap', prefilter=False) for c in self.texture], -1)

    def camera_infos(self):
        R, T = np.linalg.inv(self.T_left_right)[:3, :3], np.linalg.inv(self.T_left_right)[:3, 3]
        R1, R2, P1, P2, *_ = cv2.stereoRectify(self.left.K, self.left.D, self.right.K, self.right.D, SIZE, R, T, flags=0,
                                               alpha=-1)
        infos = []
        for camera, rectification, projection in ((self.left, R1, P1), (self.right, R2, P2)):
            info = CameraInfo(width=SIZE[0], height=SIZE[1], distortion_model='plumb_bob', D=list(camera.D),
                              K=list(camera.K.ravel()), R=list(rectification.ravel()), P=list(projection.ravel()))
            info.header.frame_id = 'left_optical'
            infos.append(info)
        return infos

    @staticmethod
    def _image(array, frame):
        message = Image(height=array.shape[0], width=array.shape[1], encoding='bgr8', step=array.shape[1] * 3,
                        data=array.tobytes())
        message.header.frame_id = frame
        return message

    @staticmethod
    def _transform(matrix, parent, child, stamp):
        message = TransformStamped()
        message.header.stamp, message.header.frame_id, message.child_frame_id = stamp, parent, child
        t, r = message.transform.translation, message.transform.rotation
        t.x, t.y, t.z = matrix[:3, 3]
        r.x, r.y, r.z, r.w = Rotation.from_matrix(matrix[:3, :3]).as_quat()
        return message

    def _T_reference_microscope(self, stage):
        return np.linalg.inv(self.T_pmr_reference) @ self.T_pmr_patch @ self.T_patch_left[stage] @ np.linalg.inv(
            self.T_microscope_left)

    def write(self, path, start=1700000000.0, stages=('before', 'after'), tracked=True, right_delay=0.0):
        """Write the case as a bag. `tracked` False leaves out the tracker; `right_delay` [s] breaks the pairs' common stamp."""
        events = []
        stamp = rospy.Time.from_sec(start)
        static = TFMessage([self._transform(self.T_pmr_reference, 'pmr', 'reference', stamp),
                            self._transform(self.T_microscope_left, 'microscope', 'left_optical', stamp),
                            self._transform(self.T_left_right, 'left_optical', 'right_optical', stamp)])
        events.append((stamp, '/tf_static', static))
        for seconds in np.arange(0, self.duration, 0.04) + 0.007 if tracked else ():
            stage = 'before' if seconds < 5 else 'after'
            stamp = rospy.Time.from_sec(start + seconds)
            events.append((stamp, '/tf', TFMessage([self._transform(self._T_reference_microscope(stage), 'reference',
                                                                    'microscope', stamp)])))
        infos = self.camera_infos()
        for stage in stages:
            T_patch_left = self.T_patch_left[stage]
            clean = [self.render(stage, self.left, T_patch_left),
                     self.render(stage, self.right, T_patch_left @ self.T_left_right)]
            for seconds in self.pair_times[stage]:
                for side, array, info, delay in zip(('left', 'right'), clean, infos, (0.0, right_delay)):
                    stamp = rospy.Time.from_sec(start + seconds + delay)
                    noisy = array + self.random.normal(0, self.noise, array.shape)
                    image = self._image(np.clip(np.rint(noisy), 0, 255).astype(np.uint8), f'{side}_optical')
                    info = copy.deepcopy(info)
                    image.header.stamp = info.header.stamp = stamp
                    arrival = stamp + rospy.Duration.from_sec(0.01)
                    events += [(arrival, f'/stereo/{side}/image_raw', image), (arrival, f'/stereo/{side}/camera_info', info)]
        with rosbag.Bag(path, 'w') as bag:
            for stamp, topic, message in sorted(events, key=lambda event: event[0]):
                bag.write(topic, message, stamp)
