"""What a reader of the report must know before believing it."""
import math

from cortshift_tracking.report.border import immobile_misalignment

LOW_COVERAGE = 0.5          # of a field's overlap; less is warned of
RIM_WARNING = 0.0005        # median motion of what should not move [m]


def warnings_of(case, left_out, volume=None):
    """Texts; left_out: what else of the input could not be used, with the reason. volume: the MR, or None."""
    found = [f'left out: {reason}' for reason in [*case.left_out, *left_out]]
    if not case.calibrations:
        found.append('no calibration file in the case folder: dates and errors of the calibration are not known')
    found += [f'MR: {text}' for text in (volume.warnings if volume else ())]
    for stage in case.stages:
        if stage.T_pmr_left is None:
            found.append(f'stage {stage.key}: the pose of its camera is not known')
        found += [f"stage '{stage.key}': {warning}" for warning in stage.warnings]
    for field in case.fields:
        found += _of_field(case, field)
    if case.fields and case.gravity_pmr is None and not any(math.isfinite(f.summary.gravity_mean) for f in case.fields):
        found.append('gravity is not known: digitise two positions with the probe')
    return found


def _of_field(case, field):
    name = f'{field.from_key} → {field.to_key}'
    of_stages = {f"stage '{stage.key}': {warning}" for stage in case.stages for warning in stage.warnings}
    found = [f'{name}: {warning}' for warning in field.summary.warnings if warning not in of_stages]
    absent = case.absent_stages(field)
    if absent:
        found.append(f'{name}: the case holds no readable stage {" and ".join(absent)}: no overlay of the two and no comparison with the '
                     'probe')
    if field.summary.overlap < LOW_COVERAGE:
        found.append(f'{name}: the later stage covers only {field.summary.overlap:.0%} of the earlier one')
    shown = field.valid.mean()
    if shown < 0.3:
        found.append(f'{name}: only {shown:.0%} of the plane carries a trusted vector')
    if not field.from_mr:  # its border lies on the brain
        median, high, common, count = immobile_misalignment(field)
        if median > RIM_WARNING:
            found.append(f'{name}: the border of the field, where immobile features are expected, moves by {median * 1000:.2f} mm '
                         f'(median of {count} points, 95th percentile {high * 1000:.2f} mm, in common {common * 1000:.2f} mm): check '
                         'tool tracking and patient registration, or whether the border lies on the brain')
    return found
