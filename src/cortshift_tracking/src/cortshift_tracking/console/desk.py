"""What both surfaces of the surgeon's console share: requests to the graph, one at a time, and what is known of it."""
import re
import threading
import time
import traceback

import rospy
import yaml
from cortshift_msgs.msg import DisplacementField
from cortshift_msgs.srv import CaptureStage, ComputeShift, ListStages, SetOutline, SetPhantomStage, TrackShift
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point32, Polygon

from cortshift_tracking.console.drawing import Grid
from cortshift_tracking.console.graph_state import GraphState
from cortshift_tracking.console.worker import DeskError, Worker
from cortshift_tracking.summary_text import summary_lines

EXPECTED_COMPUTE = 3.0  # s, until the first shift has been computed
AUTOMATIC_KEY = re.compile(r'stage_(\d+)$')


def next_key(keys):
    """The automatic key of the next stage: stage_01, stage_02, ..., after the highest number in use."""
    numbers = [int(match.group(1)) for match in map(AUTOMATIC_KEY.match, keys) if match]
    return f'stage_{max(numbers, default=0) + 1:02d}'


class Desk:
    """Requests are queued and done in order by one thread; `status` never waits for them.

    Calls        /shift_tracker/capture_stage, list_stages, compute_shift, track, set_outline; /stereo_driver/set_stage (phantom only)
    Subscribes   /diagnostics, /shift/field
    """

    def __init__(self):
        self._call = {name: rospy.ServiceProxy(f'shift_tracker/{name}', kind) for name, kind in (
            ('capture_stage', CaptureStage), ('list_stages', ListStages), ('compute_shift', ComputeShift),
            ('track', TrackShift), ('set_outline', SetOutline))}
        self._set_phantom = rospy.ServiceProxy('stereo_driver/set_stage', SetPhantomStage)
        self._lock = threading.Lock()
        self._worker = Worker(rospy.logerr)
        self._graph = GraphState(namespace=rospy.get_namespace())
        self._compute_time = EXPECTED_COMPUTE
        self._stages = []
        self._phantom_left = None  # stages of the phantom's case still to come
        self._shift = ('', ())
        self._outlined = ''
        self._grids = {}           # of the pictures, by the key of the stage that they show
        rospy.Subscriber('shift/field', DisplacementField, self._keep_shift, queue_size=1, buff_size=1 << 26)
        rospy.Subscriber('/diagnostics', DiagnosticArray, self._graph.keep, queue_size=50)
        threading.Thread(target=self._watch, daemon=True).start()

    # ---- requests: each returns at once; DeskError where another one is under way

    def capture(self, note=''):
        self._ask('capturing', 4.0, self._capture, note)

    def compute_last_pair(self):
        self._ask('computing the shift of the last two stages', self._compute_time, self._compute)

    def set_live(self, on):
        self._ask('live mode ' + ('on' if on else 'off'), 1.0, self._track, on)

    def next_phantom_stage(self):
        self._ask('moving the phantom to its next stage', 8.0, self._move_phantom)

    def set_outline(self, key, line):
        """The outline of the brain on a stage, drawn on its picture: [(x, y)] in widths of the picture; empty: the automatic one."""
        with self._lock:
            grid = self._grids.get(key)
        if line and grid is None:
            raise DeskError(f"no picture of stage '{key}' is shown; compute a shift from it first")
        corners = grid.outline(line) if line else []
        self._ask('keeping the outline', 1.0, self._set_outline, key, corners)

    def _ask(self, what, expected, work, *arguments):
        def called():
            try:
                return work(*arguments)
            except rospy.ServiceException as error:
                raise DeskError(f'the request failed: {error}; check that the graph runs') from error
        self._worker.ask(what, expected, called)

    # ---- what is known

    @property
    def tracker(self):
        """What shift_tracker says of itself, as graph_state.TrackerState: what was asked for may be gone with a restart."""
        return self._graph.tracker()

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
    def outlined(self):
        """Key of the stage that the picture of the outline shows; '' where there is none yet."""
        with self._lock:
            return self._outlined

    @property
    def activity(self):
        return self._worker.activity

    def progress(self):
        return self._worker.progress()

    def coverage(self):
        return self._graph.coverage()

    def warnings(self):
        return self._graph.warnings()

    # ---- threads

    def _keep_shift(self, field):
        to_key = field.to_key or time.strftime('live, %H:%M:%S', time.localtime(field.to_stamp.to_sec()))
        with self._lock:
            self._shift = (f'{field.from_key} → {to_key}', tuple(summary_lines(field.summary)))
            self._grids[field.from_key] = Grid(field.points.width, field.points.height, field.resolution)
            self._outlined = field.from_key

    def _watch(self):
        while not rospy.is_shutdown():
            try:
                self._graph.keep_restarts(rospy.get_param('restarts', {}))
                stages = self._call['list_stages']().stages
                with self._lock:
                    self._stages = stages
                if self.phantom_stages_left is None:
                    self._find_phantom()
            except rospy.ServiceException:
                pass  # the warnings say that the node is silent
            except Exception:  # the next look may go well, and must be taken
                rospy.logerr('the console cannot look at the graph: %s', traceback.format_exc())
            time.sleep(1.0)

    def _find_phantom(self):
        try:
            self._set_phantom.wait_for_service(timeout=0.1)
            with open(rospy.get_param('stereo_driver/phantom_case'), encoding='utf-8') as file:
                names = [stage['name'] for stage in yaml.safe_load(file)['stages']]
            first = rospy.get_param('stereo_driver/stage', '') or names[0]
        except (rospy.ROSException, KeyError, OSError, ValueError):
            return  # no phantom
        with self._lock:
            self._phantom_left = names[names.index(first) + 1:]

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
        return answer.message, ()

    def _set_outline(self, key, corners):
        brain = [Polygon([Point32(x, y, 0) for x, y in corners])] if corners else []
        return self._accepted(self._call['set_outline'](key, brain)).message, ()

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
