"""Digitised points of a case: one JSON file in its folder, written so that it is whole or not there."""
import json
import math
import os
from dataclasses import replace

from cortshift_tracking.durable import write_durably
from cortshift_tracking.errors import CaseError, ProbeError
from cortshift_tracking.probe.points import GRAVITY_LABELS, ProbePoint

FILE_NAME = 'probe_points.json'
FORMAT = 'cortshift probe points, version 1'


def read_points(folder):
    """Points of a case folder in the order they were taken; empty where none was taken.

    Raises CaseError naming the file where it is damaged or of another format.
    """
    path = os.path.join(folder, FILE_NAME)
    if not os.path.exists(path):
        return []
    try:
        with open(path, encoding='utf-8') as file:
            content = json.load(file)
        if content['format'] != FORMAT or content['unit'] != 'm' or content['frame'] != 'pmr':
            raise ValueError(f'format "{content["format"]}", unit "{content["unit"]}", frame "{content["frame"]}"')
        return [_from_json(entry) for entry in content['points']]
    except (OSError, ValueError, KeyError, TypeError, OverflowError) as error:   # the last: infinity is no whole number
        raise CaseError(f'{path}: not a whole file of probe points ({error!r}); restore it from a copy or move it away') from error


def _from_json(entry):
    position = tuple(float(v) for v in entry['position'])
    stamp = int(entry['stamp'][0]), int(entry['stamp'][1])
    if len(position) != 3 or not all(map(math.isfinite, position)):
        raise ValueError(f'position {position}')
    if not (0 <= stamp[0] < 2 ** 32 and 0 <= stamp[1] < 10 ** 9):
        raise ValueError(f'stamp {stamp}')
    return ProbePoint(str(entry['stage']), str(entry['label']), stamp, position, float(entry['spread']), int(entry['samples']))


def write_points(folder, points):
    """Replace the points of a case folder. Raises OSError with the old file untouched."""
    content = {'format': FORMAT, 'unit': 'm', 'frame': 'pmr',
               'points': [{'stage': p.stage, 'label': p.label, 'stamp': list(p.stamp), 'position': list(p.position_pmr),
                           'spread': p.spread, 'samples': p.samples} for p in points]}
    write_durably(os.path.join(folder, FILE_NAME), json.dumps(content, indent=1) + '\n')


class ProbeStore:
    """The points of one case. What add and delete acknowledge is on the disk."""

    def __init__(self, folder):
        """Loads the folder's points. A damaged file is set aside, never overwritten; `set_aside` then names it."""
        self.folder = folder
        self.set_aside = None
        os.makedirs(folder, exist_ok=True)
        try:
            self._points = read_points(folder)
        except CaseError as error:
            path = os.path.join(folder, FILE_NAME)
            number = 1
            while os.path.exists(f'{path}.damaged-{number}'):
                number += 1
            os.rename(path, f'{path}.damaged-{number}')
            self.set_aside = f'{error}; set aside as {FILE_NAME}.damaged-{number}'
            self._points = []

    @property
    def points(self):
        return list(self._points)

    def find(self, stage, label):
        return next((p for p in self._points if (p.stage, p.label) == (stage, label)), None)

    def add(self, point):
        """Raises ProbeError for a point that exists, OSError where it cannot be written."""
        if self.find(point.stage, point.label):
            raise ProbeError(f'point {point.name} exists already; delete it first or take another label')
        self._replace(self._points + [replace(point)])

    def delete(self, stage, label):
        """Raises ProbeError naming the points there are, OSError where the file cannot be written."""
        if not self.find(stage, label):
            there = ', '.join(f'{p.stage}/{p.label}' for p in self._points) or 'none'
            raise ProbeError(f'no point "{label}" of stage "{stage}"; there are: {there}')
        self._replace([p for p in self._points if (p.stage, p.label) != (stage, label)])

    def gravity_pair(self):
        """(upper, lower) positions in pmr [m], each None until taken."""
        pair = [self.find('', GRAVITY_LABELS[name]) for name in ('upper', 'lower')]
        return tuple(None if point is None else point.position for point in pair)

    def _replace(self, points):
        write_points(self.folder, points)
        self._points = points
