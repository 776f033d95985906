"""Variants of a recorded case that are no faults, as faults.py has faults. VARIANTS holds them by name."""
import copy

import cv2
import genpy
import tf2_msgs.msg
from changes import BRIDGE, change_images, edges, images, move, moved_in_time, pixels, seconds

VARIANTS = {}


def variant(function):
    VARIANTS[function.__name__] = function
    return function


@variant
def untouched(entries, _):
    return entries


@variant
def tracker_with_its_noise(entries, random):
    sd = random.uniform(0.000005, 0.00002)
    for _, _, edge in edges(entries, 'microscope'):
        move(edge, sd * random.normal(size=3))
    return entries


@variant
def another_day(entries, random):
    return moved_in_time(entries, float(random.integers(-10000000, 10000000)))


@variant
def messages_twice(entries, random):
    return entries + [[topic, copy.deepcopy(message), time] for topic, message, time in entries if random.random() < 0.3]


@variant
def other_topics(entries, random):
    out = []
    for topic, message, time in entries:
        if topic.startswith('/stereo/left') and random.random() < 0.5:
            out.append([topic.replace('/stereo/left', '/room_camera'), copy.deepcopy(message), time])
    return entries + out


@variant
def other_edges(entries, random):
    out = []
    for time, _, edge in edges(entries, 'microscope'):
        other = copy.deepcopy(edge)
        other.child_frame_id = 'pointer'
        move(other, 0.01 * random.normal(size=3))
        out.append(['/tf', tf2_msgs.msg.TFMessage([other]), time])
    return entries + out


@variant
def recorded_a_little_later(entries, random):
    return [[topic, message, seconds(time.to_sec() + random.uniform(0, 0.08))] for topic, message, time in entries]


@variant
def fixed_edges_repeated(entries, _):
    out = []
    for time, message, _ in list(edges(entries, 'left_optical', '/tf_static')):
        out += [['/tf_static', copy.deepcopy(message), time + genpy.Duration.from_sec(after)] for after in (0.2, 8, 16)]
    return entries + out


@variant
def fixed_edges_on_tf_as_well(entries, _):
    _, fixed, _ = next(edges(entries, 'left_optical', '/tf_static'))
    out = []
    for time, _, _ in edges(entries, 'microscope'):
        again = copy.deepcopy(fixed)
        for edge in again.transforms:
            edge.header.stamp = time
        out.append(['/tf', again, time])
    return entries + out


@variant
def frames_with_slashes(entries, _):
    for topic in ('/tf', '/tf_static'):
        for name, message, _ in entries:
            if name == topic:
                for edge in message.transforms:
                    edge.header.frame_id = '/' + edge.header.frame_id.strip('/')
                    edge.child_frame_id = '/' + edge.child_frame_id.strip('/')
    return entries


@variant
def raw_as_well(entries, _):
    out = []
    for topic, message, time in images(entries):
        raw = BRIDGE.cv2_to_imgmsg(pixels(message), 'bgr8')
        raw.header = copy.deepcopy(message.header)
        out.append([topic[:-len('/compressed')], raw, time])
    return entries + out


@variant
def brighter(entries, random):
    gain = random.uniform(0.85, 1.1)
    return change_images(entries, ['left', 'right'], lambda image: cv2.convertScaleAbs(image, alpha=gain))
