"""Surfaces and fields against the tracked probe (paper 2.7.1)."""
from dataclasses import dataclass

import numpy as np

from cortshift_tracking.errors import CaseError
from cortshift_tracking.geometry import normals

SURFACE_REACH = 0.02  # a digitised point further than this from the surface does not belong to it [m]


@dataclass(frozen=True)
class PointAccuracy:
    """One digitised point against its stage's surface, lengths [m].

    to_surface: distance from the surface, positive outside. to_homologous: from the picked point; NaN without a pick.
    on_surface (3,): the picked point, else the nearest surface point, in pmr.
    """
    stage: str
    label: str
    to_surface: float
    to_homologous: float
    on_surface: np.ndarray


@dataclass(frozen=True)
class PairRow:
    """Probe-based and flow-based displacement of one point common to two stages; vectors (3,) in pmr [m].

    flow is None where the field says nothing at the point. difference: probe minus flow, components along the microscope's
    axis and its two perpendiculars (image columns, image rows) of the earlier stage; NaN where its pose is not known.
    """
    from_key: str
    to_key: str
    label: str
    accuracy_from: PointAccuracy
    accuracy_to: PointAccuracy
    probe: np.ndarray
    flow: np.ndarray
    difference: np.ndarray


def surface_accuracy(stage, points, picks=None, left_out=None):
    """PointAccuracy of the probe points of one stage.

    left_out: list that takes the reason for each point that cannot be used; without it the first one raises CaseError.
    """
    picks = picks or {}
    mine = [point for point in points if point.stage == stage.key]
    if not mine:
        return []
    usable = np.isfinite(stage.points).all(-1)
    across = normals(stage.points, 2)
    vertices, directions = stage.points[usable], across[usable]
    rows = []
    for point in mine:
        try:
            rows.append(_accuracy(stage, vertices, directions, point, picks.get((stage.key, point.label))))
        except CaseError as error:
            if left_out is None:
                raise
            left_out.append(str(error))
    return rows


def _accuracy(stage, vertices, directions, point, pick):
    nearest = ((vertices - point.position) ** 2).sum(-1).argmin()
    gap = point.position - vertices[nearest]
    if np.linalg.norm(gap) > SURFACE_REACH:
        raise CaseError(f'point {point.name} is {np.linalg.norm(gap) * 1000:.0f} mm from the surface; it belongs to another '
                        'stage or was digitised in the air: delete it')
    normal = directions[nearest]
    height = float(gap @ normal) if np.isfinite(normal).all() else float(np.linalg.norm(gap))
    on_surface, to_homologous = point.position - height * (normal if np.isfinite(normal).all() else 0), float('nan')
    if pick is not None:
        on_surface = _surface_at(stage, point.label, *pick)
        to_homologous = float(np.linalg.norm(point.position - on_surface))
    return PointAccuracy(stage.key, point.label, height, to_homologous, on_surface)


def _surface_at(stage, label, column, row):
    """Surface point (3,) behind an image position, linear between pixels."""
    height, width = stage.points.shape[:2]
    c, r = int(np.floor(column)), int(np.floor(row))
    if 0 <= c < width - 1 and 0 <= r < height - 1:
        quad = stage.points[r:r + 2, c:c + 2]
        if np.isfinite(quad).all():
            a, b = column - c, row - r
            return (1 - b) * ((1 - a) * quad[0, 0] + a * quad[0, 1]) + b * ((1 - a) * quad[1, 0] + a * quad[1, 1])
    raise CaseError(f'stage "{stage.key}" has no surface at column {column:g}, row {row:g}, where "{label}" was picked; pick a point '
                    'on the surface')


def compare_pair(field, earlier, accuracy_earlier, accuracy_later, points):
    """PairRow for every label digitised at both stages, in the order of the earlier stage.

    accuracy_*: of surface_accuracy for the two stages of the field.
    """
    first = {a.label: a for a in accuracy_earlier}
    second = {a.label: a for a in accuracy_later}
    position = {(p.stage, p.label): p.position for p in points}
    rows = []
    for label in first:
        if label not in second:
            continue
        probe = position[field.to_key, label] - position[field.from_key, label]
        flow = field.at(first[label].on_surface)
        difference = np.full(3, np.nan)
        if flow is not None and earlier.T_pmr_left is not None:
            camera = (probe - flow) @ earlier.T_pmr_left[:3, :3]
            difference = camera[[2, 0, 1]]
        rows.append(PairRow(field.from_key, field.to_key, label, first[label], second[label], probe, flow, difference))
    return rows
