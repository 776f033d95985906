"""The update as a message, for the link to the navigation system and other programs."""
import numpy as np
import rospy
from cortshift_msgs.msg import MovedLabel, UpdatedMr
from sensor_msgs.msg import Image, PointCloud2, PointField
from std_msgs.msg import Header

FIELDS = ('x', 'y', 'z', 'dx', 'dy', 'dz')


def updated_mr_message(mr, structures, field):
    """cortshift_msgs/UpdatedMr of the updated MR (Volume) and its Structures, by a Field."""
    header = Header(stamp=rospy.Time.from_sec(field.to_stamp), frame_id='pmr')
    message = UpdatedMr(header=header, from_key=field.from_key, to_key=field.to_key, T_pmr_voxel=np.ravel(mr.T_pmr_voxel).tolist())
    columns, rows, _ = mr.data.shape
    for values in np.moveaxis(mr.data, 2, 0):
        message.slices.append(Image(header=header, height=rows, width=columns, encoding='32FC1', step=4 * columns,
                                    data=np.ascontiguousarray(values.T, '<f4').tobytes()))
    for structure in structures:
        data = np.concatenate([structure.was, structure.now - structure.was], 1).astype('<f4')
        cloud = PointCloud2(header=header, height=1, width=len(data), point_step=4 * len(FIELDS), row_step=4 * len(FIELDS) * len(data),
                            data=data.tobytes(), is_dense=True)
        cloud.fields = [PointField(name, 4 * n, PointField.FLOAT32, 1) for n, name in enumerate(FIELDS)]
        message.labels.append(MovedLabel(name=structure.name, border=cloud, quads=structure.quads.ravel().tolist()))
    return message
