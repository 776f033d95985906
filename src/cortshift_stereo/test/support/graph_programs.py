"""What tests share that start programs of the workspace themselves."""
import os
import time

import rospkg

CONFIG = os.path.join(rospkg.RosPack().get_path('cortshift_stereo'), '..', '..', 'config')


def wait_until(condition, seconds, what):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f'{what} did not happen within {seconds} s')
        time.sleep(0.02)


def program(package, name):
    for folder in os.environ['CMAKE_PREFIX_PATH'].split(':'):
        path = os.path.join(folder, 'lib', package, name)
        if os.path.exists(path):
            return path
    raise AssertionError(f'{name} is not built')
