"""Where the programs of the workspace are: tests start hundreds of them, and rosrun searches for half a second of processor time
each. That rosrun finds each documented one is documented_commands_test's to show."""
import functools
import os


@functools.lru_cache(maxsize=None)
def program(name, package='cortshift_tracking'):
    """The path that `rosrun PACKAGE NAME` runs. Raises AssertionError where there is none."""
    paths = [os.path.join(prefix, 'lib', package, name) for prefix in os.environ['CMAKE_PREFIX_PATH'].split(':')]
    found = [path for path in paths if os.access(path, os.X_OK)]
    assert found, f'{name} of {package} is at none of {paths}; build it'
    return found[0]
