"""The section of the report on the MR that was brought up to date: what update_mr or the node brain_model left in the case."""
import glob
import json
import os
from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.figure import Figure

from cortshift_tracking.errors import CaseError, VolumeError
from cortshift_tracking.mr.cross_section import PLANES, mr_section, picture_axes
from cortshift_tracking.mr.reader import load_volume
from cortshift_tracking.report.page import picture, table, text

HEADER = ('structure', 'centre_mean_mm', 'centre_sd_mm', 'border_mean_mm', 'border_sd_mm')
IN_SUMMARY = ('centre_shift_mm', 'centre_sd_mm', 'border_shift_mm', 'border_sd_mm')
REACH = 0.05   # of what is shown around the craniotomy [m]
STEP = 0.0005  # of the pictures [m]


@dataclass(frozen=True)
class Update:
    """One folder of an update. summary: as in its summary.json."""
    folder: str
    summary: dict


def read_updates(folder, left_out):
    """The updates in a case folder, in its `brain_model`, or in that of a case folder in it; what cannot be read is named in left_out."""
    updates = []
    for path in sorted(path for below in ('*', '*/*', '*/brain_model/*') for path in glob.glob(os.path.join(glob.escape(folder), below, 'summary.json'))):
        try:
            with open(path, encoding='utf-8') as file:
                summary = json.load(file)
            if not isinstance(summary, dict) or not {'from_key', 'to_key', 'labels', 'warnings', 'residual_at_surface_mm',
                                                     'largest_displacement_mm'} <= summary.keys():
                raise CaseError('is not what update_mr writes; run it again')
            updates.append(Update(os.path.dirname(path), summary))
        except (OSError, ValueError, CaseError) as error:
            why = error if isinstance(error, CaseError) else 'is damaged or cannot be read; run update_mr again'
            left_out.append(f'{os.path.relpath(path, folder)}: {why}')
    return updates


def section(update, case, volume, left_out):
    """HTML of one update. volume: the preoperative MR, or None."""
    summary = update.summary
    name = f'{summary["from_key"]} \u2192 {summary["to_key"]}'
    parts = [f'<h2>The MR brought up to date: {text(name)}</h2>']
    rows = [[_named(label, values), *(_or_nan(values.get(column)) for column in IN_SUMMARY)] for label, values in summary['labels'].items()]
    if rows:
        parts.append(table('Shift of what lies below', HEADER, rows,
                           'Millimetres: of the structure\'s centre, and the mean over its border, each with the model\'s standard deviation.'))
    parts.append(f'<p>Largest displacement {_or_nan(summary["largest_displacement_mm"]):.1f} mm; the model meets the measured vectors to '
                 f'{_or_nan(summary["residual_at_surface_mm"]):.2f} mm (root mean square).</p>')
    parts += [f'<p class="warning">{text(warning)}</p>' for warning in summary['warnings']]
    overlay = _overlay(update, left_out)
    if overlay is not None:
        parts.append(picture(overlay, f'outlines at {summary["to_key"]}', f'Left camera at {summary["to_key"]}, with what lies below as it was in the '
                             'MR (red) and as it is now (green)'))
    now = _of_now(update, 'updated_mr.nii.gz', volume, left_out)
    if now is not None:
        at, says = np.nanmedian(case.stages[0].points.reshape(-1, 3), axis=0), ''
        labels = _of_now(update, 'labels_now.nii.gz', volume, left_out) if rows else None
        if labels is not None and (labels.data == 1).any():   # the first structure is what one looks for
            at, says = labels.to_pmr(np.argwhere(labels.data == 1)).mean(0), f'; through {next(iter(summary["labels"]))}, structures as they are now in green'
        parts.append(picture(_before_after(volume, now, labels, at), f'MR before and after {name}',
                             f'Preoperative MR, brought up to date, and what differs{says}'))
    return '\n'.join(parts)


def _named(label, values):
    """A label, and what was taken out of it."""
    gone = values.get('resected') or 0.0
    return label if gone == 0 else f'{label} (resected)' if gone == 1 else f'{label} ({gone:.0%} resected)'


def _or_nan(value):
    return float('nan') if value is None else float(value)


def _overlay(update, left_out):
    """Bytes of overlay.png, or None; where no structure was followed there is none."""
    path = os.path.join(update.folder, 'overlay.png')
    try:
        with open(path, 'rb') as file:
            content = file.read()
    except FileNotFoundError:
        return None
    except OSError as error:
        left_out.append(f'{path}: cannot be read ({error.strerror}); check its rights and the disk')
        return None
    if not content or cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR) is None:
        left_out.append(f'{path}: is damaged; run update_mr again')
        return None
    return content


def _of_now(update, file, volume, left_out):
    """A volume of the update, if it can be compared with the MR before."""
    if volume is None:
        return None
    path = os.path.join(update.folder, file)
    try:
        now = load_volume(path, volume.axes)
    except VolumeError as error:
        left_out.append(str(error))
        return None
    if now.data.shape != volume.data.shape or not np.allclose(now.T_pmr_voxel, volume.T_pmr_voxel, atol=1e-5):
        left_out.append(f'{path}: lies on another grid than the MR of this report; give that MR with --mr')
        return None
    return now


def _before_after(before, after, labels, at):
    """Rows: planes through a point; columns: before, after, after minus before. labels: > 0 in structures as they are now, or None."""
    window = np.nanpercentile(before.data[::3, ::3, ::3], (1, 99.7))
    figure = Figure(figsize=(11.6, 11.2), dpi=100, facecolor='white')
    panels = figure.subplots(3, 3)
    figure.subplots_adjust(left=0.05, right=0.99, top=0.96, bottom=0.04, wspace=0.1, hspace=0.18)
    for row, plane in zip(panels, PLANES):
        shown = picture_axes(plane, before.axes)
        middle = at[[shown.across, shown.up]]
        low, high = middle - REACH, middle + REACH
        first, second = (mr_section(volume, plane, at[PLANES[plane]], low, high, STEP) for volume in (before, after))
        half = 0.5 * (window[1] - window[0])
        for panel, image, title, look in ((row[0], first, 'before', {'cmap': 'gray', 'vmin': window[0], 'vmax': window[1]}),
                                          (row[1], second, 'now', {'cmap': 'gray', 'vmin': window[0], 'vmax': window[1]}),
                                          (row[2], second - first, 'now minus before', {'cmap': 'RdBu_r', 'vmin': -half, 'vmax': half})):
            extent = np.array([low[0], high[0], low[1], high[1]]) * 1000
            panel.imshow(image, origin='lower', extent=extent, **look)
            if labels is not None and panel is row[1]:
                structures = np.nan_to_num(mr_section(labels, plane, at[PLANES[plane]], low, high, STEP))
                panel.contour(structures, [0.5], colors='limegreen', linewidths=1, origin='lower', extent=extent)
            if shown.flip_across:
                panel.invert_xaxis()
            if shown.flip_up:
                panel.invert_yaxis()
            panel.set_title(f'{plane}, {title}', fontsize=10)
            panel.set_facecolor('black')
            panel.set_xlabel('mm', fontsize=8, labelpad=0)
            panel.tick_params(labelsize=7)
            for letter, x, y in zip(shown.letters, (0.03, 0.97, 0.5, 0.5), (0.5, 0.5, 0.04, 0.96)):
                panel.text(x, y, letter, transform=panel.transAxes, color='orange', fontweight='bold', ha='center', va='center')
    return figure
