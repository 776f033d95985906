"""A case on disk: stages, displacement fields, probe points, calibration; read without a master.

A stage is a bag with /stage/info and /surface/points, a field one with /shift/field, wherever they lie in the folder, one
below it or in the `fields` of one below it (`set_aside` and `deleted` are left alone).
"""
import glob
import os
from dataclasses import dataclass
from typing import List

import numpy as np
import rosbag
import yaml
from scipy import ndimage

from cortshift_tracking.errors import CaseError
from cortshift_tracking.geometry import local_frame
from cortshift_tracking.case.messages import MR_KEY, Field, Stage, field_from_message, stage_from_messages
from cortshift_tracking.probe.points import gravity_direction
from cortshift_tracking.probe.store import FILE_NAME, read_points

LEFT_ALONE = ('set_aside', 'deleted')


@dataclass(frozen=True)
class Case:
    """Stages in order of their exposure; fields with the pairs of consecutive stages first; unread: files and reasons."""
    folder: str
    stages: List[Stage]
    fields: List[Field]
    points: list
    camera_infos: dict      # 'left', 'right': sensor_msgs/CameraInfo of the first stage that has them
    calibrations: dict      # file name: content of the YAML calibration files in the folder
    unread: List[str]

    def stage(self, key):
        for stage in self.stages:
            if stage.key == key:
                return stage
        raise CaseError(f'{self.folder}: no stage "{key}"; there are: {", ".join(s.key for s in self.stages) or "none"}')

    def field(self, from_key, to_key):
        for field in self.fields:
            if (field.from_key, field.to_key) == (from_key, to_key):
                return field
        there = ', '.join(f'{f.from_key} -> {f.to_key}' for f in self.fields) or 'none'
        raise CaseError(f'{self.folder}: no field {from_key} -> {to_key}; there are: {there}')

    @property
    def gravity_pmr(self):
        """Unit vector of gravity from the probe's two positions, or None."""
        pair = {p.label: p.position for p in self.points if not p.stage}
        if 'gravity_upper' in pair and 'gravity_lower' in pair:
            return gravity_direction(pair['gravity_upper'], pair['gravity_lower'])
        return None

    @property
    def first_normal_pmr(self):
        """Average normal of the first stage, unit length, towards the microscope: what every summary refers to."""
        first = self.stages[0]
        for field in self.fields:
            if field.from_key == first.key:
                return field.normal_pmr
        return local_frame(first.points).normal_pmr


def _paths(folder, ending):
    found = [path for below in ((), ('*',), ('*', 'fields'))
             for path in glob.glob(os.path.join(glob.escape(folder), *below, '*' + ending))]
    return sorted(p for p in found if os.path.basename(os.path.dirname(p)) not in LEFT_ALONE)


def read_case(folder):
    """Read a case. Raises CaseError where there is no such folder, or it holds no stage."""
    if not os.path.isdir(folder):
        raise CaseError(f'{folder}: no such folder; give the folder of a case')
    stages, fields, unread, infos = [], {}, [], {}
    for path in _paths(folder, '.bag'):
        try:
            with rosbag.Bag(path) as bag:
                topics = set(bag.get_type_and_topic_info().topics)
                if '/stage/info' in topics and '/surface/points' in topics:
                    stages.append(_read_stage(bag, path, infos))
                elif '/shift/field' in topics:
                    for _, message, _ in bag.read_messages('/shift/field'):  # a recording may hold a pair twice
                        fields[message.from_key, message.to_key] = field_from_message(message)
        except (rosbag.ROSBagException, CaseError, OSError, ValueError, KeyError) as error:
            unread.append(f'{os.path.basename(path)}: {error}')
    if not stages:
        raise CaseError(f'{folder}: holds no stage; capture one, or give another folder'
                        + (f' (not readable: {"; ".join(unread)})' if unread else ''))
    stages.sort(key=lambda stage: stage.stamp)
    order = {stage.key: n for n, stage in enumerate(stages)}
    order.setdefault(MR_KEY, -1)
    fields = sorted(fields.values(), key=lambda f: (order.get(f.to_key, 99) - order.get(f.from_key, 99), order.get(f.from_key, 99)))
    point_folders = {os.path.dirname(path) for path in _paths(folder, FILE_NAME)}
    points = [point for place in sorted(point_folders) for point in read_points(place)]
    return Case(folder, stages, fields, points, infos, _read_calibrations(folder, unread), unread)


def _read_stage(bag, path, infos):
    messages = {}
    for topic, message, _ in bag.read_messages(['/stage/info', '/surface/points', '/stereo/left/camera_info',
                                                '/stereo/right/camera_info']):
        messages[topic] = message
    for side in ('left', 'right'):
        if f'/stereo/{side}/camera_info' in messages:
            infos.setdefault(side, messages[f'/stereo/{side}/camera_info'])
    return stage_from_messages(messages['/stage/info'], messages['/surface/points'], path)


def _read_calibrations(folder, unread):
    calibrations = {}
    for path in _paths(folder, '.yaml'):
        try:
            with open(path, encoding='utf-8') as file:
                content = yaml.safe_load(file)
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            unread.append(f'{os.path.basename(path)}: {error}')
            continue
        if isinstance(content, dict):
            calibrations[os.path.basename(path)] = content
    return calibrations


def immobile_misalignment(field, border=0.004):
    """Displacement of features that should not move, around the craniotomy: the paper's own quality check (section 3.2).

    The outermost valid points of the field, `border` [m] wide, are taken for the rim.
    Returns of the displacement there: median and 95th percentile of its length, length of its median vector (a misalignment
    of the tool tracking moves all of it alike) [m], and the number of points; NaN where there is none.
    """
    valid = field.valid
    filled = ndimage.binary_fill_holes(valid)
    distance = ndimage.distance_transform_edt(np.pad(filled, 1))[1:-1, 1:-1] * field.resolution
    rim = valid & (distance <= border)
    if not rim.any():
        return float('nan'), float('nan'), float('nan'), 0
    magnitude = np.linalg.norm(field.displacement[rim], axis=-1)
    common = np.linalg.norm(np.median(field.displacement[rim], axis=0))
    return float(np.median(magnitude)), float(np.percentile(magnitude, 95)), float(common), int(rim.sum())
