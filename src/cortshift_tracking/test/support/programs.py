"""Where the programs of the workspace are, and ports for them. Tests start hundreds of programs, and rosrun searches for half a second
of processor time each. That rosrun finds each documented one is documented_commands_test's to show."""
import contextlib
import functools
import os
import socket


@functools.lru_cache(maxsize=None)
def program(name, package='cortshift_tracking'):
    """The path that `rosrun PACKAGE NAME` runs. Raises AssertionError where there is none."""
    paths = [os.path.join(prefix, 'lib', package, name) for prefix in os.environ['CMAKE_PREFIX_PATH'].split(':')]
    found = [path for path in paths if os.access(path, os.X_OK)]
    assert found, f'{name} of {package} is at none of {paths}; build it'
    return found[0]


def free_ports(count):
    """Different ones, of the loopback address, that nobody listens on."""
    with contextlib.ExitStack() as held:
        sockets = [held.enter_context(socket.socket()) for _ in range(count)]
        for one in sockets:
            one.bind(('127.0.0.1', 0))
        return [one.getsockname()[1] for one in sockets]
