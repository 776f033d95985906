"""What the tests of the running graph share: calling its services and reading its fields."""
import os
import signal
import subprocess
import time

import numpy as np
import rosbag
import roslaunch
import roslaunch.xmlloader
import rospy
from cortshift_msgs.msg import DisplacementField
from cortshift_msgs.srv import (CaptureMeanStage, CaptureStage, ComputeShift, DeleteStage, ExcludeRegions, ListStages,
                                SetGravity, SetOutline, TrackShift)
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from programs import program
from rosgraph_msgs.msg import Clock

SERVICES = {'capture_stage': CaptureStage, 'capture_mean_stage': CaptureMeanStage, 'compute_shift': ComputeShift,
            'delete_stage': DeleteStage, 'exclude_regions': ExcludeRegions, 'list_stages': ListStages,
            'set_gravity': SetGravity, 'set_outline': SetOutline, 'track': TrackShift}


def wait_until(condition, seconds, what):
    """Wait in wall time, since simulated time may stand still. Raises AssertionError naming what did not happen."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f'{what} did not happen within {seconds} s')
        time.sleep(0.05)


class ShiftTracker:
    """The services of shift_tracker as methods: tracker.capture_stage('key', note='')."""

    def __init__(self, seconds=60, namespace=''):
        for name, kind in SERVICES.items():
            rospy.wait_for_service(f'{namespace}/shift_tracker/{name}', timeout=seconds)
            setattr(self, name, rospy.ServiceProxy(f'{namespace}/shift_tracker/{name}', kind))
        self._fields = {}
        rospy.Subscriber(f'{namespace}/shift/field', DisplacementField, self._keep)

    def _keep(self, field):
        self._fields[field.from_key, field.to_key] = field

    def field(self, from_key, to_key):
        wait_until(lambda: (from_key, to_key) in self._fields, 20, f'/shift/field {from_key} -> {to_key}')
        return self._fields[from_key, to_key]


def field_arrays(field):
    """Start (H, W, 3), displacement (H, W, 3) [m] and confidence (H, W) of a DisplacementField."""
    cloud = field.points
    offsets = {f.name: f.offset for f in cloud.fields}
    raw = np.frombuffer(cloud.data, np.uint8).reshape(cloud.height, cloud.row_step)[:, :cloud.width * cloud.point_step]
    raw = raw.reshape(cloud.height, cloud.width, cloud.point_step)

    def read(*names):
        columns = [np.ascontiguousarray(raw[..., offsets[n]:offsets[n] + 4]).view(np.float32)[..., 0] for n in names]
        return np.stack(columns, axis=-1).astype(float)
    return read('x', 'y', 'z'), read('dx', 'dy', 'dz'), read('confidence')[..., 0]


def error_of_phantom_field(case, from_stage, to_stage, field, folder):
    """What the tool field_error says of a field, as {name: number}: error_median_mm, error_p95_mm, coverage, ..."""
    path = os.path.join(folder, f'{field.from_key}__{field.to_key}.bag')
    with rosbag.Bag(path, 'w') as bag:
        bag.write('/shift/field', field, field.header.stamp)
    output = subprocess.run([program('field_error'), '--case', case, '--from', from_stage, '--to',
                             to_stage, path], check=True, capture_output=True, text=True).stdout
    print(f'{from_stage} -> {to_stage}:', output.replace('\n', '; '))
    return {name: float(value) for name, value in (line.split(': ') for line in output.splitlines())}


class Player:
    """`rosbag play --clock` beside the test; `clock` follows simulated seconds."""

    def __init__(self, bag):
        self.clock = 0.0
        rospy.Subscriber('/clock', Clock, lambda message: setattr(self, 'clock', message.clock.to_sec()))
        self._process = subprocess.Popen(['rosbag', 'play', '--quiet', '--clock', '--delay', '2', bag])

    def wait_for(self, seconds):
        wait_until(lambda: self.clock >= seconds, 120, f'simulated time {seconds}')

    def stop(self):
        self._process.terminate()
        self._process.wait(timeout=20)


class Diagnostics:
    """The newest status of each name on /diagnostics, with the time [s, monotonic] of its arrival."""

    def __init__(self):
        self._seen = {}
        rospy.Subscriber('/diagnostics', DiagnosticArray, self._keep, queue_size=50)

    def _keep(self, message):
        for status in message.status:
            self._seen[status.name] = (time.monotonic(), status)

    def values(self, name):
        """Values of a status as a dictionary, with its text as 'message'; empty where it has not been heard of."""
        status = self._seen.get(name, (0, DiagnosticStatus()))[1]
        return {'message': status.message, **{v.key: v.value for v in status.values}}

    def wait_for(self, name, seconds=30, **expected):
        """Wait until a status that is sent from now on has values that contain the expected texts ('' : is empty)."""
        began = time.monotonic()

        def so():
            values = self.values(name)
            return self._seen.get(name, (0,))[0] > began and all(
                text in values.get(key, '') if text else values.get(key) == '' for key, text in expected.items())
        try:
            wait_until(so, seconds, f'{name} with {expected}')
        except AssertionError as error:
            raise AssertionError(f'{error}: {self.values(name)}') from None
        return self.values(name)


class TrackerProcess:
    """A shift_tracker that a test starts, kills and starts again."""

    def start(self, **parameters):
        """With these parameters of the node and no others."""
        if rospy.has_param('/shift_tracker'):
            rospy.delete_param('/shift_tracker')
        for name, value in parameters.items():
            rospy.set_param(f'/shift_tracker/{name}', value)
        self._process = subprocess.Popen([program('shift_tracker')])
        return ShiftTracker()

    def is_running(self):
        return self._process.poll() is None

    def end(self, number=signal.SIGINT):
        """Sends a signal and returns the exit status."""
        self._process.send_signal(number)
        return self._process.wait(timeout=60)


def loaded(launch, *arguments):
    """What roslaunch makes of a launch file, without the master's own, whose command takes most of the time."""
    config = roslaunch.config.ROSLaunchConfig()
    roslaunch.xmlloader.XmlLoader().load(str(launch), config, argv=list(arguments), verbose=False)
    return config
