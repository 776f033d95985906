"""master_keeper: a master that ends and is started again knows again who there is, and nothing that flows is interrupted."""
import contextlib
import os
import pathlib
import signal
import subprocess
import sys
import time
import xmlrpc.client

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / 'support'))
from graph import wait_until  # noqa: E402
from programs import free_ports  # noqa: E402

PATIENCE = 60
# A node that gives times, and one that takes them and says of each how long after the one before it came.
GIVER = '''
import rospy
from std_msgs.msg import Time
rospy.init_node('giver')
topic, rate = rospy.Publisher('/times', Time, queue_size=1), rospy.Rate(20)
while not rospy.is_shutdown():
    topic.publish(rospy.Time.now())
    rate.sleep()
'''
TAKER = '''
import sys, time
import rospy
from std_msgs.msg import Time
last = [time.monotonic()]
def take(_):
    now = time.monotonic()
    print(f'{now - last[0]:.3f}', flush=True)
    last[0] = now
rospy.init_node(sys.argv[1])
rospy.Subscriber('/times', Time, take)
rospy.spin()
'''

class Room:
    """A master of its own, and programs under it."""

    def __init__(self, folder, cleanup):
        self.folder, self._cleanup, (self.port,) = folder, cleanup, free_ports(1)
        self.environment = dict(os.environ, ROS_MASTER_URI=f'http://localhost:{self.port}', ROS_HOSTNAME='localhost', ROS_HOME=str(folder),
                                ROS_LOG_DIR=str(folder / 'log'))
        self.master = xmlrpc.client.ServerProxy(self.environment['ROS_MASTER_URI'])
        self.start_master()
        cleanup.callback(self.end_master)

    def run(self, name, *command):
        output = open(self.folder / name, 'a', encoding='utf-8')
        self._cleanup.callback(output.close)
        process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT, env=self.environment, start_new_session=True)
        self._cleanup.callback(self.kill, process)
        return process

    def script(self, name, text, *arguments):
        return self.run(name, '/usr/bin/python3', '-c', text, *arguments)

    @staticmethod
    def kill(process):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def start_master(self):
        self._roscore = self.run('roscore', 'roscore', '-p', str(self.port))
        wait_until(lambda: self.ask('hasParam', '/run_id'), PATIENCE, 'the master')

    def end_master(self):
        os.kill(self.ask('getPid'), signal.SIGKILL)
        self._roscore.wait(PATIENCE)   # by itself, with the last of its nodes

    def ask(self, call, *arguments):
        """None where there is no answer, or none to that."""
        try:
            code, _, value = getattr(self.master, call)('/test', *arguments)
            return value if code == 1 else None
        except OSError:
            return None

    def lines(self, name):
        return (self.folder / name).read_text(encoding='utf-8').splitlines()


@pytest.fixture(name='room')
def a_room(tmp_path):
    with contextlib.ExitStack() as cleanup:
        room = Room(tmp_path, cleanup)
        room.ask('setParam', '/site', {'name': 'room 3', 'lamp': {'on': True}})
        room.giver = room.script('giver', GIVER)
        room.taker = room.script('taker', TAKER, 'taker')
        room.other = room.script('other', TAKER, 'other')
        room.keeper = room.run('keeper', '/usr/bin/python3', str(pathlib.Path(__file__).resolve().parents[2] / 'scripts/master_keeper'))
        for name in ('giver', 'taker', 'other', 'master_keeper'):
            wait_until(lambda: room.ask('lookupNode', '/' + name), PATIENCE, name)   # noqa: B023
        wait_until(lambda: len(room.lines('taker')) > 3, PATIENCE, 'times')
        time.sleep(2)   # copied by then
        yield room


def asked(room):
    return subprocess.run(['rosservice', 'call', '/giver/get_loggers'], env=room.environment, capture_output=True, text=True, check=False).stdout


def test_a_new_master_knows_what_the_old_one_knew(room):
    run = room.ask('getParam', '/run_id')
    for _ in range(2):   # and so does the one after it
        room.end_master()
        time.sleep(2)
        room.start_master()
        wait_until(lambda: room.ask('lookupNode', '/master_keeper'), PATIENCE, 'the nodes')
        for name in ('/giver', '/taker', '/other'):
            assert room.ask('lookupNode', name), name
        assert room.ask('getParam', '/run_id') == run
        assert room.ask('getParam', '/site') == {'name': 'room 3', 'lamp': {'on': True}}
        assert 'rosout' in asked(room)
        late = f'late{time.monotonic()}'
        room.script(late, TAKER, late.replace('.', ''))   # who comes now finds whom it needs
        wait_until(lambda: len(room.lines(late)) > 3, PATIENCE, 'times for one who came later')   # noqa: B023
        assert 'put into the new one: parameters, /giver /master_keeper /other /taker; not:' in (room.folder / 'keeper').read_text()
        time.sleep(3)
    assert max(float(line) for line in room.lines('taker')[3:]) < 1.0, 'times were interrupted'


def test_who_died_with_the_master_is_not_registered_and_who_started_again_stays_so(room):
    room.end_master()
    room.kill(room.giver)
    room.kill(room.other)
    room.script('giver', GIVER)
    time.sleep(1)
    received = len(room.lines('taker'))
    room.start_master()
    wait_until(lambda: room.ask('lookupNode', '/master_keeper'), PATIENCE, 'the nodes')
    wait_until(lambda: len(room.lines('taker')) > received + 3, PATIENCE, 'times of the new giver')
    assert room.ask('lookupNode', '/other') is None
    assert room.taker.poll() is None and len(room.ask('getSystemState')[0]) > 1


def test_a_node_that_stands_still_is_no_dead_one(room):
    room.end_master()
    os.kill(room.giver.pid, signal.SIGSTOP)
    room.start_master()
    wait_until(lambda: room.ask('lookupNode', '/master_keeper'), PATIENCE, 'the nodes')
    assert room.ask('lookupNode', '/giver')
    os.kill(room.giver.pid, signal.SIGCONT)
    received = len(room.lines('taker'))
    wait_until(lambda: len(room.lines('taker')) > received + 3, PATIENCE, 'times, by the connection that there was')


def test_a_node_that_registered_something_before_the_keeper_came_is_completed(room):
    address = room.ask('lookupNode', '/giver')
    room.end_master()
    os.kill(room.keeper.pid, signal.SIGSTOP)
    room.start_master()
    room.master.registerPublisher('/giver', '/late', 'std_msgs/Time', address)
    os.kill(room.keeper.pid, signal.SIGCONT)
    wait_until(lambda: room.ask('lookupNode', '/master_keeper'), PATIENCE, 'the nodes')
    published = dict(room.ask('getSystemState')[0])
    assert published['/times'] == published['/late'] == ['/giver']


def test_what_the_new_master_says_of_a_parameter_holds(room):
    room.end_master()
    os.kill(room.keeper.pid, signal.SIGSTOP)
    room.start_master()
    room.ask('setParam', '/site/name', 'room 4')
    os.kill(room.keeper.pid, signal.SIGCONT)
    wait_until(lambda: room.ask('lookupNode', '/master_keeper'), PATIENCE, 'the nodes')
    assert room.ask('getParam', '/site') == {'name': 'room 4', 'lamp': {'on': True}}


if __name__ == '__main__':
    sys.exit(pytest.main([__file__]))
