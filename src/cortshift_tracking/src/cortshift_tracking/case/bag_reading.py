"""Opens bags of a case and says in plain words why one cannot be read."""
import contextlib

import rosbag
from cortshift_msgs.msg import DisplacementField, StageInfo
from sensor_msgs.msg import CameraInfo, PointCloud2

from cortshift_tracking.errors import CaseError

#: What the topics of a case hold.
KINDS = {'/stage/info': StageInfo, '/surface/points': PointCloud2, '/shift/field': DisplacementField,
         '/stereo/left/camera_info': CameraInfo, '/stereo/right/camera_info': CameraInfo}


@contextlib.contextmanager
def open_bag(path):
    """A rosbag.Bag whose topics of KINDS hold what this version reads. Raises CaseError with reason and remedy."""
    try:
        with rosbag.Bag(path) as bag:
            _check_kinds(path, bag)
            yield bag
    except (CaseError, GeneratorExit):
        raise
    except rosbag.ROSBagUnindexedException as error:
        raise CaseError(f'{path}: the bag has no index, so its recording was cut off; repair a copy with "rosbag reindex"') from error
    except OSError as error:
        raise CaseError(f'{path}: cannot be read ({error.strerror or "damaged"}); check its rights and the disk') from error
    except Exception as error:  # on damaged bytes rosbag raises whatever its parts raise; all mean the same here
        raise CaseError(f'{path}: damaged, or not a bag; restore it from a copy (noticed as {type(error).__name__})') from error


def _check_kinds(path, bag):
    told = bag.get_type_and_topic_info()
    for topic, kind in KINDS.items():
        if topic not in told.topics:
            continue
        name = told.topics[topic].msg_type
        if name != kind._type:
            raise CaseError(f'{path}: {topic} holds {name}, not {kind._type}; give what cortshift wrote')
        if told.msg_types[name] != kind._md5sum:
            raise CaseError(f'{path}: written by another version of cortshift, whose {name} has other fields; make it again from the '
                            'recording, or read it with that version')
