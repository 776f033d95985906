"""What the tests of the offline tools share: running them, and reading what they write."""
import pathlib
import subprocess

import rosbag

from programs import program

ROOT = pathlib.Path(__file__).resolve().parents[4]
PHANTOM_BAG = str(ROOT / 'bags/phantom_case.bag')
PHANTOM_CASE = str(ROOT / 'config/phantom/phantom_case.yaml')


def run_tool(name, *arguments, package='cortshift_tracking', status=0):
    """Run a tool of the workspace. Returns (stdout, stderr). Raises AssertionError where it ends with another status."""
    done = subprocess.run([program(name, package), *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          universal_newlines=True, check=False)
    assert done.returncode == status, f'{name} ended with {done.returncode}:\n{done.stdout}\n{done.stderr}'
    return done.stdout, done.stderr


def read_field(path):
    """The DisplacementField of a bag."""
    with rosbag.Bag(str(path)) as bag:
        (_, message, _), = bag.read_messages('/shift/field')
    return message
