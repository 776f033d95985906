"""What both surfaces of the surgeon's console share: requests to the graph, one at a time, and what is known of it."""
import queue
import re
import threading
import time
from dataclasses import dataclass

import rospy
import yaml
from cortshift_msgs.msg import DisplacementField
from cortshift_msgs.srv import CaptureStage, ComputeShift, ListStages, SetPhantomStage, TrackShift
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from cortshift_tracking.errors import CortshiftError

SILENCE = 4.0          # s without diagnostics after which a node counts as silent
EXPECTED_COMPUTE = 3.0  # s, until the first shift has been computed
NODES = ('stereo_driver', 'surface_reconstruction', 'shift_tracker')
KEY = re.compile(r'stage_(\d+)$')
LEVELS = {DiagnosticStatus.OK: 'ok', DiagnosticStatus.WARN: 'warning', DiagnosticStatus.ERROR: 'error',
          DiagnosticStatus.STALE: 'stale'}


class DeskError(CortshiftError):
    """A request that cannot be fulfilled; the message says why and what to do."""


def next_key(keys):
    """The automatic key of the next stage: stage_01, stage_02, ..., after the highest number in use."""
    numbers = [int(match.group(1)) for match in map(KEY.match, keys) if match]
    return f'stage_{max(numbers, default=0) + 1:02d}'


def in_mm(mean, sd):
    return f'{1000 * mean:.2f} ± {1000 * sd:.2f} mm'


def summary_lines(summary):
    """The numbers of a ShiftSummary for a person, as (name, text); what is not known is left out."""
    lines = [('magnitude', in_mm(summary.magnitude_mean, summary.magnitude_sd)),
             ('along gravity', in_mm(summary.gravity_mean, summary.gravity_sd)),
             ('along the normal', in_mm(summary.normal_mean, summary.normal_sd)),
             ('lateral', in_mm(summary.lateral_mean, summary.lateral_sd)),
             ('overlap', f'{100 * summary.overlap:.0f} %')]
    return [(name, text) for name, text in lines if 'nan' not in text]


@dataclass
class Activity:
    """The request under way, or the last one."""
    what: str = 'nothing yet'
    busy: bool = False
    success: bool = True
    message: str = ''
    started: float = 0.0
    expected: float = 0.0  # s
    summary: tuple = ()


class Desk:
    """Requests are queued and done in order by one thread; `status` never waits for them.

    Calls        /shift_tracker/capture_stage, list_stages, compute_shift, track; /stereo_driver/set_stage (phantom only)
    Subscribes   /diagnostics, /shift/field
    """

    def __init__(self):
        self._call = {name: rospy.ServiceProxy(f'/shift_tracker/{name}', kind) for name, kind in (
            ('capture_stage', CaptureStage), ('list_stages', ListStages), ('compute_shift', ComputeShift),
            ('track', TrackShift))}
        self._set_phantom = rospy.ServiceProxy('/stereo_driver/set_stage', SetPhantomStage)
        self._lock = threading.Lock()
        self._activity = Activity()
        self._live = False
        self._compute_time = EXPECTED_COMPUTE
        self._stages = []
        self._phantom_left = None  # stages of the phantom's case still to come
        self._diagnostics = {}     # status name: (DiagnosticStatus, time of arrival)
        self._requests = queue.Queue()
        self._shift = ('', ())
        rospy.Subscriber('/shift/field', DisplacementField, self._keep_shift, queue_size=1, buff_size=1 << 26)
        rospy.Subscriber('/diagnostics', DiagnosticArray, self._keep, queue_size=50)
        for work in (self._serve, self._watch):
            threading.Thread(target=work, daemon=True).start()

    # ---- requests: each returns at once; DeskError where another one is under way

    def capture(self, note=''):
        self._ask('capturing', 4.0, self._capture, note)

    def compute_last_pair(self):
        self._ask('computing the shift of the last two stages', self._compute_time, self._compute)

    def set_live(self, on):
        self._ask('live mode ' + ('on' if on else 'off'), 1.0, self._track, on)

    def next_phantom_stage(self):
        self._ask('moving the phantom to its next stage', 8.0, self._move_phantom)

    def _ask(self, what, expected, work, *arguments):
        with self._lock:
            if self._activity.busy:
                raise DeskError(f'{self._activity.what} is still under way; try again when it is done')
            self._activity = Activity(what, True, started=time.monotonic(), expected=expected)
        self._requests.put((work, arguments))

    # ---- what is known

    @property
    def live(self):
        with self._lock:
            return self._live

    @property
    def stages(self):
        """StageInfo of every stage, in order of capture, as of a second ago."""
        with self._lock:
            return list(self._stages)

    @property
    def phantom_stages_left(self):
        """Names of the phantom's stages still to come; None without a phantom."""
        with self._lock:
            return None if self._phantom_left is None else list(self._phantom_left)

    @property
    def shift(self):
        """Of the newest field, live or asked for: ("from → to", numbers as of summary_lines)."""
        with self._lock:
            return self._shift

    @property
    def activity(self):
        with self._lock:
            return self._activity

    def progress(self):
        """Share of the request under way that should be done by now, 0-1; the last part is never promised."""
        activity = self.activity
        if not activity.busy:
            return 1.0
        return min(0.95, (time.monotonic() - activity.started) / max(activity.expected, 0.1))

    def coverage(self):
        """Share of the image with a surface point in the last surface, 0-1; None where not known."""
        with self._lock:
            status, arrived = self._diagnostics.get('surface_reconstruction: surface', (None, 0))
        if status is None or time.monotonic() - arrived > SILENCE:
            return None
        try:
            return float(next(v.value for v in status.values if v.key == 'coverage'))
        except (StopIteration, ValueError):
            return None

    def warnings(self):
        """Everything that is not as it should be, as texts. A node that says nothing is not as it should be."""
        with self._lock:
            known = dict(self._diagnostics)
        now = time.monotonic()
        found = []
        for node in NODES:
            ages = [now - arrived for name, (_, arrived) in known.items() if name.split(':')[0] == node]
            if not ages:
                found.append(f'nothing is heard of {node}')
            elif min(ages) > SILENCE:
                found.append(f'nothing is heard of {node} for {min(ages):.0f} s')
        for name, (status, arrived) in sorted(known.items()):
            if status.level != DiagnosticStatus.OK and now - arrived <= SILENCE:
                found.append(f'{name}: {status.message}')
        return found

    # ---- threads

    def _keep(self, message):
        now = time.monotonic()
        with self._lock:
            for status in message.status:
                self._diagnostics[status.name] = (status, now)

    def _keep_shift(self, field):
        to_key = field.to_key or time.strftime('live, %H:%M:%S', time.localtime(field.to_stamp.to_sec()))
        with self._lock:
            self._shift = (f'{field.from_key} → {to_key}', tuple(summary_lines(field.summary)))

    def _watch(self):
        while not rospy.is_shutdown():
            try:
                stages = self._call['list_stages']().stages
                with self._lock:
                    self._stages = stages
            except rospy.ServiceException:
                pass  # the warnings say that the node is silent
            if self._phantom_left is None:
                self._find_phantom()
            time.sleep(1.0)

    def _find_phantom(self):
        try:
            self._set_phantom.wait_for_service(timeout=0.1)
            with open(rospy.get_param('/stereo_driver/phantom_case')) as file:
                names = [stage['name'] for stage in yaml.safe_load(file)['stages']]
            first = rospy.get_param('/stereo_driver/stage', '') or names[0]
        except (rospy.ROSException, KeyError, OSError, ValueError):
            return  # no phantom
        with self._lock:
            self._phantom_left = names[names.index(first) + 1:]

    def _serve(self):
        while not rospy.is_shutdown():
            try:
                work, arguments = self._requests.get(timeout=0.5)
            except queue.Empty:
                continue
            try:
                message, summary = work(*arguments)
                success = True
            except DeskError as error:
                success, message, summary = False, str(error), ()
            except rospy.ServiceException as error:
                success, message, summary = False, f'the request failed: {error}; check that the graph runs', ()
            with self._lock:
                what = self._activity.what
                self._activity = Activity(what, False, success, message, summary=summary)

    @staticmethod
    def _accepted(answer):
        if not answer.success:
            raise DeskError(answer.message)
        return answer

    def _capture(self, note):
        keys = [stage.key for stage in self._call['list_stages']().stages]
        answer = self._accepted(self._call['capture_stage'](next_key(keys), note))
        with self._lock:
            self._stages = self._call['list_stages']().stages
        return answer.message, ()

    def _compute(self):
        stages = self._call['list_stages']().stages
        if len(stages) < 2:
            raise DeskError(f'a shift needs two stages and there {"is one" if stages else "is none"}; capture first')
        started = time.monotonic()
        answer = self._accepted(self._call['compute_shift'](stages[-2].key, stages[-1].key))
        self._compute_time = time.monotonic() - started
        return answer.message, tuple(summary_lines(answer.summary))

    def _track(self, on):
        stages = self._call['list_stages']().stages
        if on and not stages:
            raise DeskError('live mode needs a stage to start from; capture one first')
        newest = stages[-1].epoch if stages else 0
        first = next((s.key for s in stages if s.epoch == newest), '')
        answer = self._accepted(self._call['track'](first, on))
        with self._lock:
            self._live = on
        return answer.message, ()

    def _move_phantom(self):
        left = self.phantom_stages_left
        if left is None:
            raise DeskError('there is no phantom in this graph')
        if not left:
            raise DeskError('the phantom is at the last stage of its case')
        answer = self._accepted(self._set_phantom(left[0]))
        with self._lock:
            self._phantom_left = left[1:]
        return answer.message, ()
