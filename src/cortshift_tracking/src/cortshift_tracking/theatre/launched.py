"""What a launch file gives to a program that is no ROS node, or becomes one later."""
import sys

import rosgraph


def own_parameter(name, words=None):
    """Private parameter that roslaunch set for this program; '' where it set none, or roslaunch did not start it.

    Paths come this way: a node's arguments are words that roslaunch splits at blanks, and it runs in another folder.
    """
    names = [word.partition(':=')[2] for word in (sys.argv if words is None else words) if word.startswith('__name:=')]
    if not names:
        return ''
    key = rosgraph.names.ns_join(rosgraph.names.ns_join(rosgraph.names.get_ros_namespace(), names[-1]), name)
    try:
        return str(rosgraph.Master('/launched').getParam(key))
    except (rosgraph.MasterException, OSError):
        return ''
