#!/usr/bin/python3
"""The graph on two machines: capture PC and compute PC as two network namespaces, with a cable that is pulled.

Run by script/test_machines in a network namespace of its own, which plays the capture PC. The compute PC is another one."""
import contextlib
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time

import rosbag
import rosgraph
import rospy
from cortshift_msgs.srv import CaptureStage, ComputeShift, ListStages, SetPhantomStage
from sensor_msgs.msg import PointCloud2

ROOT = pathlib.Path(__file__).resolve().parents[4]
CAPTURE, COMPUTE = '10.77.0.1', '10.77.0.2'
MASTER = f'http://{CAPTURE}:11311'
CUT = 20.0        # s that the cable is out
RECOVERY = 90.0   # s within which everything must work again
RATE = 2.0        # pairs per second
CASE = ROOT / 'config/phantom/phantom_case.yaml'


def run(*command):
    subprocess.run(command, check=True)


def environment(address, home):
    """Of a process on the machine with this address."""
    values = {k: v for k, v in os.environ.items() if k not in ('ROS_HOSTNAME', 'ROS_MASTER_URI')}
    return {**values, 'ROS_IP': address, 'ROS_MASTER_URI': MASTER, 'ROS_HOME': str(home)}


class Machines:
    """Two namespaces with a cable between them."""

    def __init__(self, cleanup, folder):
        self._cleanup, self._folder = cleanup, folder
        self._holder = subprocess.Popen(['unshare', '--net', 'sleep', 'infinity'])
        cleanup.callback(self._end, self._holder)
        own = os.readlink('/proc/self/ns/net')
        until(lambda: os.readlink(f'/proc/{self._holder.pid}/ns/net') != own, 10, 'the second namespace')
        self._inside = ['nsenter', '--target', str(self._holder.pid), '--net']
        run('ip', 'link', 'add', 'capture', 'type', 'veth', 'peer', 'name', 'compute')
        run('ip', 'link', 'set', 'compute', 'netns', str(self._holder.pid))
        for prefix, device, address in (([], 'capture', CAPTURE), (self._inside, 'compute', COMPUTE)):
            run(*prefix, 'ip', 'address', 'add', address + '/24', 'dev', device)
            run(*prefix, 'ip', 'link', 'set', 'lo', 'up')
            run(*prefix, 'ip', 'link', 'set', device, 'up')

    def start(self, address, name, *command):
        prefix = self._inside if address == COMPUTE else []
        log = open(self._folder / f'{name}.log', 'w')
        self._cleanup.callback(log.close)
        process = subprocess.Popen([*prefix, *command], env=environment(address, self._folder / address), stdout=log,
                                   stderr=subprocess.STDOUT, start_new_session=True)
        self._cleanup.callback(self._end, process)
        return process

    @staticmethod
    def cable(plugged):
        run('ip', 'link', 'set', 'capture', 'up' if plugged else 'down')

    @staticmethod
    def _end(process):
        if process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGINT) if process.args[0] != 'unshare' else process.kill()
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()


def until(condition, seconds, what):
    """Wait. Raises AssertionError naming what did not happen."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f'{what} did not happen within {seconds:.0f} s')
        time.sleep(0.1)


def client():
    """On the compute PC: a surgeon's part in the test. Commands come on stdin, answers go to stdout."""
    rospy.init_node('client', anonymous=True, disable_signals=True)
    surfaces = []
    rospy.Subscriber('/surface/points', PointCloud2, lambda m: surfaces.append(m.header.stamp.to_sec()), queue_size=1)
    services = {}
    for name, kind in (('capture_stage', CaptureStage), ('list_stages', ListStages), ('compute_shift', ComputeShift)):
        rospy.wait_for_service(f'/shift_tracker/{name}', 120)
        services[name] = rospy.ServiceProxy(f'/shift_tracker/{name}', kind, persistent=True)  # the master may be out of reach
    services['list_stages']()  # opens the connection
    services['capture_stage']('', '')  # likewise; refused for its key
    print('ready', flush=True)
    for line in sys.stdin:
        words = line.split()
        if words[0] == 'surfaces':
            print(len(surfaces), flush=True)
        elif words[0] == 'list':
            print(' '.join(s.key for s in services['list_stages']().stages), flush=True)
        else:
            answer = services[words[0]](*words[1:], *([''] if words[0] == 'capture_stage' else []))
            print(f'{"yes" if answer.success else "no"} {answer.message}', flush=True)


class Client:
    def __init__(self, machines):
        self._process = machines.client = subprocess.Popen(
            [*machines._inside, sys.executable, __file__, 'client'], env=environment(COMPUTE, machines._folder / COMPUTE),
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True)
        machines._cleanup.callback(machines._end, self._process)
        assert self._process.stdout.readline().strip() == 'ready', 'the client did not start'

    def send(self, text):
        self._process.stdin.write(text + '\n')
        self._process.stdin.flush()

    def answer(self):
        line = self._process.stdout.readline().strip()
        assert self._process.poll() is None, 'the client ended'
        print('  ', line, flush=True)
        return line

    def ask(self, text):
        print(' ', text)
        self.send(text)
        return self.answer()


def yes(line):
    assert line.startswith('yes'), line


def recorded_gap(folder, begin, end):
    """Number of left images that the capture PC recorded between these times, and the longest time without one [s]."""
    stamps = []
    for path in sorted(folder.rglob('case_*.bag')):
        with rosbag.Bag(str(path)) as bag:
            stamps += [m.header.stamp.to_sec() for _, m, _ in bag.read_messages('/stereo/left/image_raw')]
    stamps = sorted(s for s in stamps if begin <= s <= end)
    marks = [begin, *stamps, end]
    return len(stamps), max(b - a for a, b in zip(marks, marks[1:]))


def case(machines, folder):
    machines.start(CAPTURE, 'capture_pc', 'roslaunch', str(ROOT / 'launch/capture_pc.launch'), f'phantom:={CASE}', 'preflight:=false',
                   'navigation:=false', f'site:={folder / "site.yaml"}')
    machines.start(COMPUTE, 'compute_pc', 'roslaunch', '--wait', str(ROOT / 'launch/compute_pc.launch'), 'page:=0',
                   f'site:={folder / "site.yaml"}')
    os.environ.update(environment(CAPTURE, folder / CAPTURE))
    until(rosgraph.is_master_online, 60, 'the master')
    surgeon = Client(machines)
    rospy.init_node('operator', disable_signals=True)
    rospy.wait_for_service('/stereo_driver/set_stage', 120)
    set_stage = rospy.ServiceProxy('/stereo_driver/set_stage', SetPhantomStage)

    until(lambda: int(surgeon.ask('surfaces')) > 0, 120, 'a surface on the compute PC')
    yes(surgeon.ask('capture_stage before'))
    assert set_stage('early_resection').success
    time.sleep(1)

    print(f'cable out for {CUT:.0f} s, in the middle of a capture')
    surgeon.send('capture_stage during')
    time.sleep(0.05)
    machines.cable(False)
    out, cut_from = time.monotonic(), time.time()
    during = surgeon.answer()
    refused = surgeon.ask('capture_stage without')
    assert refused.startswith('no'), refused
    assert any(word in refused for word in ('driver', 'surface', 'tracker')), refused
    kept = surgeon.ask('list').split()
    assert kept == ['before'] + ['during'] * during.startswith('yes'), kept
    time.sleep(max(0.0, CUT - (time.monotonic() - out)))
    machines.cable(True)
    back = time.monotonic()
    cut_until = time.time()
    print('cable back')

    seen = int(surgeon.ask('surfaces'))
    until(lambda: int(surgeon.ask('surfaces')) > seen + 2, RECOVERY, 'surfaces again')
    print(f'surfaces again {time.monotonic() - back:.1f} s after the cable')
    yes(surgeon.ask('capture_stage after'))
    print(f'a stage again {time.monotonic() - back:.1f} s after the cable')
    assert surgeon.ask('list').split() == kept + ['after']
    yes(surgeon.ask('compute_shift before after'))
    return cut_from, cut_until


def main():
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # and with that, every process that was started ends
    with contextlib.ExitStack() as outer:
        folder = pathlib.Path(outer.enter_context(tempfile.TemporaryDirectory(prefix='cortshift-machines-')))
        (folder / 'site.yaml').write_text(f'stereo_driver: {{rate: {RATE}}}\n'
                                          f'case_recorder: {{folder: {folder / "recordings"}, minutes: 30.0}}\n')
        try:
            with contextlib.ExitStack() as cleanup:
                machines = Machines(cleanup, folder)
                try:
                    cut = case(machines, folder)
                finally:
                    machines.cable(True)  # or nobody could say goodbye to the master
                    rospy.signal_shutdown('done')
        except Exception:
            for log in sorted(folder.glob('*.log')):
                print(f'---- {log.name}', log.read_text()[-3000:], sep='\n', file=sys.stderr)
            raise
        count, gap = recorded_gap(folder / 'recordings', *cut)
        print(f'while the cable was out the capture PC recorded {count} pairs, at most {gap:.2f} s apart')
        assert gap < CUT / 4, 'the recording has a hole where the cable was out'
    print('passed')


if __name__ == '__main__':
    client() if sys.argv[1:] == ['client'] else main()
