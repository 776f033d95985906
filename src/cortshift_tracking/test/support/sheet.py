"""A surface that tests send in place of the reconstruction."""
import cv2
import numpy as np
import rospy
from sensor_msgs.msg import PointCloud2, PointField

from graph import wait_until

SIZE, STEP = 240, 0.00025  # points a side, m between them


def sheet(stamp, lift=0.0):
    """A textured, slightly curved sheet of 60 x 60 mm in pmr, moved by `lift` [m] along z."""
    y, x = np.mgrid[:SIZE, :SIZE] * STEP - 0.03
    texture = cv2.GaussianBlur(np.random.default_rng(1).uniform(0, 255, (SIZE, SIZE)).astype(np.float32), (0, 0), 2.5)
    grey = cv2.normalize(texture, None, 30, 220, cv2.NORM_MINMAX).astype(np.uint32)
    cloud = np.zeros((SIZE, SIZE, 5), np.float32)
    cloud[..., 0], cloud[..., 1], cloud[..., 2] = x, y, 0.3 + 2 * (x ** 2 + y ** 2) + lift
    cloud[..., 3] = (0xff000000 | grey << 16 | grey << 8 | grey).astype(np.uint32).view(np.float32)
    cloud[..., 4] = 1
    message = PointCloud2(height=SIZE, width=SIZE, point_step=20, row_step=20 * SIZE, data=cloud.tobytes())
    message.header.frame_id, message.header.stamp = 'pmr', stamp
    message.fields = [PointField(n, 4 * i, PointField.FLOAT32, 1) for i, n in enumerate(('x', 'y', 'z', 'rgb', 'confidence'))]
    return message


class SheetSource:
    """Sends sheets to a shift_tracker, and knows when it has them."""

    def __init__(self, diagnostics):
        self._diagnostics = diagnostics
        self._surfaces = rospy.Publisher('/surface/points', PointCloud2, queue_size=2)

    def connect(self):
        wait_until(lambda: self._surfaces.get_num_connections() == 1, 30, 'the subscription of /surface/points')

    def send(self, lift=0.0):
        """Stamp of a sheet of now, once the node has it."""
        now = rospy.Time.now()
        stamp = rospy.Time(now.secs, now.nsecs // 1000000 * 1000000)  # what the node says of it in text is then exact
        self._surfaces.publish(sheet(stamp, lift))
        self._diagnostics.wait_for('shift_tracker: surfaces', newest_stamp=f'{stamp.secs}.{stamp.nsecs // 1000000:03d}')
        return stamp
