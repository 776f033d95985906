"""What the nodes' diagnostics say of the graph. No ROS but the messages."""
import threading
import time
from dataclasses import dataclass
from typing import Optional, Tuple

from diagnostic_msgs.msg import DiagnosticStatus

from cortshift_tracking.tracker_state import NOT_KNOWN, TRACKER_STATE

SILENCE = 4.0          # s without diagnostics after which a node counts as silent
NODES = ('stereo_driver', 'surface_reconstruction', 'shift_tracker')


@dataclass(frozen=True)
class TrackerState:
    """What shift_tracker works with, in its own words; None: it does not say."""
    live_from: Optional[str] = None               # key of the stage that live mode starts from; '': off
    gravity_known: Optional[bool] = None
    exclusions: Optional[Tuple[str, ...]] = None  # keys of the stages that regions are excluded from

    @property
    def live(self):
        """Whether live mode is on; None: not known."""
        return None if self.live_from is None else bool(self.live_from)

    @property
    def gravity(self):
        return {None: 'unknown', False: 'not known', True: 'known'}[self.gravity_known]


class GraphState:
    """The newest diagnostics by the name of their status. What is older than SILENCE counts no more."""

    def __init__(self, clock=time.monotonic):
        self._lock, self._clock = threading.Lock(), clock
        self._known = {}  # status name: (DiagnosticStatus, time of arrival)

    def keep(self, message):
        """A diagnostic_msgs/DiagnosticArray."""
        now = self._clock()
        with self._lock:
            for status in message.status:
                self._known[status.name] = (status, now)

    def _fresh(self):
        """(all, those not older than SILENCE) as {name: (status, age [s])}."""
        with self._lock:
            known = dict(self._known)
        now = self._clock()
        every = {name: (status, now - arrived) for name, (status, arrived) in known.items()}
        return every, {name: entry for name, entry in every.items() if entry[1] <= SILENCE}

    def coverage(self):
        """Share of the image with a surface point in the last surface, 0-1; None where not known."""
        _, fresh = self._fresh()
        if 'surface_reconstruction: surface' not in fresh:
            return None
        try:
            return float(next(v.value for v in fresh['surface_reconstruction: surface'][0].values if v.key == 'coverage'))
        except (StopIteration, ValueError):
            return None

    def tracker(self):
        """TrackerState as of the last seconds."""
        _, fresh = self._fresh()
        if TRACKER_STATE not in fresh:
            return TrackerState()
        said = {pair.key: pair.value for pair in fresh[TRACKER_STATE][0].values}
        live = said.get('live_from') if said.get('live') != 'off' else ''
        gravity, exclusions = said.get('gravity'), said.get('excluded_stages')
        return TrackerState(live, None if gravity is None else gravity != NOT_KNOWN,
                            None if exclusions is None else tuple(exclusions.replace(',', ' ').split()))

    def warnings(self):
        """Everything that is not as it should be, as texts. A node that says nothing is not as it should be."""
        every, fresh = self._fresh()
        found = []
        for node in NODES:
            ages = [age for name, (_, age) in every.items() if name.split(':')[0] == node]
            if not ages:
                found.append(f'nothing is heard of {node}')
            elif min(ages) > SILENCE:
                found.append(f'nothing is heard of {node} for {min(ages):.0f} s')
        found += [f'{name}: {status.message}' for name, (status, _) in sorted(fresh.items()) if status.level != DiagnosticStatus.OK]
        return found
