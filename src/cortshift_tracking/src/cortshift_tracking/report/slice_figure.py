"""MR slices with the cross-sections of the reconstructed surfaces (paper Figs. 2d, 11a, 12a)."""
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from cortshift_tracking.mr.cross_section import LETTERS, PLANES, cut, mr_section, picture_axes, sure_points
from cortshift_tracking.report.palette import stage_colour

ZOOM_MARGIN = 0.012  # shown around the surfaces in the lower row [m]
LARGEST_ZOOM = 0.07  # side of what is shown there [m]


def draw_slices(volume, surfaces, at=None, width_px=1160):
    """Figure of axial, coronal and sagittal slices: the whole head above, the craniotomy magnified below.

    surfaces: list of (name, points (H, W, 3) in pmr [m], confidence (H, W) 0-1); one colour each, in order. Where its
    reconstruction is not sure a section has a gap; the legend says how much of the surface is drawn.
    at: point in pmr [m] that the slices go through; by default the middle of the first surface.
    """
    names = [name for name, _, _ in surfaces]
    valid = [points[np.isfinite(points).all(-1)] for _, points, _ in surfaces]
    drawn = [sure_points(points, confidence) for _, points, confidence in surfaces]
    if at is None:
        at = np.median(valid[0], axis=0) if valid else volume.corners_pmr().mean(0)
    low, high = volume.corners_pmr()
    window = np.nanpercentile(volume.data[::3, ::3, ::3], (1, 99.7))
    rows = 2 if surfaces else 1
    figure = Figure(figsize=(width_px / 100, width_px / 100 * (0.78 if rows == 2 else 0.42)), dpi=100, facecolor='white')
    panels = figure.subplots(rows, 3, squeeze=False)
    figure.subplots_adjust(left=0.06, right=0.99, top=0.96, bottom=0.125 if rows == 2 else 0.1, wspace=0.22, hspace=0.16)
    for column, plane in enumerate(('axial', 'coronal', 'sagittal')):
        shown = picture_axes(plane, volume.axes)
        pair = [shown.across, shown.up]
        _panel(panels[0, column], volume, drawn, plane, at, low[pair], high[pair], window, width=1.2)
        panels[0, column].set_title(f'{plane}, {_coordinate(volume.axes, PLANES[plane], at)}', fontsize=10)
        if not surfaces:
            continue
        together = np.concatenate(valid)[:, pair]
        zoom_low, zoom_high = together.min(0) - ZOOM_MARGIN, together.max(0) + ZOOM_MARGIN
        side = min((zoom_high - zoom_low).max(), LARGEST_ZOOM) / 2  # square, so that the three have one scale
        middle = np.asarray(at)[pair] if 2 * side == LARGEST_ZOOM else (zoom_low + zoom_high) / 2
        panels[0, column].add_patch(Rectangle((middle - side) * 1000, 2 * side * 1000, 2 * side * 1000, fill=False,
                                              edgecolor='white', linewidth=0.8, linestyle='--'))
        _panel(panels[1, column], volume, drawn, plane, at, middle - side, middle + side, window, width=1.8)
    if surfaces:
        shares = [np.isfinite(points).all(-1).sum() / len(all_points) for points, all_points in zip(drawn, valid)]
        lines = [Line2D([], [], color=stage_colour(n), linewidth=3, label=f'{name} ({share:.0%} drawn)')
                 for n, (name, share) in enumerate(zip(names, shares))]
        figure.legend(handles=lines, loc='lower center', ncol=min(len(lines), 6), fontsize=11, frameon=False)
    return figure


def _coordinate(axes, axis, at):
    letter = LETTERS[axes][axis][1 if at[axis] >= 0 else 0]
    return f'{letter} {abs(at[axis]) * 1000:.1f} mm'


def _panel(panel, volume, surfaces, plane, at, low, high, window, width):
    shown = picture_axes(plane, volume.axes)
    axis = PLANES[plane]
    step = max((high - low).max() / 500, volume.spacing.min() / 2)
    grey = mr_section(volume, plane, at[axis], low, high, step)
    last = low + step * (np.array(grey.shape[::-1]) - 1)
    extent = np.array([low[0] - step / 2, last[0] + step / 2, low[1] - step / 2, last[1] + step / 2]) * 1000
    panel.set_facecolor('black')
    panel.imshow(grey, cmap='gray', vmin=window[0], vmax=window[1], extent=extent, origin='lower', interpolation='nearest')
    for number, points in enumerate(surfaces):
        segments = cut(points, axis, at[axis])[..., [shown.across, shown.up]] * 1000
        # One line with gaps: thousands of separate ones would take seconds to draw.
        curve = np.concatenate([segments, np.full((len(segments), 1, 2), np.nan)], 1).reshape(-1, 2).T
        # A dark outline makes every colour visible on bright tissue.
        panel.plot(*curve, color='black', linewidth=width + 1.2, solid_capstyle='round')
        panel.plot(*curve, color=stage_colour(number), linewidth=width, solid_capstyle='round')
    panel.set_xlim(extent[[1, 0]] if shown.flip_across else extent[[0, 1]])
    panel.set_ylim(extent[[3, 2]] if shown.flip_up else extent[[2, 3]])
    panel.set_aspect('equal')
    names = LETTERS[volume.axes]
    panel.set_xlabel(f'{"xyz"[shown.across]} ({names[shown.across][1]}+) / mm', fontsize=9)
    panel.set_ylabel(f'{"xyz"[shown.up]} ({names[shown.up][1]}+) / mm', fontsize=9)
    panel.tick_params(labelsize=8)
    left, right, bottom, top = shown.letters
    for letter, x, y in ((left, 0.03, 0.5), (right, 0.97, 0.5), (bottom, 0.5, 0.04), (top, 0.5, 0.96)):
        panel.text(x, y, letter, transform=panel.transAxes, color='white', fontsize=11, fontweight='bold', ha='center',
                   va='center')
