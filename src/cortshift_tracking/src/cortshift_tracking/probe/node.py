"""The probe node: services around probe.py. Tip positions come from tf at the samples' own stamps."""
import threading
import time

import numpy as np
import rospy
import tf2_ros
from cortshift_msgs.msg import ProbePoint as ProbePointMessage
from cortshift_msgs.srv import (DeletePoint, DeletePointResponse, DigitizeGravity, DigitizeGravityResponse, DigitizePoint,
                                DigitizePointResponse, ListPoints, ListPointsResponse, ListStages, SetGravity)
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Vector3
from tf2_msgs.msg import TFMessage

from cortshift_tracking.errors import CortshiftError, ProbeError
from cortshift_tracking.parameters import Number, ParameterError, read_parameters, settings_from
from cortshift_tracking.poses import rotation_from_message
from cortshift_tracking.probe.points import (GRAVITY_LABELS, GravitySettings, ProbePoint, StillSettings, check_key, gravity_direction,
                                      still_point)
from cortshift_tracking.probe.store import ProbeStore
from cortshift_tracking.tracker_state import NOT_KNOWN, TRACKER_STATE

ROOT_FRAME = 'pmr'
BACK = 1.0    # s by which a stamp lies before the last one where time has begun anew
RETRY = 10.0  # s after which gravity is offered again to a shift_tracker that did not take it
STILL, GRAVITY = StillSettings(), GravitySettings()
PARAMETERS = {
    'tip_frame': 'probe_tip',
    'timeout': Number(3.0, 0.5, 60.0),                # wall time to wait for the samples of a window [s]
    'window': Number(STILL.window, 0.2, 10.0),        # [s]
    'min_samples': Number(STILL.min_samples, 3, 1000),
    'max_gap': Number(STILL.max_gap, 0.01, 2.0),      # [s]
    'max_spread': Number(STILL.max_spread, 1e-5, 0.01),  # [m]
    'max_drift': Number(STILL.max_drift, 1e-5, 0.01),    # [m]
    'min_length': Number(GRAVITY.min_length, 0.01, 0.5),  # [m]
    'max_length': Number(GRAVITY.max_length, 0.1, 5.0),   # [m]
    'max_deviation': Number(GRAVITY.max_deviation, 0.1, 1.5),  # [rad]
    # A direction that is roughly downwards, to tell a horizontal gravity pair: the microscope looks down. Frame '': no check.
    'expected_down_frame': 'left_optical',
    'expected_down': [0.0, 0.0, 1.0],
}


class ProbeNode:
    """Services ~digitize_point, ~digitize_gravity, ~list_points, ~delete_point; see the .srv files.

    Parameters   case (text, required): folder of the case; PARAMETERS above
    Subscribes   /tf (reference -> probe_tip and what links reference to pmr), /tf_static
                 /diagnostics (whether shift_tracker knows gravity: it is told whenever it does not)
    Calls        /shift_tracker/list_stages, /shift_tracker/set_gravity
    Publishes    /diagnostics
    """

    def __init__(self):
        self._values = read_parameters(PARAMETERS, required=('case',))
        self._still = settings_from(StillSettings, self._values)
        self._gravity = settings_from(GravitySettings, self._values)
        self._store = ProbeStore(self._values['case'])
        if self._store.set_aside:
            rospy.logerr(self._store.set_aside)
        self._lock = threading.Lock()
        self._stamps = []
        self._arrival = threading.Condition()
        self._buffer = tf2_ros.Buffer(rospy.Duration(30.0))
        self._listener = tf2_ros.TransformListener(self._buffer)
        rospy.Subscriber('/tf', TFMessage, self._note_tip, queue_size=100)
        self._diagnostics = rospy.Publisher('/diagnostics', DiagnosticArray, queue_size=5)
        self._last_message = 'no request yet'
        self._untold, self._told_at = False, 0.0  # gravity that shift_tracker did not take; when it was last offered
        rospy.Subscriber('/diagnostics', DiagnosticArray, self._note_tracker, queue_size=20)
        rospy.Service('~digitize_point', DigitizePoint, self._digitize_point)
        rospy.Service('~digitize_gravity', DigitizeGravity, self._digitize_gravity)
        rospy.Service('~list_points', ListPoints, lambda _: ListPointsResponse([to_message(p) for p in self._store.points]))
        rospy.Service('~delete_point', DeletePoint, self._delete_point)
        self._timer = threading.Thread(target=self._report, daemon=True)
        self._timer.start()

    # ---- services

    def _digitize_point(self, request):
        try:
            with self._lock:
                check_key('label', request.label)
                check_key('stage', request.stage)
                stages = self._stages()
                if request.stage not in stages:
                    raise ProbeError(f'no stage "{request.stage}"; capture it first. There are: {", ".join(stages) or "none"}')
                if self._store.find(request.stage, request.label):
                    raise ProbeError(f'point "{request.label}" of stage "{request.stage}" exists already; delete it first or '
                                     'take another label')
                point = self._measure(request.stage, request.label)
                self._store.add(point)
        except (CortshiftError, OSError) as error:
            return DigitizePointResponse(False, self._refused(f'point "{request.label}" not stored: {error}'),
                                         ProbePointMessage())
        return DigitizePointResponse(True, self._done(f'point {point.name} stored, spread {point.spread * 1000:.2f} mm over '
                                                      f'{point.samples} samples'), to_message(point))

    def _digitize_gravity(self, request):
        unknown = Vector3(*[float('nan')] * 3)
        try:
            with self._lock:
                if request.position not in GRAVITY_LABELS:
                    raise ProbeError(f'position "{request.position}" is not known; use upper or lower')
                label = GRAVITY_LABELS[request.position]
                if self._store.find('', label):
                    raise ProbeError(f'{label} was taken already; delete it first (delete_point, stage empty, label {label})')
                point = self._measure('', label)
                other = self._store.find('', GRAVITY_LABELS['lower' if request.position == 'upper' else 'upper'])
                down = None
                if other is not None:
                    pair = {request.position: point.position}
                    pair.setdefault('upper', other.position)
                    pair.setdefault('lower', other.position)
                    down = gravity_direction(pair['upper'], pair['lower'], self._expected_down(rospy.Time(*point.stamp)),
                                             self._gravity)
                self._store.add(point)
        except (CortshiftError, OSError) as error:
            return DigitizeGravityResponse(False, self._refused(f'gravity position not stored: {error}'), False, unknown)
        if down is None:
            return DigitizeGravityResponse(True, self._done(f'{label} stored; now take the other position'), False, unknown)
        return DigitizeGravityResponse(True, self._done(f'gravity known; {self._hand_over(down)}'), True, Vector3(*down))

    def _delete_point(self, request):
        try:
            with self._lock:
                self._store.delete(request.stage, request.label)
        except (CortshiftError, OSError) as error:
            return DeletePointResponse(False, self._refused(str(error)))
        return DeletePointResponse(True, self._done(f'point "{request.label}" of stage "{request.stage}" deleted'))

    # ---- measuring

    def _note_tip(self, message):
        for transform in message.transforms:
            if transform.child_frame_id.lstrip('/') == self._values['tip_frame']:
                with self._arrival:
                    if self._stamps and (self._stamps[-1] - transform.header.stamp).to_sec() > BACK:   # a replay that was started again
                        self._stamps.clear()
                    self._stamps.append(transform.header.stamp)
                    del self._stamps[:-2000]
                    self._arrival.notify_all()

    def _measure(self, stage, label):
        """The tip over a window that starts now. Stamps are the tracker's own; only the patience is wall time."""
        patience = time.monotonic() + self._values['timeout'] + self._still.window
        with self._arrival:
            before = self._stamps[-1] if self._stamps else None
            while time.monotonic() < patience:
                window = [s for s in self._stamps if before is None or s > before]
                if window and (window[-1] - window[0]).to_sec() >= self._still.window:
                    break
                self._arrival.wait(0.05)
            window = [s for s in self._stamps if before is None or s > before]
        end = rospy.Duration(self._still.window * 1.0001)
        stamps = [s for s in window if s - window[0] <= end]
        tips = np.array([self._tip_pmr(stamp) for stamp in stamps]).reshape(-1, 3)
        times = [(s - stamps[0]).to_sec() for s in stamps]
        position, spread = still_point(times, tips, self._still)
        middle = stamps[len(stamps) // 2]
        return ProbePoint(stage, label, (middle.secs, middle.nsecs), tuple(float(v) for v in position), spread, len(stamps))

    def _transform(self, frame, stamp):
        """Transform of `frame` in pmr at a stamp; the newest samples may still be on their way through tf."""
        try:
            return self._buffer.lookup_transform(ROOT_FRAME, frame, stamp, rospy.Duration(0.5)).transform
        except (tf2_ros.LookupException, tf2_ros.ConnectivityException, tf2_ros.ExtrapolationException,
                tf2_ros.InvalidArgumentException) as error:
            raise ProbeError(f'no transform from {frame} to {ROOT_FRAME} at {stamp.to_sec():.3f} ({error}); check the patient '
                             'registration and the tracker') from error

    def _tip_pmr(self, stamp):
        translation = self._transform(self._values['tip_frame'], stamp).translation
        return [translation.x, translation.y, translation.z]

    def _expected_down(self, stamp):
        """The roughly downward direction in pmr at a stamp, or None where none is configured."""
        if not self._values['expected_down_frame']:
            return None
        rotation = self._transform(self._values['expected_down_frame'], stamp).rotation
        return rotation_from_message(rotation).apply(self._values['expected_down'])

    # ---- the shift tracker

    def _stages(self):
        try:
            rospy.wait_for_service('shift_tracker/list_stages', timeout=2.0)
            return [stage.key for stage in rospy.ServiceProxy('shift_tracker/list_stages', ListStages)().stages]
        except (rospy.ROSException, rospy.ServiceException) as error:
            raise ProbeError(f'shift_tracker does not answer ({error}), so the stage cannot be checked; start it') from error

    def _note_tracker(self, message):
        """A shift_tracker that has started anew, or did not take gravity before, is told it."""
        for status in message.status:
            if status.name != (rospy.get_namespace() + TRACKER_STATE)[1:]:
                continue
            ignorant = any(v.key == 'gravity' and v.value == NOT_KNOWN for v in status.values)
            pair = self._store.gravity_pair()
            if (ignorant or self._untold) and not any(place is None for place in pair):
                if self._untold and time.monotonic() < self._told_at + RETRY:
                    continue
                self._done(self._hand_over(gravity_direction(*pair, settings=self._gravity)))

    def _hand_over(self, down):
        self._untold, self._told_at = True, time.monotonic()
        told = f'down is ({down[0]:.4f}, {down[1]:.4f}, {down[2]:.4f}) in {ROOT_FRAME}'
        try:
            answer = rospy.ServiceProxy('shift_tracker/set_gravity', SetGravity)(Vector3(*down))
        except (rospy.ROSException, rospy.ServiceException) as error:
            return f'{told}; but shift_tracker does not know it: {error}'
        self._untold = not answer.success
        return f'{told}; shift_tracker: {answer.message}'

    # ---- messages

    def _refused(self, message):
        rospy.logwarn(message)
        self._last_message = message
        return message

    def _done(self, message):
        rospy.loginfo(message)
        self._last_message = message
        return message

    def _report(self):
        seen = 0
        while not rospy.is_shutdown():
            with self._arrival:
                count = len(self._stamps) and self._stamps[-1].to_nsec()
            tracked = count != seen
            seen = count
            status = DiagnosticStatus(level=DiagnosticStatus.WARN if self._store.set_aside else DiagnosticStatus.OK,
                                      name=rospy.get_name()[1:] + ': tip', hardware_id='probe',
                                      message=self._store.set_aside or ('tip tracked' if tracked else 'tip not in view'),
                                      values=[KeyValue('points', str(len(self._store.points))),
                                              KeyValue('last answer', self._last_message)])
            array = DiagnosticArray(status=[status])
            array.header.stamp = rospy.Time.now()
            self._diagnostics.publish(array)
            time.sleep(1.0)


def to_message(point):
    return ProbePointMessage(stage=point.stage, label=point.label, stamp=rospy.Time(*point.stamp),
                             position=Point(*point.position_pmr), spread=point.spread, samples=point.samples)


def main():
    rospy.init_node('probe')
    try:
        node = ProbeNode()
    except (ParameterError, CortshiftError, OSError) as error:
        rospy.logfatal('probe does not start: %s', error)
        return 1
    rospy.spin()
    del node
    return 0
