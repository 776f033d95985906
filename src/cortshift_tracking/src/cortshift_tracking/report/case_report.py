"""The report of a case: one HTML file with everything in it, tables as CSV beside it, and the same as PDF."""
import html
import math
import os
import re
import shutil
import subprocess
import tempfile
import time
import xml.etree.ElementTree as ElementTree

import numpy as np
import rospkg

from cortshift_tracking.report import figures
from cortshift_tracking.case.folder import immobile_misalignment, read_case
from cortshift_tracking.mr.cross_section import SECTION_CONFIDENCE
from cortshift_tracking.durable import write_durably
from cortshift_tracking.errors import CaseError
from cortshift_tracking.mr.reader import load_volume
from cortshift_tracking.report.slice_figure import draw_slices
from cortshift_tracking.report.validation import TABLE_2_HEADER, TABLE_3_HEADER, read_picks, table_2, table_3, to_csv

LOW_COVERAGE = 0.5          # of a field's overlap; less is warned of
RIM_WARNING = 0.0005        # median motion of what should not move [m]
PICKS = 'picks.csv'

STYLE = '''
body { font: 15px/1.45 "DejaVu Sans", Arial, sans-serif; color: #1c1c1c; max-width: 1200px; margin: 24px auto; padding: 0 20px; }
h1 { font-size: 26px; margin-bottom: 4px; } h2 { font-size: 20px; border-bottom: 1px solid #bbb; margin-top: 34px; }
h3 { font-size: 16px; } img { max-width: 100%; display: block; }
table { border-collapse: collapse; margin: 10px 0; font-size: 13px; } td, th { border: 1px solid #c9c9c9; padding: 4px 8px; }
tr { page-break-inside: avoid; } th { background: #f1f1f1; text-align: left; } td.n { text-align: right; white-space: nowrap; }
.warning { background: #fff4d6; border-left: 5px solid #d89b00; padding: 8px 14px; margin: 12px 0; }
.small { color: #555; font-size: 13px; } figure { margin: 12px 0; page-break-inside: avoid; } figcaption { font-weight: bold; font-size: 16px; margin: 14px 0 6px; }
@page { size: A4; margin: 12mm; } @media print { body { max-width: none; margin: 0; font-size: 11px; } table { font-size: 8.5px; }
 table, h1, h2 { page-break-inside: avoid; } td, th { padding: 2px 3px; } h2, h3 { page-break-after: avoid; }
 h2.pair { page-break-before: always; } img { max-height: 118mm; margin: 0 auto; } figcaption { font-size: 12px; } }
'''


def software_version():
    """Version in this package's manifest, with git's description of the source tree where there is one."""
    folder = rospkg.RosPack().get_path('cortshift_tracking')
    version = ElementTree.parse(os.path.join(folder, 'package.xml')).findtext('version').strip()
    try:
        commit = subprocess.run(['git', '-C', folder, 'describe', '--always', '--dirty'], stdout=subprocess.PIPE,
                                stderr=subprocess.DEVNULL, universal_newlines=True, check=False).stdout.strip()
    except OSError:
        commit = ''
    return f'{version} ({commit})' if commit else version


def make_report(folder, mr=None, axes='RAS', title=None):
    """HTML text and {file name: CSV text} of a case folder.

    mr: path of the preoperative MR, or None. axes: what pmr's axes point to.
    Raises CaseError or VolumeError naming what is missing or damaged.
    """
    case = read_case(folder)
    picks_path = os.path.join(folder, PICKS)
    picks = read_picks(picks_path) if os.path.exists(picks_path) else {}
    second, third = table_2(case, picks), table_3(case)
    warnings = _warnings(case)
    sections = [_head(case, title or os.path.basename(os.path.abspath(folder))), _warning_box(warnings), _calibration(case),
                _timeline(case), _table('Displacement between stages (Table 3 of the paper)', TABLE_3_HEADER, third,
                                        'Mean and standard deviation over all trusted points. Gravity: positive with it. Normal: of '
                                        'the first stage, positive bulging. Lateral: across that normal. Angle: from gravity to the normal. pmr: the '
                                        'brain of the preoperative MR. The points include what lies around the craniotomy. Empty: not '
                                        'known.')]
    if second:
        sections.append(_table('Probe against surface and field (Table 2 of the paper)', TABLE_2_HEADER, second,
                               'Accuracy: digitised point to its homologous point on the surface (needs picks.csv). Distance: to '
                               'the surface itself. Surface 1, 2: all points digitised at the earlier and at the later stage; '
                               'probe 1, 2: those that both stages share. Difference: probe minus flow; axis: the microscope\'s optical axis at the '
                               'earlier stage; across: its two perpendiculars, mean absolute components.', transpose=True))
    else:
        sections.append('<h2>Probe against surface and field</h2><p>No label was digitised at both stages of a pair.</p>')
    if mr is not None:
        volume = load_volume(mr, axes)
        picture = draw_slices(volume, [(stage.key, stage.points[::2, ::2], stage.confidence[::2, ::2])
                                       for stage in case.stages])
        sections.append(f'<h2>Surfaces in the preoperative MR</h2>{_picture(picture, "cross-sections of every stage on MR slices")}'
                        f'<p class="small">{_text(os.path.basename(mr))}: voxels {_text(volume.orientation)}, '
                        f'{" x ".join(f"{v * 1000:.3g}" for v in volume.spacing)} mm; pmr is {axes}; slices through the middle of '
                        f'the first surface, in radiological order. The MR is from before any shift: what lies above its cortex has '
                        f'bulged, what lies below has sunk. A gap in a section: no surface, or one of a confidence below '
                        f'{SECTION_CONFIDENCE:g}. Header: {_text("; ".join(volume.notes))}.</p>')
    else:
        sections.append('<h2>Surfaces in the preoperative MR</h2><p>No MR was given (--mr).</p>')
    sections += [_pair(case, field) for field in case.fields]
    if not case.fields:
        sections.append('<h2>Fields</h2><p>No displacement field was computed.</p>')
    page = (f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>cortshift: {_text(title or folder)}</title>'
            f'<style>{STYLE}</style></head><body>\n' + '\n'.join(sections) + '\n</body></html>\n')
    return page, {'table_2.csv': to_csv(TABLE_2_HEADER, second), 'table_3.csv': to_csv(TABLE_3_HEADER, third)}


def _text(value):
    return html.escape(str(value))


def _picture(figure, description, caption=''):
    above = f'<figcaption>{_text(caption)}</figcaption>' if caption else ''
    return f'<figure>{above}<img src="{figures.to_data_uri(figure)}" alt="{_text(description)}"></figure>'


def _head(case, title):
    moment = time.strftime('%Y-%m-%d %H:%M:%S', time.gmtime(case.stages[0].stamp))
    return (f'<h1>Cortical shift: {_text(title)}</h1><p class="small">first stage {moment} UTC; {len(case.stages)} stages, '
            f'{len(case.fields)} fields, {len(case.points)} digitised points; cortshift {_text(software_version())}; report of '
            f'{time.strftime("%Y-%m-%d %H:%M", time.gmtime())} UTC. Method: Ji et al., Med Image Anal 18(7):1169-1183, 2014. '
            'Research software, not for clinical use.</p>')


def _warnings(case):
    found = [f'not readable, left out: {reason}' for reason in case.unread]
    if not case.calibrations:
        found.append('no calibration file in the case folder: dates and errors of the calibration are not known')
    for stage in case.stages:
        if stage.T_pmr_left is None:
            found.append(f'stage {stage.key}: the pose of its camera is not known')
    for field in case.fields:
        name = f'{field.from_key} → {field.to_key}'
        summary = field.summary
        if summary.overlap < LOW_COVERAGE:
            found.append(f'{name}: the later stage covers only {summary.overlap:.0%} of the earlier one')
        shown = field.valid.mean()
        if shown < 0.3:
            found.append(f'{name}: only {shown:.0%} of the plane carries a trusted vector')
        if field.from_mr:  # its border lies on the brain
            continue
        median, high, common, count = immobile_misalignment(field)
        if median > RIM_WARNING:
            found.append(f'{name}: the border of the field, where immobile features are expected, moves by {median * 1000:.2f} mm '
                         f'(median of {count} points, 95th percentile {high * 1000:.2f} mm, in common {common * 1000:.2f} mm): check '
                         'tool tracking and patient registration, or whether the border lies on the brain')
    if case.fields and case.gravity_pmr is None and not any(math.isfinite(f.summary.gravity_mean) for f in case.fields):
        found.append('gravity is not known: digitise two positions with the probe')
    return found


def _warning_box(warnings):
    if not warnings:
        return '<p>No warnings.</p>'
    return '<div class="warning"><b>Warnings</b><ul>' + ''.join(f'<li>{_text(w)}</li>' for w in warnings) + '</ul></div>'


def _calibration(case):
    rows = []
    for side, info in sorted(case.camera_infos.items()):
        baseline = -info.P[3] / info.P[0] if info.P[0] else 0.0
        rows.append([f'{side} camera, in the stages', f'{info.width} x {info.height} px, f {info.K[0]:.1f} / {info.K[4]:.1f} px, '
                     f'centre {info.K[2]:.1f}, {info.K[5]:.1f} px, distortion {", ".join(f"{d:.4g}" for d in info.D)}'
                     + (f', baseline {baseline * 1000:.2f} mm' if baseline else '')])
    for name, content in sorted(case.calibrations.items()):
        told = _scalars(content)
        rows.append([name, '; '.join(f'{key} {value}' for key, value in told) or 'holds no date or error'])
    if not rows:
        return ''
    return '<h2>Calibration</h2><table>' + ''.join(f'<tr><th>{_text(a)}</th><td>{_text(b)}</td></tr>' for a, b in rows) + '</table>'


def _scalars(content, prefix=''):
    """Dates and errors of a calibration file, whatever its structure."""
    told = []
    for key, value in content.items():
        name = f'{prefix}{key}'
        if isinstance(value, dict):
            told += _scalars(value, name + '.')
        elif any(word in str(key).lower() for word in ('date', 'rms', 'error', 'residual', 'device', 'views')) and isinstance(
                value, (str, int, float)) or hasattr(value, 'isoformat'):
            told.append((name, f'{value:.4g}' if isinstance(value, float) else value))
    return told[:16]


def _timeline(case):
    rows = ''.join(
        f'<tr><td>{_text(s.key)}</td><td>{time.strftime("%H:%M:%S", time.gmtime(s.stamp))}</td>'
        f'<td class="n">{(s.stamp - case.stages[0].stamp) / 60:.1f}</td><td class="n">{100 * s.coverage:.0f}</td>'
        f'<td class="n">{int(np.isfinite(s.points).all(-1).sum())}</td>'
        f'<td class="n">{sum(p.stage == s.key for p in case.points)}</td><td>{_text(s.note)}</td></tr>' for s in case.stages)
    return ('<h2>Stages</h2>' + _picture(figures.timeline_figure(case.stages), 'timeline of the stages') +
            '<table><tr><th>stage</th><th>time (UTC)</th><th>min after the first</th><th>coverage / %</th><th>points</th>'
            f'<th>probe points</th><th>note</th></tr>{rows}</table>')


def _number(value):
    if isinstance(value, (float, np.floating)):
        return f'{value:.2f}' if math.isfinite(value) else ''
    return str(value)


def _cells(header, row):
    """(name, text, whether it is a number) for each column; NAME_mean_mm and NAME_sd_mm become one, millimetres go unsaid."""
    cells = []
    for name, value in zip(header, row):
        if name.endswith('_sd_mm') and cells and name[:-6] == cells[-1][0]:
            if _number(value):
                cells[-1] = (*cells[-1][:1], f'{cells[-1][1]} \u00b1 {_number(value)}', True)
        else:
            cells.append((re.sub('(_mean)?_mm$', '', name), _number(value), not isinstance(value, str)))
    return cells


def _column_title(name):
    """What a reader sees of a column's name in the CSV."""
    if name == 'pair':
        return 'pair; lengths in mm'
    if name == 'd':
        return '|d|'
    base, _, unit = name.rpartition('_')
    sign = {'min': 'min', 's': 's', 'deg': '\u00b0', 'percent': '%'}.get(unit)
    return f'{base.replace("_", " ")} / {sign}' if base and sign else name.replace('_', ' ')


def _table(title, header, rows, note, transpose=False):
    """Rows as a table; transposed, a row becomes a column."""
    titles = [_column_title(name) for name, _, _ in _cells(header, [0.0] * len(header))]
    columns = [[(text, number) for _, text, number in _cells(header, row)] for row in rows]

    def cell(text, number):
        return f'<td{" class=n" if number else ""}>{_text(text)}</td>'
    if transpose:
        body = ''.join(f'<tr><th>{_text(name)}</th>{"".join(cell(*column[n]) for column in columns)}</tr>'
                       for n, name in enumerate(titles))
    else:
        body = f'<tr>{"".join(f"<th>{_text(name)}</th>" for name in titles)}</tr>' + ''.join(
            f'<tr>{"".join(cell(*c) for c in column)}</tr>' for column in columns)
    return f'<h2>{_text(title)}</h2><table>{body}</table><p class="small">{_text(note)}</p>'


def _pair(case, field):
    keys = {stage.key for stage in case.stages}
    name = f'{field.from_key} \u2192 {field.to_key}'
    heading = f'<h2 class="pair">{_text(name)}{" (since the preoperative MR)" if field.from_mr else ""}</h2>'
    if not field.valid.any():
        return f'{heading}<p>No vector can be trusted.</p>'
    parts = [heading]
    if field.to_key in keys and (field.from_mr or field.from_key in keys):
        first = figures.mr_vessels(field) if field.from_mr else figures.project_colour(case.stage(field.from_key), field)
        about = 'the MR (vessels drawn dark)' if field.from_mr else 'earlier'
        parts.append(_picture(figures.overlay_figure(first, case.stage(field.to_key), field), f'overlays of {name}',
                              f'Overlay: red {about}, green later, yellow where they agree'))
    maps = figures.component_figure(field, case.gravity_pmr, case.first_normal_pmr)
    parts.append(_picture(maps, f'maps of {name}', 'Displacement'))
    parts.append(_picture(figures.vector_figure(field), f'vectors of {name}', 'Vectors on the earlier surface'))
    if field.from_mr:  # vessels tell where the brain went, but too coarsely for its strain
        parts.append(_picture(figures.confidence_figure(field), f'confidence of {name}', 'Confidence'))
        return '\n'.join(parts)
    parts.append(_picture(figures.trust_figure(field), f'confidence and strain of {name}', 'Confidence and strain'))
    median, high, common, count = immobile_misalignment(field)
    parts.append(f'<p class="small">Alignment of what should not move: the border of the field (4 mm wide, {count} points) moves by '
                 f'{median * 1000:.2f} mm in the median, 95th percentile {high * 1000:.2f} mm; all of it in common by '
                 f'{common * 1000:.2f} mm, as an error of the tool tracking would do.</p>')
    return '\n'.join(parts)


def write_report(folder, page, tables, name='report'):
    """Write the page and the tables into the case folder. Returns the page's path."""
    path = os.path.join(folder, name + '.html')
    write_durably(path, page)
    for file, text in tables.items():
        write_durably(os.path.join(folder, file), text)
    return path


def print_pdf(page_path, pdf_path):
    """Print an HTML file to PDF through headless Chromium. Raises CaseError where it is missing or fails."""
    browser = shutil.which('chromium') or shutil.which('chromium-browser') or shutil.which('google-chrome')
    if browser is None:
        raise CaseError('no PDF: chromium is not installed; install it, or ask for the HTML file alone (--no-pdf)')
    with tempfile.TemporaryDirectory() as profile:
        run = subprocess.run([browser, '--headless', '--no-sandbox', '--disable-gpu', f'--user-data-dir={profile}',
                              '--no-pdf-header-footer', f'--print-to-pdf={os.path.abspath(pdf_path)}',
                              'file://' + os.path.abspath(page_path)],
                             stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True, timeout=300, check=False)
    if run.returncode != 0 or not os.path.exists(pdf_path):
        raise CaseError(f'no PDF: chromium failed ({run.stdout.strip()[-300:]}); try again, or --no-pdf')
