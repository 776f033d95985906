"""Bags of small recorded cases for tests: made by the phantom, changed message by message."""
import copy
import os

import genpy
import rosbag
import yaml

from offline_tools import ROOT, run_tool

STAGES = ('dural_opening', 'after_resection')
CAPTURES = ('dural_opening@5.2', 'after_resection@12.2')   # [s] from the bag's start


def record(folder, name, size=(320, 240), sag=0.004, lateral=0.001, seed=7):
    """Record a case of two stages. Returns the paths of the bag and of the phantom case."""
    with open(ROOT / 'config/phantom/phantom_case.yaml', encoding='utf-8') as file:
        case = yaml.safe_load(file)
    case['cameras']['size'] = list(size)
    case['head']['seed'] = seed
    case['image']['supersampling'] = 1
    case['stages'] = [case['stages'][0], case['stages'][2]]
    case['stages'][1]['deformation'] = {'sag': sag, 'lateral': [lateral, -0.0005]}
    description, bag = os.path.join(folder, name + '.yaml'), os.path.join(folder, name + '.bag')
    with open(description, 'w', encoding='utf-8') as file:
        yaml.safe_dump(case, file)
    run_tool('phantom_bag', '--case', description, '--output', bag, package='cortshift_stereo')
    return bag, description


def rewrite(source, target, change=lambda topic, message, time: [(topic, message, time)], order=None, **settings):
    """Copy a bag. change: (topic, message, time) to a list of those; order: key to sort the messages written by.

    settings: of rosbag.Bag (compression, chunk_threshold). Returns target.
    """
    with rosbag.Bag(source) as bag:
        entries = [(topic, copy.deepcopy(message), time, header) for topic, message, time, header in
                   bag.read_messages(return_connection_header=True)]
    out = [(*changed, header) for topic, message, time, header in entries for changed in change(topic, message, time)]
    if order is not None:
        out.sort(key=lambda entry: order(entry[2]))
    with rosbag.Bag(target, 'w', **settings) as bag:
        for topic, message, time, header in out:
            header = {key: value for key, value in header.items() if key not in ('topic', 'type', 'md5sum', 'message_definition')}
            bag.write(topic, message, time, connection_header=dict(
                header, topic=topic, type=message._type, md5sum=message._md5sum, message_definition=message._full_text))
    return target


def index_place(bag_path):
    """Where in the file the index begins, behind the last chunk."""
    with rosbag.Bag(bag_path) as bag:
        return bag._index_data_pos


def cut(source, target, size):
    """The first bytes of a file, as a copy that broke off."""
    with open(source, 'rb') as file:
        data = file.read(size)
    with open(target, 'wb') as file:
        file.write(data)
    return target


def forget_index(source, target):
    """A bag as its recorder leaves it where it dies: no index at the end, none named in the header."""
    cut(source, target, index_place(source))
    with open(target, 'r+b') as file:
        place = file.read(200).index(b'index_pos=') + len(b'index_pos=')
        file.seek(place)
        file.write(bytes(8))
    return target


def tilt_right_camera(topic, message, time):
    """For rewrite: the right camera has turned by 1.5 degrees since its calibration, as a rectification that is off shows."""
    if topic == '/stereo/right/camera_info':
        message.K = list(message.K)
        message.K[5] += 40 * message.height / 240   # as far as the image is concerned, the same
    return [(topic, message, time)]


def seconds(value):
    return genpy.Time.from_sec(value)
