"""The shipped recording, changed, through process_bag."""
import shutil
import subprocess

import numpy as np
import rosbag

import changes
import recorded_cases as cases
from graph import field_arrays
from offline_tools import PHANTOM_BAG, read_field
from programs import program

CAPTURES = ('dural_opening@5.2', 'after_resection@21.2')
SHIFT = 'dural_opening:after_resection'


def shipped_entries():
    """[topic, message, record time] of the shipped recording, its images at half the size."""
    with rosbag.Bag(PHANTOM_BAG) as bag:
        return changes.halved([[topic, message, time] for topic, message, time in bag.read_messages()])


def write(entries, path, types=None):
    """types: by topic, the name of the type that the bag says, where another one."""
    with rosbag.Bag(str(path), 'w') as bag:
        for topic, message, time in sorted(entries, key=lambda entry: entry[2]):
            if types and topic in types:
                bag.write(topic, message, time, connection_header=dict(
                    topic=topic, type=types[topic], md5sum=message._md5sum, message_definition=message._full_text))
            else:
                bag.write(topic, message, time)
    return path


def tool(name, *arguments):
    """Returns (exit status, everything said)."""
    done = subprocess.run([program(name), *map(str, arguments)], stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, universal_newlines=True, check=False, timeout=600)
    return done.returncode, done.stdout


def process(entries, folder, *arguments, types=None, config=cases.CONFIG):
    """Returns (exit status, everything said, mean displacement and magnitude [m] or None, warnings). Leaves the bag."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    bag = write(entries, folder / 'case.bag', types)
    status, said = tool('process_bag', bag, '--capture', *CAPTURES, '--shift', SHIFT, '--output', folder / 'out',
                        '--config', config, *arguments)
    if status != 0:
        return status, said, None, []
    field = read_field(folder / 'out' / (SHIFT.replace(':', '__') + '.bag'))
    displacement = field_arrays(field)[1]
    mean = np.nanmean(displacement.reshape(-1, 3), axis=0)
    return 0, said, np.append(mean, field.summary.magnitude_mean), list(field.summary.warnings)
