"""The figures of the case report. All maps show the projection plane, mm, upright as the microscope saw the earlier stage, with the
outline of the exposed brain where it is known."""
import base64
import io

import cv2
import numpy as np
from matplotlib import cm
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from cortshift_tracking.report.palette import stage_colour

WIDTH_PX = 1160
DPI = 100
SMOOTHING = 0.002      # standard deviation for strain [m] (Ji et al. 2011)
OVERLAY_STEP = 0.0002  # grid of the overlays [m]


def to_data_uri(figure):
    out = io.BytesIO()
    figure.savefig(out, format='png', dpi=DPI, bbox_inches='tight', pad_inches=0.08)
    return png_uri(out.getvalue())


def png_uri(content):
    return 'data:image/png;base64,' + base64.b64encode(content).decode()


def _figure(rows, columns, height_px):
    figure = Figure(figsize=(WIDTH_PX / DPI, height_px / DPI), dpi=DPI, facecolor='white')
    panels = figure.subplots(rows, columns, squeeze=False)
    figure.subplots_adjust(left=0.055, right=0.95, top=0.95, bottom=0.08, wspace=0.3, hspace=0.25)
    return figure, panels


def _extent_mm(field):
    height, width = field.confidence.shape
    return np.array([-0.5, width - 0.5, -0.5, height - 0.5]) * field.resolution * 1000


def _axes_mm(panel, title):
    panel.set_title(title, fontsize=11)
    panel.set_xlabel('x / mm', fontsize=9)
    panel.set_ylabel('y / mm', fontsize=9)
    panel.tick_params(labelsize=8)
    panel.set_aspect('equal')
    panel.set_facecolor('#e9e9e9')


def _draw_brain(panel, field):
    for polygon in field.brain:
        closed = 1000 * np.vstack([polygon, polygon[:1]])
        for colour, width in (('black', 2.4), ('white', 1.2)):  # seen on light and dark
            panel.plot(*closed.T, color=colour, linewidth=width)


def _map(figure, panel, field, values, title, cmap, low, high, unit, scale=1000):
    image = panel.imshow(values * scale, cmap=cmap, vmin=low, vmax=high, extent=_extent_mm(field), origin='lower',
                         interpolation='nearest')
    _draw_brain(panel, field)
    _axes_mm(panel, title)
    bar = figure.colorbar(image, ax=panel, fraction=0.04, pad=0.02)
    bar.set_label(unit, fontsize=9)
    bar.ax.tick_params(labelsize=8)


def project_colour(stage, field, step=OVERLAY_STEP):
    """Luminance (H, W) 0-1 of a stage over the field's plane at `step` [m]; NaN where the stage shows nothing."""
    height, width = [int(np.ceil(n * field.resolution / step)) for n in field.confidence.shape]
    valid = np.isfinite(stage.points).all(-1)
    local = (stage.points[valid] - field.T_pmr_projection[:3, 3]) @ field.T_pmr_projection[:3, :2] / step
    column, row = np.rint(local).astype(int).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    index = row[inside] * width + column[inside]
    grey = stage.colour[valid][inside] @ np.array([0.299, 0.587, 0.114]) / 255
    count = np.bincount(index, minlength=height * width).reshape(height, width).astype(np.float32)
    total = np.bincount(index, grey, minlength=height * width).reshape(height, width).astype(np.float32)
    # A grid point between the surface's points takes its neighbours' colour.
    weight, value = cv2.GaussianBlur(count, (0, 0), 0.7), cv2.GaussianBlur(total, (0, 0), 0.7)
    with np.errstate(invalid='ignore', divide='ignore'):
        return np.where(weight > 0.02, value / weight, np.nan)


def mr_vessels(field):
    """Intensity (H, W) 0-1 of the MR over the field's plane at OVERLAY_STEP, vessels dark like in a photograph."""
    size = [int(np.ceil(n * field.resolution / OVERLAY_STEP)) for n in field.confidence.shape]
    return 1 - cv2.resize(field.colour[..., 0], tuple(size[::-1]), interpolation=cv2.INTER_AREA).astype(np.float32) / 255


def overlay_figure(first, later, field):
    """Red: earlier, green: later; before and after the later one is brought back by the field (paper Fig. 8).

    first: luminance (H, W) 0-1 of the earlier surface over the field's plane at OVERLAY_STEP. later: the later stage.
    """
    second = project_colour(later, field)
    height, width = first.shape
    plane = field.displacement @ field.T_pmr_projection[:3, :2] / OVERLAY_STEP
    plane = np.stack([cv2.resize(plane[..., n].astype(np.float32), (width, height), interpolation=cv2.INTER_NEAREST)
                      for n in (0, 1)], -1)
    column, row = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    known = np.isfinite(plane).all(-1)
    moved = cv2.remap(np.nan_to_num(second), np.where(known, column + plane[..., 0], -10).astype(np.float32),
                      np.where(known, row + plane[..., 1], -10).astype(np.float32), cv2.INTER_LINEAR, borderValue=0)
    # The same contrast for both, so that a change of the light stays visible; MR and photograph cannot share one.
    shared = None if field.from_mr else first

    def stretch(image):
        low, high = np.nanpercentile(image if shared is None else shared, (1, 99))
        return np.clip((np.nan_to_num(image) - low) / max(high - low, 1e-3), 0, 1)
    figure, panels = _figure(1, 2, 500)
    before = np.stack([stretch(first), stretch(second), np.zeros_like(first)], -1)
    after = np.stack([stretch(first), stretch(moved), np.zeros_like(first)], -1)
    after[~known] *= 0.25
    for panel, image, title in ((panels[0, 0], before, 'before compensation'),
                                (panels[0, 1], after, 'after compensation (dark: no trusted vector)')):
        panel.imshow(image, extent=_extent_mm(field), origin='lower', interpolation='bilinear')
        _draw_brain(panel, field)
        _axes_mm(panel, title)
    figure.subplots_adjust(bottom=0.1, top=0.93)
    return figure


def component_figure(field, gravity, first_normal):
    """Magnitude, along gravity, along the first stage's normal, and lateral, in mm."""
    d = field.displacement
    magnitude = np.linalg.norm(d, axis=-1)
    normal = d @ first_normal
    lateral = np.linalg.norm(d - normal[..., None] * first_normal, axis=-1)
    top = _round_up(np.nanpercentile(magnitude, 99) * 1000)
    height, width = field.confidence.shape
    figure, panels = _figure(2, 2, 170 + 2 * 0.35 * WIDTH_PX * min(height / width, 1.5))  # rows as high as the maps
    _map(figure, panels[0, 0], field, magnitude, 'magnitude |d|', 'viridis', 0, top, 'mm')
    if gravity is None:
        _axes_mm(panels[0, 1], 'along gravity: gravity is not known')
        panels[0, 1].set_xlim(_extent_mm(field)[:2])
        panels[0, 1].set_ylim(_extent_mm(field)[2:])
    else:
        _map(figure, panels[0, 1], field, d @ gravity, 'along gravity (+ with it)', 'RdBu_r', -top, top, 'mm')
    _map(figure, panels[1, 0], field, normal, 'along the normal (+ bulging, - sagging)', 'RdBu_r', -top, top, 'mm')
    _map(figure, panels[1, 1], field, lateral, 'lateral', 'viridis', 0, top, 'mm')
    figure.subplots_adjust(top=0.96, bottom=0.06)
    return figure


def _round_up(value):
    if not value > 0.1:
        return 0.1
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if step * power >= value - 1e-12))


def strain_of(field, smoothing=SMOOTHING):
    """Principal in-plane strains (major, minor) (H, W) of the smoothed field: eigenvalues of the Green-Lagrange tensor."""
    valid = field.valid
    sigma = smoothing / field.resolution
    plane = field.displacement @ field.T_pmr_projection[:3, :2]
    weight = cv2.GaussianBlur(valid.astype(np.float32), (0, 0), sigma)
    smooth = [cv2.GaussianBlur(np.where(valid, plane[..., n], 0).astype(np.float32), (0, 0), sigma) / np.maximum(weight, 1e-6)
              for n in (0, 1)]
    uy, ux = np.gradient(smooth[0], field.resolution)
    vy, vx = np.gradient(smooth[1], field.resolution)
    exx, eyy = ux + 0.5 * (ux ** 2 + vx ** 2), vy + 0.5 * (uy ** 2 + vy ** 2)
    exy = 0.5 * (uy + vx + ux * uy + vx * vy)
    mean, radius = 0.5 * (exx + eyy), np.hypot(0.5 * (exx - eyy), exy)
    hidden = ~valid | (weight < 0.6)  # near the border the smoothing is one-sided
    return tuple(np.where(hidden, np.nan, e) for e in (mean + radius, mean - radius))


def _confidence(figure, panel, field):
    _map(figure, panel, field, np.where(field.valid, field.confidence, np.nan), 'confidence', 'cividis', 0, 1, '0-1', 1)


def confidence_figure(field):
    figure, panels = _figure(1, 1, 450)
    _confidence(figure, panels[0, 0], field)
    return figure


def trust_figure(field):
    """Confidence, and the principal in-plane strains."""
    strain = (field.strain_major, field.strain_minor) if field.strain_major is not None else strain_of(field)
    top = max(1.0, float(np.ceil(100 * np.nanpercentile(np.abs(np.stack(strain)), 98)))) if any(
        np.isfinite(s).any() for s in strain) else 1.0
    figure, panels = _figure(1, 3, 390)
    _confidence(figure, panels[0, 0], field)
    _map(figure, panels[0, 1], field, strain[0], 'major principal strain', 'RdBu_r', -top, top, '%', 100)
    _map(figure, panels[0, 2], field, strain[1], 'minor principal strain', 'RdBu_r', -top, top, '%', 100)
    figure.subplots_adjust(bottom=0.12, top=0.92, wspace=0.35)
    return figure


def vector_figure(field, arrows=24, elevation=0.6, azimuth=-0.5):
    """Oblique view of the vectors from the earlier to the later surface (paper Figs. 7, 11), parallel projection.

    elevation, azimuth: of the viewer over the projection plane [rad].
    """
    R, origin = field.T_pmr_projection[:3, :3], field.T_pmr_projection[:3, 3]
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    screen = np.array([[ca, -sa, 0], [sa * se, ca * se, ce]])  # right and up of the picture in the local frame

    def seen(points_local):
        return points_local @ screen.T * 1000

    def chosen(count):
        stride = max(1, int(np.sqrt(field.valid.sum()) / count))
        pick = np.zeros_like(field.valid)
        pick[stride // 2::stride, stride // 2::stride] = True
        return pick & field.valid
    figure = Figure(figsize=(WIDTH_PX / DPI, 6.6), dpi=DPI, facecolor='white')
    panel = figure.add_axes([0.02, 0.02, 0.86, 0.96])
    surface = chosen(220)
    panel.scatter(*seen((field.start[surface] - origin) @ R).T, c=field.colour[surface] / 255, s=7, alpha=0.35, linewidths=0)
    pick = chosen(arrows)
    start = (field.start[pick] - origin) @ R
    vector = field.displacement[pick] @ R
    magnitude = np.linalg.norm(vector, axis=1) * 1000
    top = _round_up(np.nanpercentile(np.linalg.norm(field.displacement, axis=-1), 99) * 1000)
    tail, head = seen(start), seen(start + vector)
    panel.quiver(*tail.T, *(head - tail).T, magnitude, cmap='viridis', norm=Normalize(0, top), angles='xy', scale_units='xy', scale=1,
                 width=0.0022, headwidth=4, headlength=5)
    low, high = np.minimum(tail.min(0), head.min(0)), np.maximum(tail.max(0), head.max(0))
    corner = low - 0.02 * (high - low)
    for n, name in enumerate(('x', 'y', 'z (normal)')):
        tip = corner + 10 * screen[:, n]
        panel.annotate('', tip, corner, arrowprops={'arrowstyle': '->', 'color': '#333333', 'lw': 1.4})
        panel.text(*(corner + 11.5 * screen[:, n]), name, fontsize=9, ha='center', va='center')
    panel.text(*(corner - [0, 4.5]), 'axes: 10 mm', fontsize=9, ha='left')
    panel.set_xlim(corner[0] - 6, high[0] + 3)
    panel.set_ylim(corner[1] - 6, high[1] + 3)
    panel.set_aspect('equal')
    panel.set_axis_off()
    bar = figure.colorbar(cm.ScalarMappable(Normalize(0, top), 'viridis'), cax=figure.add_axes([0.91, 0.2, 0.015, 0.6]))
    bar.set_label('|d| / mm; arrows in true length')
    return figure


def timeline_figure(stages):
    """Stages over the time since the first one."""
    figure, panels = _figure(1, 1, 190)
    panel = panels[0, 0]
    minutes = [(stage.stamp - stages[0].stamp) / 60 for stage in stages]
    longest = max(minutes[-1], 1e-3)
    panel.axhline(0, color='#777777', linewidth=1.5)
    for n, (stage, minute) in enumerate(zip(stages, minutes)):
        panel.plot(minute, 0, 'o', color=stage_colour(n), markeredgecolor='black', markersize=11)
        side = 1 if n % 2 == 0 else -1
        panel.annotate(stage.key, (minute, 0), (0, 16 * side), textcoords='offset points', ha='center',
                       va='bottom' if side > 0 else 'top', fontsize=10)
    panel.set_xlim(-0.06 * longest, 1.06 * longest)
    panel.set_ylim(-1, 1)
    panel.set_yticks([])
    panel.set_xlabel('minutes since the first stage', fontsize=9)
    for name in ('left', 'right', 'top'):
        panel.spines[name].set_visible(False)
    figure.subplots_adjust(bottom=0.3, top=0.97, left=0.03)
    return figure
