"""Bags of small recorded cases for tests: made by the phantom, changed message by message."""
import copy
import os
import subprocess
import tempfile
import time

import genpy
import rosbag
import yaml

from offline_tools import ROOT, run_tool
from programs import program

CONFIG = str(ROOT / 'src/cortshift_tracking/test/support/coarse_config')   # in keeping with small images
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


def raw_images(topic, message, time):
    """For cases.rewrite: images as sensor_msgs/Image."""
    if not topic.endswith('/compressed'):
        return [(topic, message, time)]
    from cv_bridge import CvBridge
    bridge = CvBridge()
    raw = bridge.cv2_to_imgmsg(bridge.compressed_imgmsg_to_cv2(message, 'bgr8'), 'bgr8')
    raw.header = message.header
    return [(topic[:-len('/compressed')], raw, time)]


def seconds(value):
    return genpy.Time.from_sec(value)


def long_bag(source, path, megabytes):
    """A recorded case with its frames over and over after its end, as raw images at 4 Hz and with a tracker of 20 Hz."""
    with rosbag.Bag(source) as bag:
        entries = [(topic, message, time) for topic, message, time in bag.read_messages()]
        end = bag.get_end_time()
    frames = [raw_images(*entry)[0][:2] for entry in entries if entry[0].endswith('/compressed')][:2]
    pose = next(message for topic, message, _ in entries if topic == '/tf')
    with rosbag.Bag(path, 'w') as bag:
        for entry in entries:
            bag.write(*entry)
        for n in range(int(megabytes * 1e6 / sum(len(message.data) for _, message in frames))):
            begin = end + 1 + 0.25 * n
            for topic, message in frames:
                message.header.stamp = seconds(begin)
                bag.write(topic, message, seconds(begin))
            for k in range(5):
                for edge in pose.transforms:
                    edge.header.stamp = seconds(begin + 0.05 * k)
                bag.write('/tf', pose, seconds(begin + 0.05 * k))
    return path


def cost(bag, *arguments, output=None):
    """What process_bag costs: {'seconds': wall time, 'memory': peak [bytes], 'read': from files [bytes]}."""
    with tempfile.TemporaryDirectory() as scratch:
        begin = time.monotonic()
        process = subprocess.Popen([program('process_bag'), bag, *map(str, arguments), '--output',
                                    output or os.path.join(scratch, 'out')], stdout=subprocess.DEVNULL)
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        elapsed = time.monotonic() - begin
        with open(f'/proc/{process.pid}/io', encoding='ascii') as file:
            read = int(file.readline().split()[1])
        _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        raise AssertionError(f'process_bag ended with {status}')
    return {'seconds': elapsed, 'memory': 1024 * usage.ru_maxrss, 'read': read}
