"""ROS messages of a case: times shifted, names replaced, and no text but that of this software."""
import hashlib
import re

import genpy
import numpy as np
from cortshift_msgs.msg import DisplacementField, MicroscopeSettings, StageInfo
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from cortshift_tracking.deidentify import words
from cortshift_tracking.deidentify.pictures import PNG, pixels_only
from cortshift_tracking.errors import CaseError

#: Topics that are handed on, as they are recorded; all others (logs, diagnostics, points of people's own programs) are left out.
TOPICS = {'/stage/info': StageInfo, '/stage/parameters': String, '/surface/points': PointCloud2, '/shift/field': DisplacementField,
          '/microscope/settings': MicroscopeSettings, '/microscope/pose': PoseStamped, '/tf': TFMessage, '/tf_static': TFMessage}
for _side in ('left', 'right'):
    TOPICS[f'/stereo/{_side}/image_raw'] = Image
    TOPICS[f'/stereo/{_side}/image_raw/compressed'] = CompressedImage
    TOPICS[f'/stereo/{_side}/camera_info'] = CameraInfo
CLOUD_FIELDS = ('x', 'y', 'z', 'rgb', 'confidence', 'dx', 'dy', 'dz', 'uncertainty', 'strain_major', 'strain_minor')
_ENCODING = re.compile(r'(rgb|bgr|rgba|bgra|mono|bayer_(rggb|bggr|gbrg|grbg))(8|16)\Z|(8|16)[US]C[1-4]\Z')
_FORMAT = re.compile(r'((rgb|bgr|rgba|bgra|mono)(8|16); ?)?(png|jpe?g)( compressed( (rgb|bgr|mono)(8|16))?)?\Z')


class Cleaner:
    """Cleans messages in place. configurations: the new hash of parameters by the old one, of the stages seen so far."""

    def __init__(self, names):
        self.names, self.configurations = names, {}
        key, frame, withheld = names.key, names.frame, lambda text: words.WITHHELD if text else ''
        self._texts = {
            ('std_msgs/Header', 'frame_id'): frame, ('geometry_msgs/TransformStamped', 'child_frame_id'): frame,
            ('sensor_msgs/CameraInfo', 'distortion_model'): _one_of('distortion model', words.VALUES.__contains__),
            ('sensor_msgs/Image', 'encoding'): _one_of('encoding', _ENCODING.match),
            ('sensor_msgs/PointField', 'name'): _one_of('field of a cloud', CLOUD_FIELDS.__contains__),
            ('cortshift_msgs/StageInfo', 'key'): key, ('cortshift_msgs/StageInfo', 'note'): withheld,
            ('cortshift_msgs/DisplacementField', 'from_key'): key, ('cortshift_msgs/DisplacementField', 'to_key'): key,
            ('cortshift_msgs/ShiftSummary', 'from_key'): key, ('cortshift_msgs/ShiftSummary', 'to_key'): key,
            ('cortshift_msgs/Provenance', 'software'): words.version,
            ('cortshift_msgs/Provenance', 'configuration'): lambda text: self.configurations.get(text, words.hashes(text)),
            ('cortshift_msgs/Provenance', 'calibration'): words.hashes,
        }
        for kind, slots in (('StageInfo', ('warnings',)), ('ShiftSummary', ('warnings', 'outline', 'surround')),
                            ('ErrorSource', ('source', 'known_from')), ('PoseError', ('source', 'known_from'))):
            for slot in slots:
                self._texts[f'cortshift_msgs/{kind}', slot] = words.sentence

    def clean(self, message):
        """The message. Raises CaseError where something in it is of no kind that can be handed on."""
        if isinstance(message, String):
            before = message.data
            message.data = words.parameters(before)
            self.configurations[hashlib.sha256(before.encode()).hexdigest()] = hashlib.sha256(message.data.encode()).hexdigest()
            return message
        if isinstance(message, CompressedImage):
            message.data = pixels_only(bytes(message.data))
            if not _FORMAT.match(message.format):
                message.format = 'png' if message.data.startswith(PNG) else 'jpeg'
            kind, message.format = message.format, ''
            self._walk(message)
            message.format = kind
            return message
        if isinstance(message, Image):
            message.data = message.data[:message.step * message.height]
        return self._walk(message)

    def _walk(self, message):
        if isinstance(message, PointCloud2):
            message.data = _fields_only(message)
        for slot, kind in zip(message.__slots__, message._slot_types):
            value = getattr(message, slot)
            if kind == 'string':
                setattr(message, slot, self._text(message, slot, value))
            elif kind == 'string[]':
                setattr(message, slot, [self._text(message, slot, text) for text in value])
            elif kind == 'time':
                setattr(message, slot, self.names.time(value))
            elif isinstance(value, genpy.Message):
                self._walk(value)
            elif isinstance(value, (list, tuple)) and value and isinstance(value[0], genpy.Message):
                for item in value:
                    self._walk(item)
        return message

    def _text(self, message, slot, value):
        rule = self._texts.get((message._type, slot))
        return rule(value) if rule and value else ''


def _one_of(what, known):
    def rule(text):
        if not known(text):
            raise CaseError(f'the {what} "{text}" is none that can be handed on; take out what has it')
        return text
    return rule


def _fields_only(cloud):
    """The cloud's bytes with zeros between its fields and behind its rows."""
    raw = np.frombuffer(cloud.data, np.uint8)[:cloud.height * cloud.row_step]
    if raw.size < cloud.height * cloud.row_step or cloud.row_step < cloud.width * cloud.point_step:
        raise CaseError(f'a cloud of {cloud.height} x {cloud.width} points is cut short; take it out')
    used = np.zeros(cloud.point_step, bool)
    for field in cloud.fields:
        used[field.offset:field.offset + 4] = True
    if used.all() and cloud.row_step == cloud.width * cloud.point_step:
        return raw.tobytes()
    rows = raw.reshape(cloud.height, cloud.row_step).copy()
    rows[:, cloud.width * cloud.point_step:] = 0
    rows[:, :cloud.width * cloud.point_step].reshape(cloud.height, cloud.width, cloud.point_step)[..., ~used] = 0
    return rows.tobytes()
