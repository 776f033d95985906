"""A case folder with stages, fields and probe points whose truth is a formula; no rendering, no reconstruction."""
import os

import numpy as np
import rosbag
import rospy
from cortshift_msgs.msg import DisplacementField, ShiftSummary, StageInfo
from cortshift_tracking.probe.points import ProbePoint
from cortshift_tracking.probe.store import ProbeStore
from geometry_msgs.msg import Pose
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, PointCloud2, PointField

SIZE = (240, 320)      # rows, columns of a stage
PIXEL = 0.00025        # [m] on the surface
GRAVITY = np.array([-0.42, -0.66, -0.62]) / np.linalg.norm([-0.42, -0.66, -0.62])
T_PMR_PATCH = np.eye(4)  # z outwards
T_PMR_PATCH[:3, :3] = Rotation.from_euler('xyz', [-0.736, 0.052, -0.781]).as_matrix()
T_PMR_PATCH[:3, 3] = [0.041, 0.037, 0.064]
STAGES = {'dural_opening': 0.0, 'before_resection': 0.45, 'after_resection': 1.0}
LABELS = {'p1': (-0.012, 0.006), 'p2': (0.010, 0.009), 'p3': (0.008, -0.011), 'p4': (-0.006, -0.009)}
START = 1700000000.0


def to_pmr(points):
    return points @ T_PMR_PATCH[:3, :3].T + T_PMR_PATCH[:3, 3]


def displacement_patch(amount, x, y):
    window = np.exp(-(x * x + y * y) / (2 * 0.014 ** 2))
    down = GRAVITY @ T_PMR_PATCH[:3, :3]
    return amount * window[..., None] * (0.006 * down + np.array([0.002, -0.001, 0.0]))


def surface(stage, x, y):
    """Point in pmr of material (x, y) [m] at a stage."""
    height = 0.075 - np.sqrt(0.075 ** 2 + x * x + y * y)
    return to_pmr(np.stack([x, y, height], -1) + displacement_patch(STAGES[stage], x, y))


def pose(T):
    message = Pose()
    message.position.x, message.position.y, message.position.z = T[:3, 3]
    q = message.orientation
    q.x, q.y, q.z, q.w = Rotation.from_matrix(T[:3, :3]).as_quat()
    return message


def cloud(header, **columns):
    """Organised PointCloud2 of float32 columns (H, W); rgb as packed uint32 bits."""
    height, width = next(iter(columns.values())).shape
    message = PointCloud2(header=header, height=height, width=width, point_step=4 * len(columns), is_dense=False)
    message.row_step = message.point_step * width
    message.fields = [PointField(name, 4 * n, PointField.FLOAT32, 1) for n, name in enumerate(columns)]
    message.data = np.stack([c.astype(np.float32) if c.dtype != np.uint32 else c.view(np.float32)
                             for c in columns.values()], -1).tobytes()
    return message


def packed(grey):
    value = np.clip(grey * 255, 0, 255).astype(np.uint32)
    return np.uint32(0xff000000) | value << 16 | (value * 3 // 4) << 8 | value * 2 // 3


def texture(x, y):
    return 0.55 + 0.2 * np.sin(900 * x + 3 * np.sin(300 * y)) + 0.15 * np.cos(1300 * y + 400 * x)


def stage_grid():
    """Material coordinates behind the pixels: rows run down, so y falls."""
    column, row = np.meshgrid(np.arange(SIZE[1]), np.arange(SIZE[0]))
    return (column - SIZE[1] / 2) * PIXEL, -(row - SIZE[0] / 2) * PIXEL


def camera_pose():
    T = np.eye(4)
    T[:3, :3] = T_PMR_PATCH[:3, :3] @ np.diag([1.0, -1.0, -1.0])  # looks along -z of the patch
    T[:3, 3] = to_pmr(np.array([0, 0, 0.3]))
    return T


def write_stage(folder, number, key, minutes):
    stamp = rospy.Time.from_sec(START + 60 * minutes)
    x, y = stage_grid()
    points = surface(key, x, y).astype(np.float32)
    points[:6] = np.nan
    info = StageInfo(key=key, note='synthetic', stamp=stamp, valid_points=int(np.isfinite(points).all(-1).sum()),
                     coverage=float(np.isfinite(points).all(-1).mean()), camera_pose=pose(camera_pose()))
    header = rospy.Header(frame_id='pmr', stamp=stamp)
    confidence = np.where(np.isfinite(points[..., 0]), 0.9, np.nan)
    with rosbag.Bag(os.path.join(folder, f'{number:04d}_{key}_0.bag'), 'w', compression='lz4') as bag:
        bag.write('/stage/info', info, stamp)
        bag.write('/surface/points', cloud(header, x=points[..., 0], y=points[..., 1], z=points[..., 2],
                                           rgb=packed(texture(x, y)), confidence=confidence), stamp)
        for side, b in (('left', 0.0), ('right', -88.0)):
            bag.write(f'/stereo/{side}/camera_info', CameraInfo(
                width=SIZE[1], height=SIZE[0], distortion_model='plumb_bob', D=[-0.3, 0, 0, 0, 0],
                K=[3500, 0, 160, 0, 3500, 120, 0, 0, 1], R=list(np.eye(3).ravel()),
                P=[3500, 0, 160, b, 0, 3500, 120, 0, 0, 0, 1, 0]), stamp)


def field_message(first, second, minutes, resolution=0.0003):
    """The exact field between two stages, over material coordinates of the earlier stage; a disc of it is valid."""
    half = 0.028
    axis = np.arange(-half, half, resolution)
    # Grid points are fixed in space: find the material point below each by iteration.
    gx, gy = np.meshgrid(axis, axis)
    x, y = gx.copy(), gy.copy()
    for _ in range(40):
        d = displacement_patch(STAGES[first], x, y)
        x, y = gx - d[..., 0], gy - d[..., 1]
    start, vector = surface(first, x, y), surface(second, x, y) - surface(first, x, y)
    hidden = np.hypot(gx, gy) > 0.026
    start[hidden] = vector[hidden] = np.nan
    T = T_PMR_PATCH.copy()
    T[:3, 3] = to_pmr(np.array([-half, -half, 0]))
    magnitude = np.linalg.norm(vector[~hidden], axis=-1)
    gravity = vector[~hidden] @ GRAVITY
    normal = vector[~hidden] @ T_PMR_PATCH[:3, 2]
    lateral = np.linalg.norm(vector[~hidden] - normal[:, None] * T_PMR_PATCH[:3, 2], axis=-1)
    statistic = {f'{name}_{kind}': float(function(values)) for name, values in
                 (('magnitude', magnitude), ('gravity', gravity), ('normal', normal), ('lateral', lateral))
                 for kind, function in (('mean', np.mean), ('sd', np.std))}
    message = DisplacementField(from_key=first, to_key=second, from_stamp=rospy.Time.from_sec(START + 60 * minutes[0]),
                                to_stamp=rospy.Time.from_sec(START + 60 * minutes[1]), projection=pose(T),
                                resolution=resolution)
    message.header.frame_id, message.header.stamp = 'pmr', message.to_stamp
    message.summary = ShiftSummary(from_key=first, to_key=second, valid_points=int((~hidden).sum()), overlap=0.97,
                                   gravity_normal_angle=float(np.arccos(GRAVITY @ T_PMR_PATCH[:3, 2])), compute_time=0.8,
                                   **statistic)
    confidence = np.where(hidden, np.nan, 0.8 + 0.2 * np.cos(200 * gx))
    message.points = cloud(message.header, x=start[..., 0], y=start[..., 1], z=start[..., 2], dx=vector[..., 0],
                           dy=vector[..., 1], dz=vector[..., 2], rgb=packed(texture(x, y)), confidence=confidence)
    return message


def write_case(folder, probe_noise=0.0003, seed=1):
    """Stages at 0, 31 and 100 minutes, fields of both consecutive pairs and of the first to the last, probe and gravity."""
    minutes = dict(zip(STAGES, (0, 31, 100)))
    for number, key in enumerate(STAGES, start=1):
        write_stage(folder, number, key, minutes[key])
    names = list(STAGES)
    for first, second in ((names[0], names[1]), (names[1], names[2]), (names[0], names[2])):
        message = field_message(first, second, (minutes[first], minutes[second]))
        with rosbag.Bag(os.path.join(folder, f'{first}__{second}.bag'), 'w', compression='lz4') as bag:
            bag.write('/shift/field', message, message.header.stamp)
    random = np.random.default_rng(seed)
    store = ProbeStore(folder)
    for key in STAGES:
        for label, (x, y) in LABELS.items():
            place = surface(key, np.array(x), np.array(y)) + random.normal(0, probe_noise, 3)
            store.add(ProbePoint(key, label, (int(START), 0), tuple(float(v) for v in place), probe_noise, 20))
    above = to_pmr(np.array([0, 0, 0.05])) - 0.2 * GRAVITY
    for label, place in (('gravity_upper', above), ('gravity_lower', above + 0.15 * GRAVITY)):
        store.add(ProbePoint('', label, (int(START), 0), tuple(float(v) for v in place), 0.0, 20))
    picks = ['stage,label,column_px,row_px']
    for key in STAGES:
        picks += [f'{key},{label},{x / PIXEL + SIZE[1] / 2},{-y / PIXEL + SIZE[0] / 2}' for label, (x, y) in LABELS.items()]
    with open(os.path.join(folder, 'picks.csv'), 'w') as file:
        file.write('\n'.join(picks) + '\n')
