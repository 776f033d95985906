"""ROS messages to numpy: the border between bags and the cores."""
from dataclasses import asdict, dataclass

import numpy as np
from matplotlib.path import Path

from cortshift_tracking.errors import CaseError
from cortshift_tracking.poses import pose_matrix

MR_KEY = 'pmr'  # stands for the brain of the preoperative MR, in place of a stage


def cloud_arrays(cloud):
    """Fields of an organised PointCloud2 by name: (H, W) float32 each; 'rgb' as (H, W, 3) uint8 red green blue."""
    raw = np.frombuffer(cloud.data, np.uint8)
    if raw.size < cloud.height * cloud.row_step or cloud.row_step < cloud.width * cloud.point_step:
        raise CaseError(f'a cloud of {cloud.height} x {cloud.width} points is cut short; restore the file')
    raw = raw[:cloud.height * cloud.row_step].reshape(cloud.height, cloud.row_step)
    raw = raw[:, :cloud.width * cloud.point_step].reshape(cloud.height, cloud.width, cloud.point_step)
    arrays = {}
    for field in cloud.fields:
        column = np.ascontiguousarray(raw[..., field.offset:field.offset + 4])
        if field.name == 'rgb':  # packed; read as a float it may be a NaN
            arrays['rgb'] = column[..., [2, 1, 0]]
        else:
            arrays[field.name] = column.view(np.float32)[..., 0]
    return arrays


def _vectors(arrays, *names):
    for name in names:
        if name not in arrays:
            raise CaseError(f'a cloud lacks the field {name}; there are: {", ".join(sorted(arrays))}')
    return np.stack([arrays[name] for name in names], -1).astype(float)


@dataclass(frozen=True)
class Provenance:
    """What a result was made with and from, as cortshift_msgs/Provenance; an empty text: not known."""
    software: str = ''
    configuration: str = ''
    calibration: str = ''


def _provenance(message):
    said = getattr(message, 'provenance', None)  # messages of earlier versions have none
    return Provenance() if said is None else Provenance(said.software, said.configuration, said.calibration)


@dataclass(frozen=True)
class Stage:
    """A captured surface. points (H, W, 3) in pmr [m], NaN where none; colour (H, W, 3) uint8 RGB; confidence (H, W) 0-1.

    stamp, coverage, warnings as in StageInfo. T_pmr_left (4, 4): left camera, or None where its pose is not known.
    """
    key: str
    note: str
    stamp: float
    points: np.ndarray
    colour: np.ndarray
    confidence: np.ndarray
    T_pmr_left: np.ndarray
    coverage: float
    path: str = ''
    warnings: tuple = ()
    epoch: int = 0   # of the patient registration and calibration; 0: not known
    provenance: Provenance = Provenance()
    left_info: object = None   # sensor_msgs/CameraInfo; points and colour are organised as its rectified image


def stage_from_messages(info, cloud, path='', left_info=None):
    arrays = cloud_arrays(cloud)
    points = _vectors(arrays, 'x', 'y', 'z')
    colour = arrays.get('rgb', np.full(points.shape, 128, np.uint8))
    confidence = arrays.get('confidence', np.ones(points.shape[:2], np.float32))
    position = info.camera_pose.position
    known = np.isfinite([position.x, position.y, position.z]).all() and info.camera_pose.orientation.w == \
        info.camera_pose.orientation.w
    return Stage(info.key, info.note, info.stamp.to_sec(), points, colour, confidence,
                 pose_matrix(info.camera_pose) if known else None, info.coverage, path, tuple(info.warnings),
                 info.epoch, _provenance(info), left_info)


@dataclass(frozen=True)
class Field:
    """A displacement field over its projection grid (H, W). start, displacement in pmr [m], NaN where not trusted.

    T_pmr_projection (4, 4), resolution [m]: grid point (row, column) lies at (column, row, 0) * resolution.
    summary: the cortshift_msgs/ShiftSummary. strain_major, strain_minor (H, W) or None.
    """
    from_key: str
    to_key: str
    from_stamp: float
    to_stamp: float
    T_pmr_projection: np.ndarray
    resolution: float
    start: np.ndarray
    displacement: np.ndarray
    colour: np.ndarray
    confidence: np.ndarray
    summary: object
    strain_major: np.ndarray = None
    strain_minor: np.ndarray = None
    uncertainty: np.ndarray = None   # (H, W) [m]: root mean square length expected of the error; None: not known
    brain: tuple = ()                # polygons (N, 2) in x and y of the projection [m], brain in an odd number of them; (): not known
    provenance: Provenance = Provenance()

    @property
    def remarks(self):
        """What goes with the field into every file: name to text, of what is known of its provenance and its warnings."""
        warnings = [] if self.summary is None else self.summary.warnings
        said = {**asdict(self.provenance), 'warnings': ' | '.join(' '.join(warning.split()) for warning in warnings)}
        return {name: text for name, text in said.items() if text}

    @property
    def from_mr(self):
        return self.from_key == MR_KEY

    @property
    def valid(self):
        return np.isfinite(self.displacement).all(-1)

    @property
    def normal_pmr(self):
        return self.T_pmr_projection[:3, 2]

    def _outlines_around(self, points_pmr):
        """In how many of the brain's outlines points (..., 3) lie; in one where they are not known."""
        points = np.asarray(points_pmr)
        if not self.brain:
            return np.ones(points.shape[:-1], int)
        local = (points - self.T_pmr_projection[:3, 3]).reshape(-1, 3) @ self.T_pmr_projection[:3, :2]
        return np.sum([Path(polygon).contains_points(local) for polygon in self.brain], axis=0).reshape(points.shape[:-1])

    def on_brain(self, points_pmr):
        """Whether points (..., 3) lie over the exposed brain; all do where its outline is not known."""
        return self._outlines_around(points_pmr) % 2 == 1   # a hole lies in two

    def in_opening(self, points_pmr):
        """Whether points (..., 3) lie over the exposed brain or over what lies on it."""
        return self._outlines_around(points_pmr) > 0

    def at(self, point_pmr, reach=0.0005):
        """Displacement (3,) [m] of the surface at a point: linear between grid points, else the nearest within `reach` [m].

        None where the field says nothing there.
        """
        local = self.T_pmr_projection[:3, :3].T @ (np.asarray(point_pmr) - self.T_pmr_projection[:3, 3]) / self.resolution
        column, row = local[:2]
        c, r = int(np.floor(column)), int(np.floor(row))
        height, width = self.confidence.shape
        if 0 <= r < height - 1 and 0 <= c < width - 1:
            quad = self.displacement[r:r + 2, c:c + 2]
            if np.isfinite(quad).all():
                a, b = column - c, row - r
                return (1 - b) * ((1 - a) * quad[0, 0] + a * quad[0, 1]) + b * ((1 - a) * quad[1, 0] + a * quad[1, 1])
        n = int(np.ceil(reach / self.resolution))
        r0, c0 = max(0, r - n), max(0, c - n)
        block = self.displacement[r0:max(0, r + n + 2), c0:max(0, c + n + 2)]
        rows, columns = np.nonzero(np.isfinite(block).all(-1))
        if not len(rows):
            return None
        distance = np.hypot(rows + r0 - row, columns + c0 - column)
        nearest = distance.argmin()
        return block[rows[nearest], columns[nearest]] if distance[nearest] * self.resolution <= reach else None


def field_from_message(message):
    arrays = cloud_arrays(message.points)
    displacement = _vectors(arrays, 'dx', 'dy', 'dz')
    return Field(message.from_key, message.to_key, message.from_stamp.to_sec(), message.to_stamp.to_sec(),
                 pose_matrix(message.projection), message.resolution, _vectors(arrays, 'x', 'y', 'z'), displacement,
                 arrays.get('rgb', np.full(displacement.shape, 128, np.uint8)),
                 arrays.get('confidence', np.ones(displacement.shape[:2], np.float32)), message.summary,
                 arrays.get('strain_major'), arrays.get('strain_minor'), arrays.get('uncertainty'),
                 tuple(np.array([[corner.x, corner.y] for corner in polygon.points]) for polygon in message.brain if len(polygon.points) > 2), _provenance(message))
