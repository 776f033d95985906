"""Writes a Field as a bag with a DisplacementField on /shift/field, as process_bag does."""
from dataclasses import asdict

import numpy as np
import rosbag
import rospy
from cortshift_msgs.msg import DisplacementField, Provenance, ShiftSummary
from geometry_msgs.msg import Point32, Polygon
from sensor_msgs.msg import PointCloud2, PointField

from cortshift_tracking.durable import replacing
from cortshift_tracking.poses import pose_message


def summarise(field, overlap, seconds, first_normal_pmr, gravity_pmr=None, warnings=()):
    """ShiftSummary of a field (section 2.7.2).

    overlap: share of the earlier surface that the later one covers (0-1). seconds: it took. first_normal_pmr: average normal of
    the case's first stage; gravity_pmr: direction of gravity, or None; unit vectors. warnings: what is doubtful of what it is made from.
    """
    valid = field.displacement[field.valid]
    normal = valid @ first_normal_pmr
    parts = {'magnitude': np.linalg.norm(valid, axis=1), 'normal': normal,
             'lateral': np.linalg.norm(valid - normal[:, None] * first_normal_pmr, axis=1),
             'gravity': np.full(len(valid), np.nan) if gravity_pmr is None else valid @ gravity_pmr}
    values = {}
    for name, part in parts.items():
        values[f'{name}_mean'], values[f'{name}_sd'] = float(part.mean()), float(part.std(ddof=1))
        values[f'brain_{name}_mean'] = values[f'brain_{name}_sd'] = float('nan')  # the MR has no outline
    angle = float('nan') if gravity_pmr is None else float(np.arccos(np.clip(first_normal_pmr @ gravity_pmr, -1, 1)))
    return ShiftSummary(from_key=field.from_key, to_key=field.to_key, valid_points=len(valid), overlap=overlap,
                        gravity_normal_angle=angle, compute_time=seconds, latency=float('nan'), warnings=list(warnings), common_sd=float('nan'),
                        outline='not known: the field starts on the preoperative MR', **values)


def to_message(field, summary):
    message = DisplacementField(from_key=field.from_key, to_key=field.to_key, from_stamp=rospy.Time.from_sec(field.from_stamp),
                                to_stamp=rospy.Time.from_sec(field.to_stamp), resolution=field.resolution,
                                summary=summary, provenance=Provenance(**asdict(field.provenance)))
    message.header.frame_id, message.header.stamp = 'pmr', message.to_stamp
    message.projection = pose_message(field.T_pmr_projection)
    message.brain = [Polygon([Point32(x, y, 0) for x, y in polygon]) for polygon in field.brain]
    colour = field.colour.astype(np.uint32)
    packed = (colour[..., 0] << 16 | colour[..., 1] << 8 | colour[..., 2]).astype(np.uint32).view(np.float32)
    columns = [*np.moveaxis(field.start, -1, 0), *np.moveaxis(field.displacement, -1, 0),
               np.where(field.valid, packed, np.float32(np.nan)), field.confidence]
    names = ['x', 'y', 'z', 'dx', 'dy', 'dz', 'rgb', 'confidence']
    if field.uncertainty is not None:
        columns.append(field.uncertainty)
        names.append('uncertainty')
    cloud = PointCloud2(header=message.header, height=field.confidence.shape[0], width=field.confidence.shape[1],
                        point_step=4 * len(columns), is_dense=False)
    cloud.fields = [PointField(name, 4 * n, PointField.FLOAT32, 1)
                    for n, name in enumerate(names)]
    cloud.row_step = cloud.point_step * cloud.width
    cloud.data = np.stack([np.asarray(c, np.float32) for c in columns], -1).tobytes()
    message.points = cloud
    return message


def write_field(path, field, summary):
    """Write the bag durably; nothing is left behind where that fails. Raises OSError."""
    message = to_message(field, summary)
    with replacing(path) as temporary, rosbag.Bag(temporary, 'w', compression='lz4') as bag:
        bag.write('/shift/field', message, message.header.stamp)
