"""First registration to the preoperative MR (Fan et al. 2012, named in the paper's discussion).

The MR's intensity-encoded cortical surface and the stereo surface of a stage are projected onto one plane and registered by
the flow of section 2.4. Their intensities have nothing in common, so the flow sees features that both show, each ranked by
its own distribution: vessels (bright after contrast in the MR; in the photograph where red outweighs green, whatever the
light) at two widths, and the relief of the sulci, which both surfaces have.
"""
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from cortshift_tracking.errors import CortshiftError
from cortshift_tracking.flow_tool import flow_between
from cortshift_tracking.geometry import local_frame
from cortshift_tracking.case.messages import MR_KEY, Field
from cortshift_tracking.mr.cortex import CortexSettings, extract_cortex


class RegistrationError(CortshiftError):
    """The surface and the MR cannot be registered."""


@dataclass(frozen=True)
class MrRegistrationSettings:
    """Lengths [m]."""
    resolution: float = 0.00015          # of the projection grid
    vessel_widths: tuple = (0.0004, 0.0009)  # standard deviations of the ridge filters
    relief_band: tuple = (0.0004, 0.004)     # sulci: between these standard deviations
    relief_depth: float = 0.0008         # of a sulcus that counts in full
    relief_weight: float = 0.5
    blur: float = 0.0002                 # standard deviation, of the features
    alpha: float = 0.2                   # smoothness of the flow: features are sparse, the brain's motion is smooth
    window: float = 0.0015               # standard deviation of the window in which features are compared
    min_correlation: float = 0.4         # of the features there, after registration
    max_inconsistency: float = 0.0008    # between forward and backward flow
    border: float = 0.002                # eroded from the border of the overlap
    # Outside the craniotomy bone covers the cortex, and the camera sees the bone: there the displacement jumps outwards.
    slope_scale: float = 0.0012          # standard deviation of the smoothing before the slope is taken
    max_slope: float = 0.6               # of the displacement along the normal; brain does not bend more
    neck: float = 0.003                  # parts that a narrower strip connects are taken for separate; the largest is the brain


def register_to_mr(stage, volume, brain_mask=None, settings=MrRegistrationSettings(), cortex_settings=CortexSettings()):
    """Displacement field from the MR's cortex (key "pmr") to a stage's surface, as a Field with summary None.

    The second result is the share of the MR's cortex, as far as it was extracted, that the stage shows (0-1).
    Raises VolumeError or RegistrationError saying why not.
    """
    cortex = extract_cortex(volume, stage.points, brain_mask, cortex_settings)
    frame = local_frame(cortex.points)
    step = settings.resolution
    valid = np.isfinite(cortex.points).all(-1)
    local = frame.to_local(cortex.points[valid])
    low, high = local.min(0), local.max(0)
    size = tuple(np.ceil((high - low)[:2] / step).astype(int) + 1)  # columns, rows
    from_mr = _project(local, low, step, size, np.stack([cortex.intensity[valid], local[:, 2]], -1),
                       cortex_settings.resolution)
    seen = np.isfinite(stage.points).all(-1)
    local = frame.to_local(stage.points[seen])
    red, green = (stage.colour[..., n].astype(float)[seen] for n in (0, 1))
    from_stage = _project(local, low, step, size, np.stack([np.log((red + 8) / (green + 8)), local[:, 2]], -1), step)
    both = np.isfinite(from_mr[..., 0]) & np.isfinite(from_stage[..., 0])
    if both.sum() * step ** 2 < 1e-4:
        raise RegistrationError(f'stage "{stage.key}" and the cortex of the MR overlap on less than 1 cm2; check the patient '
                                'registration')
    first, second = (_features(image, both, settings) for image in (from_mr, from_stage))
    forward, backward = _flow(first, second, settings), _flow(second, first, settings)
    confidence = _confidence(first, second, forward, backward, np.isfinite(from_mr[..., 0]), np.isfinite(from_stage[..., 0]),
                             settings)
    overlap = both.sum() / np.isfinite(from_mr[..., 0]).sum()
    return _field(stage, frame, low, from_mr, from_stage, forward, confidence, settings), float(overlap)


def _project(local, low, step, size, values, spacing):
    """Values (N, C) at points over the plane to a grid (rows, columns, C), row 0 at the smallest y; NaN where there is none."""
    column, row = np.rint((local[:, :2] - low[:2]) / step).astype(int).T
    inside = (column >= 0) & (column < size[0]) & (row >= 0) & (row < size[1])
    index = row[inside] * size[0] + column[inside]
    count = np.bincount(index, minlength=size[0] * size[1]).reshape(size[1], size[0])
    sigma = max(0.6, 0.6 * spacing / step)  # fills the grid points between those on which a point fell
    weight = cv2.GaussianBlur(count.astype(np.float32), (0, 0), sigma)
    grid = np.empty(count.shape + (values.shape[1],))
    for n in range(values.shape[1]):
        total = np.bincount(index, values[inside, n], minlength=count.size).reshape(count.shape)
        with np.errstate(invalid='ignore', divide='ignore'):
            grid[..., n] = cv2.GaussianBlur(total.astype(np.float32), (0, 0), sigma) / weight
    grid[weight < 0.02] = np.nan
    return grid


def _filled(image, sigma=8.0):
    """Holes continue smoothly from their surroundings."""
    valid = np.isfinite(image)
    weight = cv2.GaussianBlur(valid.astype(np.float32), (0, 0), sigma)
    smooth = cv2.GaussianBlur(np.where(valid, image, 0).astype(np.float32), (0, 0), sigma) / np.maximum(weight, 1e-6)
    return np.where(valid, image, smooth).astype(np.float32)


def _ridges(image, sigma):
    """Strength of bright lines: minus the smaller eigenvalue of the Hessian at a scale, 0 where it is positive."""
    xx, yy, xy = (ndimage.gaussian_filter(image, sigma, order=order) for order in ((0, 2), (2, 0), (1, 1)))
    return np.maximum(0, np.hypot((xx - yy) / 2, xy) - (xx + yy) / 2)


def _features(image, both, settings):
    """(rows, columns, 3) 0...1: thin and wide vessels, sulci."""
    step = settings.resolution
    core = ndimage.binary_erosion(both, iterations=int(0.005 / step)) if both.sum() * step ** 2 > 1e-3 else both
    core = core if core.any() else both
    vessels, channels = _filled(image[..., 0]), []
    for width in settings.vessel_widths:
        ridges = _ridges(vessels, width / step)
        # In both images the 97th percentile is a clear vessel; the square root makes fainter ones count.
        channels.append(np.sqrt(np.clip(ridges / max(np.percentile(ridges[core], 97), 1e-9), 0, 1)))
    height = _filled(image[..., 1])
    relief = ndimage.gaussian_filter(height, settings.relief_band[0] / step) - ndimage.gaussian_filter(
        height, settings.relief_band[1] / step)
    channels.append(settings.relief_weight * np.clip(-relief / settings.relief_depth, 0, 1))
    return np.dstack([cv2.GaussianBlur(c.astype(np.float32), (0, 0), settings.blur / step) for c in channels])


def _flow(first, second, settings):
    """Flow with the paper's model, (rows, columns, 2) [grid units]."""
    # There are few features: many iterations, and no smoothing beyond that of the features.
    return flow_between(first, second, preset='ji2014', alpha=settings.alpha, outer_iterations=7, inner_iterations=1,
                        solver_iterations=30, presmoothing=0)


def _targets(flow):
    column, row = np.meshgrid(np.arange(flow.shape[1], dtype=np.float32), np.arange(flow.shape[0], dtype=np.float32))
    return column + flow[..., 0], row + flow[..., 1]


def _confidence(first, second, forward, backward, first_mask, second_mask, settings):
    """0...1: correlation of the features in a window after registration; 0 where a gate fails."""
    step = settings.resolution
    target = _targets(forward)
    brought = cv2.remap(second, *target, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    sigma = settings.window / step

    def mean(image):
        return cv2.GaussianBlur(image.sum(-1) if image.ndim == 3 else image, (0, 0), sigma)
    n = first.shape[-1]
    a, b = mean(first) / n, mean(brought) / n
    va, vb = mean(first * first) / n - a * a, mean(brought * brought) / n - b * b
    correlation = (mean(first * brought) / n - a * b) / np.sqrt((va + 4e-4) * (vb + 4e-4))
    gap = np.linalg.norm(forward + cv2.remap(backward, *target, cv2.INTER_LINEAR), axis=-1) * step

    def inner(mask):
        return cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1] * step > settings.border
    allowed = inner(ndimage.binary_fill_holes(first_mask)) & (cv2.remap(
        inner(ndimage.binary_fill_holes(second_mask)).astype(np.uint8), *target, cv2.INTER_NEAREST) > 0)
    allowed &= (correlation >= settings.min_correlation) & (gap <= settings.max_inconsistency)
    return np.where(allowed, np.clip(correlation, 0, 1), 0)


def _exposed_brain(trusted, rise, settings):
    """The part of what is trusted (bool) that can be brain inside the craniotomy. rise: displacement along the normal [m]."""
    step = settings.resolution
    sigma = settings.slope_scale / step
    weight = cv2.GaussianBlur(trusted.astype(np.float32), (0, 0), sigma)
    smooth = cv2.GaussianBlur(np.where(trusted, rise, 0).astype(np.float32), (0, 0), sigma) / np.maximum(weight, 1e-6)
    possible = trusted & (np.hypot(*np.gradient(smooth, step)) <= settings.max_slope)
    radius = int(round(settings.neck / 2 / step))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    cores, count = ndimage.label(cv2.erode(possible.astype(np.uint8), disc, borderValue=0))
    if count == 0:
        return np.zeros_like(trusted)
    largest = (cores == np.bincount(cores[cores > 0]).argmax()).astype(np.uint8)
    return possible & (cv2.dilate(largest, disc) > 0)


def _field(stage, frame, low, from_mr, from_stage, flow, confidence, settings):
    """The inversion of section 2.5: start on the MR's cortex, end on the stage's surface."""
    step = settings.resolution
    rows, columns = confidence.shape
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    start = np.stack([low[0] + column * step, low[1] + row * step, from_mr[..., 1]], -1)
    x, y = _targets(flow)
    end = np.stack([low[0] + x * step, low[1] + y * step,
                    cv2.remap(_filled(from_stage[..., 1]), x, y, cv2.INTER_LINEAR)], -1)
    hidden = (confidence == 0) | ~np.isfinite(start).all(-1)
    hidden = ~_exposed_brain(~hidden, end[..., 2] - start[..., 2], settings)
    start_pmr, displacement = frame.to_pmr(start), frame.to_pmr(end) - frame.to_pmr(start)
    start_pmr[hidden] = displacement[hidden] = np.nan
    if hidden.all():
        raise RegistrationError(f'no displacement from the MR to stage "{stage.key}" can be trusted; check the patient '
                                'registration, and that the MR shows vessels')
    T = frame.T_pmr_local.copy()
    T[:3, 3] = frame.to_pmr(np.array([low[0], low[1], 0.0]))
    window = np.nanpercentile(from_mr[..., 0], (1, 99.5))
    grey = np.clip((_filled(from_mr[..., 0]) - window[0]) / (window[1] - window[0]), 0, 1) * 255
    return Field(MR_KEY, stage.key, stage.stamp, stage.stamp, T, step, start_pmr, displacement,
                 np.repeat(grey[..., None], 3, -1).astype(np.uint8), np.where(hidden, np.nan, confidence), None)
