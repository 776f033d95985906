"""Single faults for a recorded case: what people in this field have met.

Each is a function of (entries, random) -> entries (see changes.py); it may change the messages. FAULTS holds them by name.
"""
import copy

import cv2
import genpy
import numpy as np
import tf2_msgs.msg
from changes import (BRIDGE, CAPTURED, a_capture, begin_of, change_images, direction, edges, images, later_half, move, pixels,
                     seconds)

FAULTS = {}


def fault(function):
    FAULTS[function.__name__] = function
    return function


# ---- poses

@fault
def pose_jumps_at_exposure(entries, random):
    at, vector = begin_of(entries) + a_capture(random), random.uniform(0.0005, 0.008) * direction(random)
    reach = random.choice([0.03, 0.08, 0.15])
    for time, _, edge in edges(entries, 'microscope'):
        if abs(time.to_sec() - at) <= reach:
            move(edge, vector)
    return entries


@fault
def pose_of_two_publishers(entries, random):
    vector, since = random.uniform(0.0005, 0.008) * direction(random), random.choice([0, later_half(entries)])
    delay = genpy.Duration.from_sec(random.uniform(0.002, 0.045))
    other = []
    for time, message, edge in edges(entries, 'microscope'):
        if time.to_sec() < since:
            continue
        second = copy.deepcopy(edge)
        second.header.stamp += delay
        move(second, vector)
        other.append(['/tf', tf2_msgs.msg.TFMessage([second]), time + delay])
    return entries + other


@fault
def pose_trembles(entries, random):
    sd = random.uniform(0.0005, 0.003)
    for _, _, edge in edges(entries, 'microscope'):
        move(edge, sd * random.normal(size=3))
    return entries


@fault
def pose_stands_still(entries, random):
    """The tracker repeats, with new stamps, what it said before the microscope was moved."""
    since, last = begin_of(entries) + random.uniform(1, 6), None
    for time, _, edge in edges(entries, 'microscope'):
        if time.to_sec() >= since:
            last = last or copy.deepcopy(edge.transform)
            edge.transform = copy.deepcopy(last)
    return entries


@fault
def pose_goes_back(entries, random):
    """Around the later exposure the tracker says the pose of the earlier one again."""
    begin, reach, earlier = begin_of(entries), random.uniform(0.3, 3), None
    for time, _, edge in edges(entries, 'microscope'):
        if earlier is None and time.to_sec() - begin >= CAPTURED[0]:
            earlier = copy.deepcopy(edge.transform)
        if abs(time.to_sec() - begin - CAPTURED[1]) <= reach:
            edge.transform = copy.deepcopy(earlier)
    return entries


@fault
def pose_fixed_and_moving(entries, random):
    begin, which = begin_of(entries), a_capture(random)
    pose = next(copy.deepcopy(edge) for time, _, edge in edges(entries, 'microscope') if time.to_sec() - begin >= which)
    return entries + [['/tf_static', tf2_msgs.msg.TFMessage([pose]), seconds(begin + 0.001)]]


@fault
def pose_not_rigid(entries, random):
    how = random.integers(3)
    for _, _, edge in edges(entries, 'microscope'):
        q = edge.transform.rotation
        if how == 0:
            q.w *= 1.05
        elif how == 1:
            q.x = q.y = q.z = q.w = 0
        else:
            edge.transform.translation.x = float('nan')
    return entries


@fault
def pose_missing(entries, random):
    at, reach = begin_of(entries) + a_capture(random), random.uniform(0.2, 3)
    return [entry for entry in entries if entry[0] != '/tf' or abs(entry[2].to_sec() - at) > reach]


@fault
def pose_clock_off(entries, random):
    """The tracker stamps by another clock than everything else."""
    off = genpy.Duration.from_sec(random.choice([-1, 1]) * random.uniform(0.4, 6))
    for _, _, edge in edges(entries, 'microscope'):
        edge.header.stamp += off
    return entries


# ---- calibration and registration

def changed_edge(entries, random, child, low, high):
    """A fixed edge that becomes another one between the two stages."""
    edge = next(copy.deepcopy(edge) for _, _, edge in edges(entries, child, '/tf_static'))
    move(edge, random.uniform(low, high) * direction(random))
    return entries + [['/tf_static', tf2_msgs.msg.TFMessage([edge]), seconds(later_half(entries))]]


@fault
def hand_eye_changes(entries, random):
    return changed_edge(entries, random, 'left_optical', 0.0003, 0.005)


@fault
def stereo_edge_changes(entries, random):
    return changed_edge(entries, random, 'right_optical', 0.0003, 0.005)


@fault
def registration_changes(entries, random):
    return changed_edge(entries, random, 'reference', 0.0003, 0.005)


@fault
def hand_eye_of_two_publishers(entries, random):
    edge = next(copy.deepcopy(edge) for _, _, edge in edges(entries, 'left_optical', '/tf_static'))
    move(edge, random.uniform(0.001, 0.005) * direction(random))
    first = next(time for time, _, _ in edges(entries, 'left_optical', '/tf_static'))
    return entries + [['/tf_static', tf2_msgs.msg.TFMessage([edge]), first + genpy.Duration.from_sec(random.uniform(0.01, 0.25))]]


def infos(entries, side, since=0):
    return [message for topic, message, time in entries
            if topic == f'/stereo/{side}/camera_info' and time.to_sec() >= since]


@fault
def baseline_of_two_truths(entries, random):
    factor = random.choice([random.uniform(0.8, 0.97), random.uniform(1.03, 1.2)])
    for message in infos(entries, 'right'):
        message.P = [factor * value if k == 3 else value for k, value in enumerate(message.P)]
    return entries


@fault
def camera_info_changes(entries, random):
    factor = random.uniform(1.0005, 1.01)
    for side in ('left', 'right'):
        for message in infos(entries, side, later_half(entries)):
            message.K = [factor * value if k in (0, 4) else value for k, value in enumerate(message.K)]
    return entries


@fault
def camera_infos_exchanged(entries, _):
    for entry in entries:
        if entry[0].endswith('/camera_info'):
            entry[0] = entry[0].replace('left', 'RIGHT').replace('right', 'left').replace('RIGHT', 'right')
    return entries


# ---- setting

@fault
def setting_not_told(entries, _):
    return [entry for entry in entries if entry[0] != '/microscope/settings']


@fault
def setting_none_first(entries, _):
    """A driver that says no numbers until the microscope answers, after the first pair."""
    first = next(n for n, entry in enumerate(entries) if entry[0] == '/microscope/settings')
    topic, message, time = entries[first]
    answer = copy.deepcopy(message)
    message.magnification = message.focal_length = float('nan')
    answer.header.stamp += genpy.Duration(4)
    return sorted([*entries, [topic, answer, time + genpy.Duration(4)]], key=lambda entry: entry[2])


@fault
def setting_not_calibrated(entries, random):
    for topic, message, time in entries:
        if topic == '/microscope/settings' and time.to_sec() > later_half(entries) - 2:
            message.magnification *= random.uniform(1.05, 1.6)
    return entries


# ---- images

@fault
def image_blank(entries, random):
    grey = int(random.integers(0, 255))
    return change_images(entries, [random.choice(['left', 'right'])], lambda image: np.full_like(image, grey))


@fault
def image_out_of_focus(entries, random):
    sigma = random.uniform(3, 8)
    return change_images(entries, ['left', 'right'], lambda image: cv2.GaussianBlur(image, (0, 0), sigma))


@fault
def image_exchanged(entries, _):
    for entry in images(entries):
        entry[0] = entry[0].replace('left', 'RIGHT').replace('right', 'left').replace('RIGHT', 'right')
    return entries


@fault
def image_rows_off(entries, random):
    rows = int(random.choice([-1, 1]) * random.integers(3, 20))
    return change_images(entries, ['right'], lambda image: np.roll(image, rows, axis=0))


@fault
def image_turned(entries, random):
    code = random.choice([cv2.ROTATE_180, cv2.ROTATE_90_CLOCKWISE])
    return change_images(entries, [random.choice(['left', 'right'])], lambda image: cv2.rotate(image, int(code)))


@fault
def image_repeated(entries, _):
    """The cameras stand still: the pair of the earlier stage once more, with new stamps."""
    first = {}
    for topic, message, _ in images(entries):
        data = first.setdefault(topic, (message.data, message.format))
        message.data, message.format = data
    return entries


@fault
def image_damaged(entries, random):
    keep = random.uniform(0.05, 0.6)
    for _, message, _ in images(entries, random.choice(['left', 'right'])):
        message.data = message.data[:int(keep * len(message.data))]
    return entries


@fault
def image_under_two_names(entries, random):
    """A raw image with the stamp of the compressed one and another content."""
    side, out = random.choice(['left', 'right']), []
    for topic, message, time in images(entries, side):
        raw = BRIDGE.cv2_to_imgmsg(np.ascontiguousarray(np.roll(pixels(message), 40, axis=1)), 'bgr8')
        raw.header = copy.deepcopy(message.header)
        out.append([topic[:-len('/compressed')], raw, time + genpy.Duration.from_sec(random.uniform(-0.01, 0.01))])
    return entries + out


@fault
def image_size_changes(entries, random):
    factor = random.choice([0.5, 0.75, 1.5])
    return change_images(entries, [random.choice(['left', 'right'])], lambda image: cv2.resize(image, None, fx=factor, fy=factor))


# ---- clocks and stamps

@fault
def stamp_missing(entries, _):
    for topic, message, _ in entries:
        if topic.startswith('/stereo/'):
            message.header.stamp = genpy.Time()
    return entries


@fault
def stamps_of_a_pair_differ(entries, random):
    late = genpy.Duration.from_sec(10 ** random.uniform(-5, -1))
    for topic, message, _ in entries:
        if topic.startswith('/stereo/right'):
            message.header.stamp += late
    return entries


@fault
def camera_clock_off(entries, random):
    off = genpy.Duration.from_sec(random.choice([-1, 1]) * random.uniform(0.4, 8))
    for topic, message, _ in entries:
        if topic.startswith('/stereo/'):
            message.header.stamp += off
    return entries


@fault
def recorder_clock_off(entries, random):
    off = random.choice([-1, 1]) * random.uniform(0.5, 9)
    return [[topic, message, seconds(time.to_sec() + off)] for topic, message, time in entries]


@fault
def record_time_absurd(entries, random):
    entry = entries[random.integers(len(entries))]
    entry[2] = seconds(random.choice([0.001, 4.294e9]))
    return entries


@fault
def stamp_absurd(entries, random):
    chosen = [edge for _, _, edge in edges(entries, 'microscope')]
    chosen[random.integers(len(chosen))].header.stamp = seconds(random.choice([0.001, 4.294e9]))
    return entries


# ---- names

@fault
def frame_of_another_name(entries, random):
    child = random.choice(['microscope', 'left_optical', 'reference'])
    for topic in ('/tf', '/tf_static'):
        for _, _, edge in edges(entries, child, topic):
            edge.child_frame_id = child + '_2'
    return entries


@fault
def topic_of_another_name(entries, random):
    side = random.choice(['left', 'right'])
    for entry in entries:
        entry[0] = entry[0].replace(f'/stereo/{side}/', f'/cam_{side}/')
    return entries
