"""Changes of a recorded case, given as entries: a list of [topic, message, record time]."""
import cv2
import genpy
import numpy as np
from cv_bridge import CvBridge
from sensor_msgs.msg import CompressedImage

CAPTURED = (5.0, 21.0)   # [s] after the begin: exposures of the two stages that are captured
BRIDGE = CvBridge()


def seconds(time):
    return genpy.Time.from_sec(max(time, 1e-3))


def begin_of(entries):
    return min(time.to_sec() for _, _, time in entries)


def edges(entries, child, topic='/tf'):
    """(time, message, edge) of every sample of an edge."""
    for name, message, time in entries:
        if name == topic:
            for edge in message.transforms:
                if edge.child_frame_id.strip('/') == child:
                    yield time, message, edge


def images(entries, side=None):
    for entry in entries:
        if '/image_raw' in entry[0] and (side is None or side in entry[0]):
            yield entry


def pixels(message):
    return BRIDGE.compressed_imgmsg_to_cv2(message, 'bgr8')


def write_pixels(message, image):
    message.data = cv2.imencode('.png', image)[1].tobytes()
    message.format = 'png'


def later_half(entries):
    """Record time between the two captured exposures."""
    return begin_of(entries) + sum(CAPTURED) / 2


def a_capture(random):
    return CAPTURED[random.integers(2)]


def direction(random):
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)


def move(edge, vector):
    t = edge.transform.translation
    t.x, t.y, t.z = t.x + vector[0], t.y + vector[1], t.z + vector[2]


def moved_in_time(entries, by):
    """Stamps and record times alike [s]."""
    shift = genpy.Duration.from_sec(by)
    for entry in entries:
        topic, message, _ = entry
        for header in [edge.header for edge in message.transforms] if topic in ('/tf', '/tf_static') else [message.header]:
            header.stamp += shift
        entry[2] += shift
    return entries


def change_images(entries, sides, change, since=0):
    for topic, message, time in images(entries):
        if any(side in topic for side in sides) and time.to_sec() >= since:
            write_pixels(message, change(pixels(message)))
    return entries


def halved(entries):
    """The same case with images of half the size, for speed: pixel (u, v) of them is (2u + 0.5, 2v + 0.5)."""
    for topic, message, _ in entries:
        if isinstance(message, CompressedImage) or topic.endswith('/compressed'):
            write_pixels(message, cv2.resize(pixels(message), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
        elif topic.endswith('/camera_info'):
            message.width, message.height = message.width // 2, message.height // 2
            K, P = list(message.K), list(message.P)
            for k in (0, 4):
                K[k] /= 2
            for k in (2, 5):
                K[k] = (K[k] - 0.5) / 2
            for k in (0, 3, 5):
                P[k] /= 2
            for k in (2, 6):
                P[k] = (P[k] - 0.5) / 2
            message.K, message.P = K, P
    return entries
