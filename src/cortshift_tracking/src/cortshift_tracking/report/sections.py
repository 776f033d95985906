"""The sections of the case report, as HTML."""
import os
import time

import numpy as np

from cortshift_tracking.mr.cross_section import SECTION_CONFIDENCE
from cortshift_tracking.report import figures
from cortshift_tracking.report.border import immobile_misalignment
from cortshift_tracking.report.page import picture, text
from cortshift_tracking.report.slice_figure import draw_slices
from cortshift_tracking.software import software_version

#: Words in the names of what is told of a calibration file.
CALIBRATION_WORDS = ('date', 'rms', 'error', 'residual', 'device', 'views')
MOST_OF_A_FILE = 16  # values that are told of one file


def head(case, title):
    moment = time.strftime('%Y-%m-%d %H:%M:%S', time.gmtime(case.stages[0].stamp))
    return (f'<h1>Cortical shift: {text(title)}</h1><p class="small">first stage {moment} UTC; {len(case.stages)} stages, '
            f'{len(case.fields)} fields, {len(case.points)} digitised points; cortshift {text(software_version())}; report of '
            f'{time.strftime("%Y-%m-%d %H:%M", time.gmtime())} UTC. Method: Ji et al., Med Image Anal 18(7):1169-1183, 2014. '
            'Research software, not for clinical use.</p>')


def calibration(case):
    rows = []
    for side, info in sorted(case.camera_infos.items()):
        baseline = -info.P[3] / info.P[0] if info.P[0] else 0.0
        rows.append([f'{side} camera, in the stages', f'{info.width} x {info.height} px, f {info.K[0]:.1f} / {info.K[4]:.1f} px, '
                     f'centre {info.K[2]:.1f}, {info.K[5]:.1f} px, distortion {", ".join(f"{d:.4g}" for d in info.D)}'
                     + (f', baseline {baseline * 1000:.2f} mm' if baseline else '')])
    for name, content in sorted(case.calibrations.items()):
        told = _told(content)
        rows.append([name, '; '.join(f'{key} {value}' for key, value in told) or 'holds no date or error'])
    if not rows:
        return ''
    return '<h2>Calibration</h2><table>' + ''.join(f'<tr><th>{text(a)}</th><td>{text(b)}</td></tr>' for a, b in rows) + '</table>'


def _told(content, prefix=''):
    """Dates and errors of a calibration file, whatever its structure."""
    told = []
    for key, value in content.items():
        name = f'{prefix}{key}'
        if isinstance(value, dict):
            told += _told(value, name + '.')
        elif any(word in str(key).lower() for word in CALIBRATION_WORDS) and isinstance(value, (str, int, float)) or hasattr(
                value, 'isoformat'):
            told.append((name, f'{value:.4g}' if isinstance(value, float) else value))
    return told[:MOST_OF_A_FILE]


def timeline(case):
    rows = ''.join(
        f'<tr><td>{text(s.key)}</td><td>{time.strftime("%H:%M:%S", time.gmtime(s.stamp))}</td>'
        f'<td class="n">{(s.stamp - case.stages[0].stamp) / 60:.1f}</td><td class="n">{100 * s.coverage:.0f}</td>'
        f'<td class="n">{int(np.isfinite(s.points).all(-1).sum())}</td>'
        f'<td class="n">{sum(p.stage == s.key for p in case.points)}</td><td>{text(s.note)}</td></tr>' for s in case.stages)
    return ('<h2>Stages</h2>' + picture(figures.timeline_figure(case.stages), 'timeline of the stages') +
            '<table><tr><th>stage</th><th>time (UTC)</th><th>min after the first</th><th>coverage / %</th><th>points</th>'
            f'<th>probe points</th><th>note</th></tr>{rows}</table>')


def slices(case, volume, why_none='No MR was given (--mr).'):
    """The surfaces in the preoperative MR, as it was admitted for them; None without one."""
    title = '<h2>Surfaces in the preoperative MR</h2>'
    if volume is None:
        return f'{title}<p>{text(why_none)}</p>'
    shown = draw_slices(volume, [(s.key, s.points[::2, ::2], s.confidence[::2, ::2]) for s in case.stages])
    return (f'{title}{picture(shown, "cross-sections of every stage on MR slices")}'
            f'<p class="small">{text(os.path.basename(volume.source))}: voxels {text(volume.orientation)}, '
            f'{" x ".join(f"{v * 1000:.3g}" for v in volume.spacing)} mm; pmr is {volume.axes}; slices through the middle of '
            f'the first surface, in radiological order. The MR is from before any shift: what lies above its cortex has '
            f'bulged, what lies below has sunk. A gap in a section: no surface, or one of a confidence below '
            f'{SECTION_CONFIDENCE:g}. Header: {text("; ".join(volume.notes))}.</p>')


def budget(field):
    """What the vectors of a pair may be off by, source by source; empty for a field of an earlier version."""
    summary = field.summary
    rows = ''.join(f'<tr><td>{text(share.source)}</td><td>{text(share.known_from)}</td><td class="n">{1000 * share.sd:.3f}</td></tr>'
                   for share in getattr(summary, 'budget', ()))
    if not rows:
        return ''
    told = ''.join(f'<p>{text(name)}: {text(value)}.</p>' for name, value in
                   (('Surround', summary.surround), ('Outline of the brain', summary.outline)) if value)
    return (f'{told}<table><tr><th>source of error</th><th>how known</th><th>at the centre of the brain / mm</th></tr>{rows}</table>'
            f'<p class="small">Root mean square lengths; what all vectors have in common: {1000 * summary.common_sd:.3f} mm.</p>')


def made_with(field):
    """Software, parameters and calibration of a field; the hashes in full stand in its bag."""
    told = ', '.join(f'{name} {text(value[:12] if name != "software" else value)}' for name, value in field.remarks.items()
                     if name != 'warnings')
    return f'<p class="small">Made with: {told}.</p>' if told else ''


def pair(case, field):
    """Pictures and alignment of one field."""
    name = f'{field.from_key} \u2192 {field.to_key}'
    heading = f'<h2 class="pair">{text(name)}{" (since the preoperative MR)" if field.from_mr else ""}</h2>'
    if not field.valid.any():
        return f'{heading}<p>No vector can be trusted.</p>'
    parts = [heading]
    line = '; white line: outline of the exposed brain' if field.brain else ''
    absent = case.absent_stages(field)
    if absent:
        parts.append(f'<p>No overlay: the case holds no readable stage {text(" and ".join(absent))}.</p>')
    else:
        first = figures.mr_vessels(field) if field.from_mr else figures.project_colour(case.stage(field.from_key), field)
        about = 'the MR (vessels drawn dark)' if field.from_mr else 'earlier'
        parts.append(picture(figures.overlay_figure(first, case.stage(field.to_key), field), f'overlays of {name}',
                             f'Overlay: red {about}, green later, yellow where they agree{line}'))
    maps = figures.component_figure(field, case.gravity_pmr, case.first_normal_pmr)
    parts.append(picture(maps, f'maps of {name}', f'Displacement{line}'))
    parts.append(picture(figures.vector_figure(field), f'vectors of {name}', 'Vectors on the earlier surface'))
    if field.from_mr:  # vessels tell where the brain went, but too coarsely for its strain
        parts.append(picture(figures.confidence_figure(field), f'confidence of {name}', 'Confidence'))
        return '\n'.join(parts)
    parts.append(budget(field))
    parts.append(made_with(field))
    parts.append(picture(figures.trust_figure(field), f'confidence and strain of {name}', 'Confidence and strain'))
    median, high, common, count = immobile_misalignment(field)
    parts.append(f'<p class="small">Alignment of what should not move: the border of the field (4 mm wide, {count} points) moves by '
                 f'{median * 1000:.2f} mm in the median, 95th percentile {high * 1000:.2f} mm; all of it in common by '
                 f'{common * 1000:.2f} mm, as an error of the tool tracking would do.</p>')
    return '\n'.join(parts)
