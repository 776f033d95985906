"""Validation against the tracked probe, and the tables of the paper (sections 2.7.1 and 2.7.2, Tables 2 and 3)."""
import csv
import io
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


def read_picks(path):
    """Image positions of labels: {(stage, label): (column, row)} in pixels of the rectified left image.

    CSV with the header stage,label,column_px,row_px. Raises CaseError naming file and line.
    """
    picks = {}
    try:
        with open(path, newline='', encoding='utf-8') as file:
            for number, row in enumerate(csv.DictReader(file), start=2):
                try:
                    picks[row['stage'], row['label']] = float(row['column_px']), float(row['row_px'])
                except (KeyError, TypeError, ValueError) as error:
                    raise CaseError(f'{path}, line {number}: not stage,label,column_px,row_px ({error!r})') from error
    except OSError as error:
        raise CaseError(f'{path}: not readable ({error})') from error
    return picks


def surface_accuracy(stage, points, picks=None):
    """PointAccuracy of the probe points of one stage. Raises CaseError for a pick outside the surface."""
    picks = picks or {}
    mine = [point for point in points if point.stage == stage.key]
    if not mine:
        return []
    usable = np.isfinite(stage.points).all(-1)
    across = normals(stage.points, 2)
    vertices, directions = stage.points[usable], across[usable]
    rows = []
    for point in mine:
        nearest = ((vertices - point.position) ** 2).sum(-1).argmin()
        gap = point.position - vertices[nearest]
        if np.linalg.norm(gap) > SURFACE_REACH:
            raise CaseError(f'point {point.name} is {np.linalg.norm(gap) * 1000:.0f} mm from the surface; it belongs to another '
                            'stage or was digitised in the air: delete it')
        normal = directions[nearest]
        height = float(gap @ normal) if np.isfinite(normal).all() else float(np.linalg.norm(gap))
        on_surface, to_homologous = point.position - height * (normal if np.isfinite(normal).all() else 0), float('nan')
        if (stage.key, point.label) in picks:
            on_surface = _surface_at(stage, *picks[stage.key, point.label])
            to_homologous = float(np.linalg.norm(point.position - on_surface))
        rows.append(PointAccuracy(stage.key, point.label, height, to_homologous, on_surface))
    return rows


def _surface_at(stage, column, row):
    """Surface point (3,) behind an image position, linear between pixels."""
    height, width = stage.points.shape[:2]
    c, r = int(np.floor(column)), int(np.floor(row))
    if 0 <= c < width - 1 and 0 <= r < height - 1:
        quad = stage.points[r:r + 2, c:c + 2]
        if np.isfinite(quad).all():
            a, b = column - c, row - r
            return (1 - b) * ((1 - a) * quad[0, 0] + a * quad[0, 1]) + b * ((1 - a) * quad[1, 0] + a * quad[1, 1])
    raise CaseError(f'stage "{stage.key}" has no surface at column {column:g}, row {row:g}; pick a point on the surface')


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


# ---- tables: header with units, rows of text and numbers (NaN: not known)

TABLE_2_HEADER = [
    'pair', 'points', 'points_with_flow',
    'surface_1_accuracy_mean_mm', 'surface_1_accuracy_sd_mm', 'surface_2_accuracy_mean_mm', 'surface_2_accuracy_sd_mm',
    'surface_1_distance_mean_mm', 'surface_1_distance_sd_mm', 'surface_2_distance_mean_mm', 'surface_2_distance_sd_mm',
    'probe_1_accuracy_mean_mm', 'probe_1_accuracy_sd_mm', 'probe_2_accuracy_mean_mm', 'probe_2_accuracy_sd_mm',
    'probe_displacement_mean_mm', 'probe_displacement_sd_mm', 'flow_displacement_mean_mm', 'flow_displacement_sd_mm',
    'difference_mean_mm', 'difference_sd_mm', 'difference_axis_mm', 'difference_across_1_mm', 'difference_across_2_mm',
    'magnitude_difference_mean_mm', 'magnitude_difference_sd_mm']

TABLE_3_HEADER = [
    'pair', 'separation_min', 'd_mean_mm', 'd_sd_mm', 'gravity_mean_mm', 'gravity_sd_mm', 'normal_mean_mm', 'normal_sd_mm',
    'lateral_mean_mm', 'lateral_sd_mm', 'angle_deg', 'compute_s', 'overlap_percent', 'points']


def _mean_sd_mm(lengths):
    """Mean and sample standard deviation [mm] of lengths [m]; NaN for what too few values give."""
    values = np.asarray([v for v in lengths if np.isfinite(v)], float) * 1000
    mean = float(values.mean()) if len(values) else float('nan')
    return [mean, float(values.std(ddof=1)) if len(values) > 1 else float('nan')]


def table_2(case, picks=None):
    """One row per field of the case whose stages share digitised points. Accuracy: to the homologous point; distance: to
    the surface itself, unsigned. Difference: length of probe minus flow, then the means of its absolute components."""
    rows = []
    accuracy = {stage.key: surface_accuracy(stage, case.points, picks) for stage in case.stages}
    for field in case.fields:
        if field.from_key not in accuracy:  # the preoperative MR
            continue
        accuracies = [accuracy[case.stage(key).key] for key in (field.from_key, field.to_key)]
        pairs = compare_pair(field, case.stage(field.from_key), *accuracies, case.points)
        if not pairs:
            continue
        row = [f'{field.from_key} -> {field.to_key}', len(pairs), sum(p.flow is not None for p in pairs)]
        for stage_accuracy in accuracies:
            row += _mean_sd_mm([a.to_homologous for a in stage_accuracy])
        for stage_accuracy in accuracies:
            row += _mean_sd_mm([abs(a.to_surface) for a in stage_accuracy])
        for chosen in ([p.accuracy_from for p in pairs], [p.accuracy_to for p in pairs]):
            row += _mean_sd_mm([a.to_homologous if np.isfinite(a.to_homologous) else abs(a.to_surface) for a in chosen])
        both = [p for p in pairs if p.flow is not None]
        row += _mean_sd_mm([np.linalg.norm(p.probe) for p in pairs])
        row += _mean_sd_mm([np.linalg.norm(p.flow) for p in both])
        row += _mean_sd_mm([np.linalg.norm(p.probe - p.flow) for p in both])
        row += [_mean_sd_mm([abs(p.difference[n]) for p in both])[0] for n in range(3)]
        row += _mean_sd_mm([abs(np.linalg.norm(p.probe) - np.linalg.norm(p.flow)) for p in both])
        rows.append(row)
    return rows


def table_3(case):
    """One row per field of the case, from its summary; gravity from the probe where the summary does not know it."""
    gravity = case.gravity_pmr
    rows = []
    for field in case.fields:
        s = field.summary
        pairs = [(s.magnitude_mean, s.magnitude_sd), (s.gravity_mean, s.gravity_sd), (s.normal_mean, s.normal_sd),
                 (s.lateral_mean, s.lateral_sd)]
        angle = s.gravity_normal_angle
        if not np.isfinite(s.gravity_mean) and gravity is not None and field.valid.any():
            along = field.displacement[field.valid] @ gravity
            pairs[1] = float(along.mean()), float(along.std(ddof=1))
            angle = float(np.arccos(np.clip(case.first_normal_pmr @ gravity, -1, 1)))
        minutes = float('nan') if field.from_mr else (field.to_stamp - field.from_stamp) / 60
        rows.append([f'{field.from_key} -> {field.to_key}', minutes] + [1000 * v for pair in pairs for v in pair] +
                    [np.degrees(angle), s.compute_time, 100 * s.overlap, int(s.valid_points)])
    return rows


def to_csv(header, rows):
    """CSV text; numbers with 4 decimals, unknown ones empty."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator='\n')
    writer.writerow(header)
    for row in rows:
        writer.writerow(['' if isinstance(v, float) and not np.isfinite(v) else
                         f'{v:.4f}' if isinstance(v, (float, np.floating)) else v for v in row])
    return out.getvalue()
