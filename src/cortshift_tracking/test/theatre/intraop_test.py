"""intraop.launch without hardware: refuses to start and says what to set."""
import os
import pathlib
import socket
import subprocess

ROOT = pathlib.Path(__file__).resolve().parents[4]


def test_refuses_without_a_hardware_source(tmp_path):
    with socket.socket() as holder:
        # Ours while the master runs: it may bind the port once more, since nobody listens; nobody else is given it.
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        holder.bind(('localhost', 0))
        port = holder.getsockname()[1]
        environment = dict(os.environ, ROS_MASTER_URI=f'http://localhost:{port}', ROS_HOME=str(tmp_path))
        result = subprocess.run(['roslaunch', '-p', str(port), str(ROOT / 'launch/intraop.launch')], env=environment,
                                capture_output=True, text=True, check=False)
    said = result.stdout + result.stderr
    assert 'source' in said and 'site.yaml' in said
    assert 'stereo_driver' in said and 'REQUIRED' in said  # roslaunch ended the graph
