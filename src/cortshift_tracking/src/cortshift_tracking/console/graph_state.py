"""What the nodes' diagnostics say of the graph. No ROS but the messages."""
import threading
import time
from dataclasses import dataclass
from typing import Optional, Tuple

from diagnostic_msgs.msg import DiagnosticStatus

from cortshift_tracking.tracker_state import NOT_KNOWN, TRACKER_STATE

SILENCE = 4.0          # s without diagnostics after which a node counts as silent
RESTART_SHOWN = 30.0   # s that a node's being started again is shown
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


def ordinal(number):
    """1st, 2nd, 3rd, 4th, 11th, ..."""
    ending = 'th' if number % 100 in (11, 12, 13) else {1: 'st', 2: 'nd', 3: 'rd'}.get(number % 10, 'th')
    return f'{number}{ending}'


class GraphState:
    """The newest diagnostics by the name of their status. What is older than SILENCE counts no more."""

    def __init__(self, clock=time.monotonic, namespace='/', wall_clock=time.time):
        """namespace: of the graph; under one master there may be others, whose nodes are not ours."""
        self._space = namespace.strip('/') + '/' if namespace.strip('/') else ''
        self._lock, self._clock, self._wall_clock = threading.Lock(), clock, wall_clock
        self._restarts = {}
        self._known = {}  # status name: (DiagnosticStatus, time of arrival)

    def keep(self, message):
        """A diagnostic_msgs/DiagnosticArray."""
        now = self._clock()
        with self._lock:
            for status in message.status:
                if status.name.startswith(self._space):
                    self._known[status.name[len(self._space):]] = (status, now)

    def keep_restarts(self, restarts):
        """The parameter `restarts`, which script/supervise sets: {node: {'count', 'why', 'time'}}."""
        with self._lock:
            self._restarts = dict(restarts)

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
        with self._lock:
            restarts = sorted(self._restarts.items())
        for node, restart in restarts:
            if self._wall_clock() - restart['time'] <= RESTART_SHOWN:
                found.append(f'{node} is started again ({restart["why"]}); in this launch for the {ordinal(restart["count"])} time')
        found += [f'{name}: {status.message}' for name, (status, _) in sorted(fresh.items()) if status.level != DiagnosticStatus.OK]
        return found
