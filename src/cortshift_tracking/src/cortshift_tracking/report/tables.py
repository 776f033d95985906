"""Tables 2 and 3 of the paper (sections 2.7.1 and 2.7.2): a header with units, and rows of text and numbers (NaN: not known)."""
import csv
import io

import numpy as np

from cortshift_tracking.report.validation import compare_pair, surface_accuracy
from cortshift_tracking.summary_text import brain_of

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
    'lateral_mean_mm', 'lateral_sd_mm', 'angle_deg', 'compute_s', 'overlap_percent', 'points', 'warnings',
    'brain_d_mean_mm', 'brain_d_sd_mm', 'brain_gravity_mean_mm', 'brain_gravity_sd_mm', 'brain_normal_mean_mm',
    'brain_normal_sd_mm', 'brain_lateral_mean_mm', 'brain_lateral_sd_mm', 'common_sd_mm', 'surround']

#: The columns of Table 3 that hold words.
TABLE_3_WORDS = ('pair', 'warnings', 'surround')


def _mean_sd_mm(lengths):
    """Mean and sample standard deviation [mm] of lengths [m]; NaN for what too few values give."""
    values = np.asarray([v for v in lengths if np.isfinite(v)], float) * 1000
    mean = float(values.mean()) if len(values) else float('nan')
    return [mean, float(values.std(ddof=1)) if len(values) > 1 else float('nan')]


def table_2(case, picks=None, left_out=None):
    """One row per field of the case whose stages share digitised points; left_out: as for surface_accuracy. Accuracy: to the homologous point; distance: to
    the surface itself, unsigned. Difference: length of probe minus flow, then the means of its absolute components."""
    rows = []
    accuracy = {stage.key: surface_accuracy(stage, case.points, picks, left_out) for stage in case.stages}
    for field in case.fields:
        if field.from_mr or case.absent_stages(field):
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
        brain = [brain_of(s, name) for name in ('magnitude', 'gravity', 'normal', 'lateral')]
        minutes = float('nan') if field.from_mr else (field.to_stamp - field.from_stamp) / 60
        rows.append([f'{field.from_key} -> {field.to_key}', minutes] + [1000 * v for pair in pairs for v in pair] +
                    [np.degrees(angle), s.compute_time, 100 * s.overlap, int(s.valid_points), ' | '.join(s.warnings)] +
                    [1000 * v for pair in brain for v in pair] + [1000 * (getattr(s, 'common_sd', 0) or float('nan')),
                                                                 getattr(s, 'surround', '')])
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
