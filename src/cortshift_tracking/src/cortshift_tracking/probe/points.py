"""The tracked stylus: what counts as a point, and gravity from two of them (paper 2.7.1, 2.7.2). No ROS."""
from dataclasses import dataclass

import numpy as np

from cortshift_tracking.errors import ProbeError
from cortshift_tracking.keys import RULE, is_key

GRAVITY_LABELS = {'upper': 'gravity_upper', 'lower': 'gravity_lower'}


@dataclass(frozen=True)
class StillSettings:
    """When a tip counts as held still. Lengths [m], times [s]."""
    window: float = 1.0        # samples are taken over this time
    min_samples: int = 8       # in the window
    max_gap: float = 0.2       # between neighbouring samples; more means that tracking dropped
    max_spread: float = 0.001  # root mean square distance from the median
    max_drift: float = 0.001   # of the fitted straight motion over the window


@dataclass(frozen=True)
class GravitySettings:
    min_length: float = 0.05     # between the two positions [m]; shorter ones make the direction uncertain
    max_length: float = 1.5      # [m]
    max_deviation: float = 1.4   # from the direction that is expected to be roughly downwards [rad]


@dataclass(frozen=True)
class ProbePoint:
    """A digitised place. stamp: (seconds, nanoseconds); position_pmr (3,) [m]; see ProbePoint.msg for the rest."""
    stage: str
    label: str
    stamp: tuple
    position_pmr: tuple
    spread: float
    samples: int

    @property
    def position(self):
        return np.array(self.position_pmr)

    @property
    def name(self):
        return f'"{self.label}" of stage "{self.stage}"' if self.stage else f'"{self.label}"'


def check_key(what, key):
    if not is_key(key):
        raise ProbeError(f'{what} "{key}" is not allowed; use {RULE}')


def still_point(times, tips_pmr, settings=StillSettings()):
    """Median tip over a window in which it was held still.

    times (N,) [s] ascending, tips_pmr (N, 3) [m]: samples at their own stamps.
    Returns (position (3,) [m], spread [m]).
    Raises ProbeError saying that the tip moved or that tracking dropped.
    """
    times, tips = np.asarray(times, float), np.asarray(tips_pmr, float).reshape(-1, 3)
    if len(times) == 0:
        raise ProbeError('the probe tip is not tracked: no sample arrived; bring the probe into the view of the tracker')
    if not np.isfinite(tips).all():
        raise ProbeError('the tracker reports positions that are not numbers; check the probe')
    gaps = np.diff(times)
    if (gaps <= 0).any():
        raise ProbeError('time stamps of the probe do not ascend; check the clock of the tracker')
    if len(gaps) and gaps.max() > settings.max_gap:
        raise ProbeError(f'tracking of the probe dropped for {gaps.max():.2f} s; keep the probe in the view of the tracker and '
                         'try again')
    covered = times[-1] - times[0]
    if len(times) < settings.min_samples or covered < settings.window - settings.max_gap:
        raise ProbeError(f'tracking of the probe dropped: {len(times)} samples over {covered:.2f} s, needed are '
                         f'{settings.min_samples} over {settings.window:g} s; keep the probe in the view of the tracker and '
                         'try again')
    position = np.median(tips, axis=0)
    spread = float(np.sqrt(((tips - position) ** 2).sum(1).mean()))
    centred = times - times.mean()
    drift = float(np.linalg.norm(centred @ (tips - tips.mean(0))) / (centred @ centred) * covered)
    if drift > settings.max_drift or spread > settings.max_spread:
        raise ProbeError(f'the probe tip moves: {drift * 1000:.2f} mm drift and {spread * 1000:.2f} mm spread in {covered:.1f} s '
                         f'(allowed {settings.max_drift * 1000:g} and {settings.max_spread * 1000:g} mm); hold it still and '
                         'try again')
    return position, spread


def gravity_direction(upper_pmr, lower_pmr, expected_down_pmr=None, settings=GravitySettings()):
    """Unit vector of gravity in pmr from two tip positions [m] held vertically above each other.

    expected_down_pmr: a direction that is roughly downwards, or None where there is none to check against.
    Raises ProbeError where the pair is too short, too long, horizontal or upside down.
    """
    span = np.subtract(lower_pmr, upper_pmr).astype(float)
    length = float(np.linalg.norm(span))
    if length < settings.min_length:
        raise ProbeError(f'the two gravity positions are only {length * 1000:.1f} mm apart; hold them at least '
                         f'{settings.min_length * 1000:g} mm above each other')
    if length > settings.max_length:
        raise ProbeError(f'the two gravity positions are {length:.2f} m apart; hold them within {settings.max_length:g} m')
    down = span / length
    if expected_down_pmr is not None:
        expected = np.asarray(expected_down_pmr, float) / np.linalg.norm(expected_down_pmr)
        deviation = float(np.arccos(np.clip(down @ expected, -1, 1)))
        if deviation > np.pi - settings.max_deviation:
            raise ProbeError(f'the gravity pair points upwards ({np.degrees(deviation):.0f} degrees from the expected direction); '
                             'upper and lower are swapped, delete one and take both again')
        if deviation > settings.max_deviation:
            raise ProbeError(f'the gravity pair is horizontal: {np.degrees(deviation):.0f} degrees from the expected direction, '
                             f'allowed are {np.degrees(settings.max_deviation):.0f}; hold the tip vertically above the '
                             'first position')
    return down
