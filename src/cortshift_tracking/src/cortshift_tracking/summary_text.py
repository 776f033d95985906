"""A ShiftSummary in words for a person, the same in console, tools and report."""


def in_mm(mean, sd):
    """Mean and standard deviation [m] as text."""
    return f'{1000 * mean:.2f} ± {1000 * sd:.2f} mm'


def brain_of(summary, name):
    """(mean, sd) [m] of magnitude, gravity, normal or lateral over the brain alone; NaN where its outline is not known.

    Fields of earlier versions do not have it.
    """
    if not getattr(summary, 'brain_points', 0):
        return float('nan'), float('nan')
    return getattr(summary, f'brain_{name}_mean'), getattr(summary, f'brain_{name}_sd')


def summary_lines(summary):
    """The numbers of a ShiftSummary as (name, text); what is not known is left out, and no warning is."""
    lines = [('magnitude', in_mm(summary.magnitude_mean, summary.magnitude_sd)),
             ('along gravity', in_mm(summary.gravity_mean, summary.gravity_sd)),
             ('along the normal', in_mm(summary.normal_mean, summary.normal_sd)),
             ('lateral', in_mm(summary.lateral_mean, summary.lateral_sd)),
             ('overlap', f'{100 * summary.overlap:.0f} %'),
             ('brain alone', in_mm(*brain_of(summary, 'magnitude')))]
    if getattr(summary, 'common_sd', 0) > 0:
        lines.append(('all vectors may be off by', f'{1000 * summary.common_sd:.2f} mm'))
    if getattr(summary, 'latency', 0) > 0:
        lines.append(('after the exposure by', f'{summary.latency:.2f} s'))
    if getattr(summary, 'surround', ''):
        lines.append(('surround', summary.surround))
    return [(name, text) for name, text in lines if 'nan' not in text.split()] + [('WARNING', text) for text in summary.warnings]
