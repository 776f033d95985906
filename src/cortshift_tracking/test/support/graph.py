"""What the tests of the running graph share: calling its services and reading its fields."""
import os
import subprocess
import time

import numpy as np
import rosbag
import rospy
from cortshift_msgs.msg import DisplacementField
from cortshift_msgs.srv import CaptureStage, ComputeShift, DeleteStage, ListStages
from rosgraph_msgs.msg import Clock

SERVICES = {'capture_stage': CaptureStage, 'compute_shift': ComputeShift, 'delete_stage': DeleteStage,
            'list_stages': ListStages}


def wait_until(condition, seconds, what):
    """Wait in wall time, since simulated time may stand still. Raises AssertionError naming what did not happen."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f'{what} did not happen within {seconds} s')
        time.sleep(0.05)


class ShiftTracker:
    """The services of shift_tracker as methods: tracker.capture_stage('key', note='')."""

    def __init__(self, seconds=60):
        for name, kind in SERVICES.items():
            rospy.wait_for_service(f'/shift_tracker/{name}', timeout=seconds)
            setattr(self, name, rospy.ServiceProxy(f'/shift_tracker/{name}', kind))
        self._fields = {}
        rospy.Subscriber('/shift/field', DisplacementField, self._keep)

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
    output = subprocess.run(['rosrun', 'cortshift_tracking', 'field_error', '--case', case, '--from', from_stage, '--to',
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
