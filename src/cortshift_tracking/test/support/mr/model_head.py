"""A small head of ellipsoids with a tumour, whose model is prepared in seconds."""
import numpy as np
from cortshift_tracking.mr.volume import Volume
from scipy.spatial.transform import Rotation

RADII = np.array([0.066, 0.080, 0.058])     # of the brain [m]
TUMOUR = np.array([0.022, 0.008, 0.032])    # its middle
TUMOUR_RADIUS = 0.012
OUTWARD = np.array([0.45, 0.15, 0.85]) / np.linalg.norm([0.45, 0.15, 0.85])
CRANIOTOMY = OUTWARD / np.linalg.norm(OUTWARD / RADII)

OPENING = 0.032     # radius of the craniotomy


def inside(name, points):
    """Whether points (..., 3) are in the structure."""
    if name == 'tumour':
        return np.linalg.norm(points - TUMOUR, axis=-1) < TUMOUR_RADIUS
    if name == 'ventricles':
        return np.linalg.norm((np.abs(points * [1, 0, 0]) + points * [0, 1, 1] - [0.011, 0.0, 0.006]) / [0.006, 0.024, 0.008], axis=-1) < 1
    return (np.abs(points[..., 0]) < 0.0022) & (points[..., 2] > 0.012)   # falx, above the ventricles


def volumes(step=0.002, oblique=0.0, axes='RAS'):
    """MR, brain mask and tumour as Volumes on one grid, turned by `oblique` [rad] about (1, 2, 3) and left-handed."""
    turn = Rotation.from_rotvec(oblique * np.array([1, 2, 3]) / np.sqrt(14)).as_matrix()
    size = np.ceil(2 * (RADII.max() + 0.014) / step * np.ones(3)).astype(int)
    T = np.eye(4)
    T[:3, :3] = turn @ np.diag([-step, step, step])
    T[:3, 3] = -T[:3, :3] @ (size - 1) / 2
    points = np.stack(np.meshgrid(*[np.arange(n) for n in size], indexing='ij'), -1) @ T[:3, :3].T + T[:3, 3]
    if axes == 'LPS':
        points = points * [-1, -1, 1]
        T = np.diag([1, 1, 1, 1.0]) @ T
    radius = np.linalg.norm(points / RADII, axis=-1)
    brain = radius < 1
    tumour = inside('tumour', points)
    stripes = 100 + 15 * np.sin(points[..., 0] / 0.006) * np.cos(points[..., 1] / 0.005) * np.cos(points[..., 2] / 0.007)
    mr = np.where(brain, stripes, 8.0)
    mr = np.where(radius > 1.1, 70.0 * (radius < 1.16), mr) + 60 * tumour
    return [Volume(values.astype(np.float32), T, axes, name) for values, name in
            ((mr, 'mr.nii'), (brain, 'brain.nii'), (tumour, 'tumour.nii'))]


def surface_grid(radius=0.026, step=0.0005):
    """Points (H, W, 3) of the brain's border around the craniotomy, NaN beyond `radius`, over a plane; and that plane's axes."""
    across = np.cross(OUTWARD, [0, 1, 0])
    across /= np.linalg.norm(across)
    up = np.cross(OUTWARD, across)
    axis = np.arange(-radius, radius + step / 2, step)
    x, y = np.meshgrid(axis, axis)
    points = CRANIOTOMY + x[..., None] * across + y[..., None] * up
    for _ in range(8):   # along the outward direction to the ellipsoid
        value = ((points / RADII) ** 2).sum(-1) - 1
        slope = (2 * points / RADII ** 2) @ OUTWARD
        points = points - (value / slope)[..., None] * OUTWARD
    points[np.hypot(x, y) > radius] = np.nan
    return points, np.column_stack([across, up, OUTWARD])


def sag(points, depth=0.008, width=0.022):
    """A displacement [m] of points near the craniotomy that looks like sagging."""
    off = points - CRANIOTOMY
    lateral = off - (off @ OUTWARD)[..., None] * OUTWARD
    return -depth * OUTWARD * np.exp(-(lateral ** 2).sum(-1) / (2 * width ** 2))[..., None]
