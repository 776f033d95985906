"""A launch that cannot do what it was asked for ends by itself and says what to set."""
import os
import pathlib
import socket
import subprocess

ROOT = pathlib.Path(__file__).resolve().parents[4]


def said_by(tmp_path, launch, *arguments):
    """What a launch file says until it has ended by itself."""
    with socket.socket() as holder:
        # Ours while the master runs: it may bind the port once more, since nobody listens; nobody else is given it.
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        holder.bind(('localhost', 0))
        port = holder.getsockname()[1]
        environment = dict(os.environ, ROS_MASTER_URI=f'http://localhost:{port}', ROS_HOME=str(tmp_path))
        result = subprocess.run(['roslaunch', '-p', str(port), str(ROOT / f'launch/{launch}.launch'), *arguments], env=environment,
                                capture_output=True, text=True, check=False)
    return result.stdout + result.stderr


def test_no_hardware_source(tmp_path):
    said = said_by(tmp_path, 'intraop')
    assert 'source' in said and 'site.yaml' in said
    assert 'stereo_driver' in said and 'REQUIRED' in said


def test_no_such_bag(tmp_path):
    said = said_by(tmp_path, 'replay', f'bag:={tmp_path}/no_such.bag')
    assert f'{tmp_path}/no_such.bag: no such file; give bag:=FILE' in said
    assert 'rosbag_play is REQUIRED' in said
