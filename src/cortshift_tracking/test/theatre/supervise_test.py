"""script/supervise: what has refused its configuration ends the launch; whatever else ends is left to respawn, and nothing is left behind."""
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time
from xmlrpc.server import SimpleXMLRPCServer

import pytest

SUPERVISE = str(pathlib.Path(__file__).resolve().parents[4] / 'script/supervise')
# In the place of roslaunch: starts a group of its own, says what it was sent, and ends the group as roslaunch does.
LAUNCHER = '''
import os, signal, subprocess, sys
asked = []
signal.signal(signal.SIGINT, lambda *_: (asked.append(True), os.killpg(child.pid, signal.SIGINT)))
child = subprocess.Popen(sys.argv[1:], preexec_fn=os.setsid)
print(child.pid, flush=True)
status = child.wait()
print("asked" if asked else "left", status, flush=True)
'''


@pytest.fixture(name='launcher')
def launcher_fixture(tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_MASTER_URI', 'http://localhost:1')
    path = tmp_path / 'roslaunch'
    path.write_text(LAUNCHER)

    def start(*words):
        return subprocess.Popen([sys.executable, str(path), SUPERVISE, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    return start


def serve(known, address=('localhost', 0)):
    """The parameters of a master."""
    server = SimpleXMLRPCServer(address, logRequests=False)
    server.register_function(lambda _, key: (1, '', key in known), 'hasParam')
    server.register_function(lambda _, key: (1, '', known[key]), 'getParam')
    server.register_function(lambda _, key, value: known.update({key: value}) or (1, '', 0), 'setParam')
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


@pytest.fixture(name='master')
def master_fixture(monkeypatch):
    """What of a master the parameter of restarts needs."""
    known = {}
    server = serve(known)
    yield f'http://localhost:{server.server_address[1]}', known
    server.shutdown()


def test_a_refused_configuration_ends_the_launch(launcher, master, monkeypatch):
    monkeypatch.setenv('ROS_MASTER_URI', master[0])
    run = launcher('sh', '-c', 'echo parameter x is unknown >&2; exit 1', 'sh', '__name:=tracker')
    out, err = run.communicate()
    assert 'asked 1' in out and 'parameter x is unknown' in err and 'tracker is REQUIRED' in err
    assert not master[1]


@pytest.mark.parametrize('script, why', [('kill -9 $$', 'signal 9 (SIGKILL) ended it'), ('kill -11 $$', 'signal 11 (SIGSEGV) ended it'),
                                         ('exit 0', 'it ended with status 0'), ('sleep 5; exit 70', 'it ended with status 70')])
def test_whatever_else_ends_is_started_again_and_the_master_knows_why(launcher, master, monkeypatch, script, why):
    monkeypatch.setenv('ROS_MASTER_URI', master[0])
    monkeypatch.setenv('ROS_NAMESPACE', '/or1')
    out, err = launcher('sh', '-c', script, 'sh', '__name:=tracker').communicate()
    assert 'left' in out and f'tracker is started again: {why}' in err
    known = master[1]['/or1/restarts/tracker']
    assert known['count'] == 1 and known['why'] == why


def test_nothing_starts_before_the_master_knows_the_launch(launcher, monkeypatch):
    """One that was started again has no parameters: the node would take those that it has by itself. And none may be there for long."""
    server = SimpleXMLRPCServer(('localhost', 0), logRequests=False)
    monkeypatch.setenv('ROS_MASTER_URI', f'http://localhost:{server.server_address[1]}')
    server.server_close()
    run = launcher('sh', '-c', 'echo started; kill -9 $$', 'sh', '__name:=tracker', '__log:=/var/log/7c1b-run/tracker-1.log')
    run.stdout.readline()
    time.sleep(2)
    assert run.poll() is None
    known = {'/run_id': 'of another roscore'}
    server = serve(known, server.server_address)
    time.sleep(1.5)
    assert run.poll() is None and '/restarts/tracker' not in known
    known['/run_id'] = '7c1b-run'
    out, _ = run.communicate(timeout=10)
    assert out.startswith('started') and known['/restarts/tracker']['count'] == 1
    server.shutdown()


def test_a_node_that_ran_before_does_not_end_the_launch(tmp_path, launcher, master, monkeypatch):
    """Its port is still taken, its folder full for a while: that is no wrong configuration."""
    monkeypatch.setenv('ROS_MASTER_URI', master[0])
    path = tmp_path / 'roslaunch'   # one process of this name starts both
    path.write_text('import subprocess, sys\nfor script in ("kill -9 $$", "sleep 5; exit 1"):\n'
                     '    print(subprocess.call([sys.argv[1], "sh", "-c", script, "sh", "__name:=tracker"]), flush=True)\n')
    done = subprocess.run([sys.executable, str(path), SUPERVISE], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.split() == ['137', '1']
    assert master[1]['/restarts/tracker']['count'] == 2


def test_what_is_optional_never_ends_the_launch(launcher, master, monkeypatch):
    monkeypatch.setenv('ROS_MASTER_URI', master[0])
    out, _ = launcher('--optional', 'sh', '-c', 'sleep 5; exit 1', 'sh', '__name:=page').communicate()
    assert 'left 1' in out


def test_a_node_goes_with_its_supervisor_and_roslaunch_can_end_both(launcher):
    def running(pid):
        try:
            return 'Z' not in pathlib.Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0]
        except FileNotFoundError:
            return False
    for end in (lambda pid: os.kill(pid, signal.SIGKILL), lambda pid: os.killpg(pid, signal.SIGINT)):
        run = launcher('sh', '-c', 'echo $$; exec sleep 1000', 'sh', '__name:=tracker')
        pids = sorted(int(run.stdout.readline()) for _ in range(2))   # the supervisor, then its node
        end(pids[0])
        run.communicate()
        limit = time.monotonic() + 20
        while running(pids[1]):
            assert time.monotonic() < limit
            time.sleep(0.02)


def test_files_are_for_their_owner_alone(tmp_path, launcher, master, monkeypatch):
    monkeypatch.setenv('ROS_MASTER_URI', master[0])
    launcher('--umask', '0077', 'sh', '-c', f'mkdir {tmp_path}/case; : > {tmp_path}/case/a; kill -9 $$').communicate()
    assert [(tmp_path / name).stat().st_mode & 0o777 for name in ('case', 'case/a')] == [0o700, 0o600]


@pytest.mark.parametrize('words', [[], ['--optional'], ['--umask', '0077'], ['--umask', 'x', 'true'], ['--what', 'true']])
def test_usage(words):
    assert subprocess.run([SUPERVISE, *words], capture_output=True, check=False).returncode == 2
