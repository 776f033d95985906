"""geometry_msgs poses to matrices T_a_b (4, 4) and back, metres."""
import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion
from scipy.spatial.transform import Rotation

from cortshift_tracking.errors import CaseError

LENGTH_TOLERANCE = 1e-3  # of a quaternion's squared length from 1; what is off by more is no rotation but damage


def rotation_from_message(q):
    """scipy Rotation of a geometry_msgs/Quaternion. Raises CaseError where its length is not 1."""
    values = np.array([q.x, q.y, q.z, q.w])
    if not abs(values @ values - 1) < LENGTH_TOLERANCE:
        raise CaseError(f'quaternion ({q.x}, {q.y}, {q.z}, {q.w}) is not a rotation')
    return Rotation.from_quat(values)


def pose_matrix(pose):
    """T_parent_child of a geometry_msgs/Pose. Raises CaseError where its rotation is none."""
    T = np.eye(4)
    T[:3, :3] = rotation_from_message(pose.orientation).as_matrix()
    T[:3, 3] = pose.position.x, pose.position.y, pose.position.z
    return T


def pose_message(T):
    """geometry_msgs/Pose of a matrix T_parent_child."""
    return Pose(Point(*T[:3, 3]), Quaternion(*Rotation.from_matrix(T[:3, :3]).as_quat()))
