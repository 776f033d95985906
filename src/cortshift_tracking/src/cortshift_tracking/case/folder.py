"""A case on disk: stages, displacement fields, probe points, calibration; read without a master.

A stage is a bag with /stage/info and /surface/points, a field one with /shift/field, wherever they lie in the folder, one
below it or in the `fields` of one below it (`set_aside` and `deleted` are left alone). One bad file never stops the rest: it is
left out and named.
"""
import glob
import os
from dataclasses import dataclass
from typing import List

import numpy as np

from cortshift_tracking.case.bag_reading import open_bag
from cortshift_tracking.case.messages import MR_KEY, Field, Stage, field_from_message, stage_from_messages
from cortshift_tracking.errors import CaseError, ProbeError
from cortshift_tracking.geometry import LEAST_POINTS, local_frame
from cortshift_tracking.probe.points import GRAVITY_LABELS, gravity_direction
from cortshift_tracking.probe.store import FILE_NAME, read_points
from cortshift_tracking.texts import read_yaml

LEFT_ALONE = ('set_aside', 'deleted')
SAME_STAMP = 1e-5  # stamps that differ by less are of one exposure [s]; a stamp in a double is good to 1e-6


@dataclass(frozen=True)
class Case:
    """Stages in order of their exposure; fields with the pairs of consecutive stages first; left_out: what, and why."""
    folder: str
    stages: List[Stage]
    fields: List[Field]
    points: list
    camera_infos: dict      # 'left', 'right': sensor_msgs/CameraInfo of the first stage that has them
    calibrations: dict      # file name: content of the YAML calibration files in the folder
    left_out: List[str]

    def stage(self, key):
        for stage in self.stages:
            if stage.key == key:
                return stage
        raise CaseError(f'{self.folder}: no stage "{key}"; there are: {", ".join(s.key for s in self.stages) or "none"}')

    def absent_stages(self, field):
        """Keys of the stages of a field that the case does not hold; the preoperative MR is none."""
        keys = {stage.key for stage in self.stages} | {MR_KEY}
        return [key for key in (field.from_key, field.to_key) if key not in keys]

    def field(self, from_key, to_key):
        for field in self.fields:
            if (field.from_key, field.to_key) == (from_key, to_key):
                return field
        there = ', '.join(f'{f.from_key} -> {f.to_key}' for f in self.fields) or 'none'
        raise CaseError(f'{self.folder}: no field {from_key} -> {to_key}; there are: {there}')

    @property
    def gravity_pmr(self):
        """Unit vector of gravity from the probe's two positions, or None."""
        return gravity_of(self.points)

    @property
    def first_normal_pmr(self):
        """Average normal of the first stage, unit length, towards the microscope: what every summary refers to."""
        first = self.stages[0]
        for field in self.fields:
            if field.from_key == first.key:
                return field.normal_pmr
        return local_frame(first.points).normal_pmr


def read_case(folder):
    """Read a case. Raises CaseError where there is no such folder, or it holds no stage."""
    if not os.path.isdir(folder):
        raise CaseError(f'{folder}: no such folder; give the folder of a case')
    found = _Found(folder)
    for path in found.paths('.bag'):
        found.take(found.read_bag, path)
    for path in found.paths(FILE_NAME):
        found.take(found.read_points, path)
    for path in found.paths('.yaml'):
        found.take(found.read_calibration, path)
    if not found.stages:
        raise CaseError(f'{folder}: holds no stage; capture one, or give another folder'
                        + (f' (left out: {"; ".join(found.left_out)})' if found.left_out else ''))
    return found.case()


def read_stage(folder, key):
    """One stage of a case, without reading the others. Raises CaseError where it is not there, or cannot be read."""
    found = _Found(folder)
    for path in found.paths('.bag'):
        found.take(lambda path: found.read_bag(path, key), path)
    if key not in found.stages:
        raise CaseError(f'{folder}: no stage "{key}" can be read' + (f' (left out: {"; ".join(found.left_out)})' if found.left_out else ''))
    return found.stages[key]


class _Found:
    """What was read of a folder so far."""

    def __init__(self, folder):
        self.folder, self.stages, self.fields, self.points = folder, {}, {}, []
        self.camera_infos, self.calibrations, self.left_out = {}, {}, []

    def paths(self, ending):
        found = [path for below in ((), ('*',), ('*', 'fields'))
                 for path in glob.glob(os.path.join(glob.escape(self.folder), *below, '*' + ending))]
        return sorted(p for p in found if os.path.basename(os.path.dirname(p)) not in LEFT_ALONE)

    def leave_out(self, path, reason):
        self.left_out.append(f'{os.path.relpath(path, self.folder)}: {reason}')

    def take(self, read, path):
        try:
            read(path)
        except CaseError as error:
            self.leave_out(path, str(error).replace(f'{path}: ', '', 1))

    def read_bag(self, path, only=None):
        """only: the key of the one stage to read, and no field."""
        with open_bag(path) as bag:
            topics = bag.get_type_and_topic_info().topics
            if only is not None and only not in [message.key for _, message, _ in bag.read_messages('/stage/info')]:
                return
            if '/stage/info' in topics and '/surface/points' in topics:
                self._add_stage({topic: message for topic, message, _ in bag.read_messages(
                    ['/stage/info', '/surface/points', '/stereo/left/camera_info', '/stereo/right/camera_info'])}, path)
            elif '/shift/field' in topics:
                self._add_fields(bag, path)

    def _add_stage(self, messages, path):
        stage = stage_from_messages(messages['/stage/info'], messages['/surface/points'], path, messages.get('/stereo/left/camera_info'))
        count = int(np.isfinite(stage.points).all(-1).sum())
        if count < LEAST_POINTS:
            raise CaseError(f'the surface of stage "{stage.key}" has only {count} points; capture it again')
        earlier = self.stages.setdefault(stage.key, stage)
        if abs(earlier.stamp - stage.stamp) > SAME_STAMP:
            raise CaseError(f'another stage "{stage.key}" is in {os.path.relpath(earlier.path, self.folder)}; one key, one stage: '
                            'move one of them away')
        for side in ('left', 'right'):
            if f'/stereo/{side}/camera_info' in messages:
                self.camera_infos.setdefault(side, messages[f'/stereo/{side}/camera_info'])

    def _add_fields(self, bag, path):
        live = 0
        for _, message, _ in bag.read_messages('/shift/field'):  # a recording may hold a pair twice: the last one counts
            if message.to_key:
                self.fields[message.from_key, message.to_key] = path, field_from_message(message)
            else:
                live += 1
        if live:
            self.leave_out(path, f'{live} field{"s" if live > 1 else ""} of the live mode: no later stage was captured with '
                           f'{"them" if live > 1 else "it"}')

    def read_points(self, path):
        self.points += read_points(os.path.dirname(path))

    def read_calibration(self, path):
        content = read_yaml(path)
        if isinstance(content, dict):
            self.calibrations[os.path.basename(path)] = content

    def case(self):
        stages = sorted(self.stages.values(), key=lambda stage: stage.stamp)
        order = {stage.key: n for n, stage in enumerate(stages)}
        order.setdefault(MR_KEY, -1)
        fields = []
        for path, field in self.fields.values():
            wrong = [key for key, stamp in ((field.from_key, field.from_stamp), (field.to_key, field.to_stamp))
                     if key in self.stages and abs(self.stages[key].stamp - stamp) > SAME_STAMP]
            if wrong:
                self.leave_out(path, f'the field {field.from_key} -> {field.to_key} is of another capture of "{wrong[0]}" than the '
                               'stage in this folder; compute it again')
            else:
                fields.append(field)
        fields.sort(key=lambda f: (order.get(f.to_key, 99) - order.get(f.from_key, 99), order.get(f.from_key, 99)))
        self._check_gravity()
        return Case(self.folder, stages, fields, self.points, self.camera_infos, self.calibrations, self.left_out)


    def _check_gravity(self):
        try:
            gravity_of(self.points)
        except ProbeError as error:
            self.left_out.append(f'{FILE_NAME}: gravity: {error}')
            self.points = [point for point in self.points if point.stage]


def gravity_of(points):
    """Unit vector of gravity in pmr from the probe's two positions, or None. Raises ProbeError where they make none."""
    pair = {point.label: point.position for point in points if not point.stage}
    if not set(GRAVITY_LABELS.values()) <= set(pair):
        return None
    return gravity_direction(pair[GRAVITY_LABELS['upper']], pair[GRAVITY_LABELS['lower']])
