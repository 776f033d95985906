"""intraop.launch without hardware: refuses to start and says what to set."""
import os
import pathlib
import socket
import subprocess

ROOT = pathlib.Path(__file__).resolve().parents[4]


def test_refuses_without_a_hardware_source():
    with socket.socket() as s:
        s.bind(('localhost', 0))
        port = s.getsockname()[1]
    environment = dict(os.environ, ROS_MASTER_URI=f'http://localhost:{port}')
    result = subprocess.run(['roslaunch', '-p', str(port), str(ROOT / 'launch/intraop.launch')], env=environment,
                            capture_output=True, text=True, timeout=120)
    said = result.stdout + result.stderr
    assert 'source' in said and 'site.yaml' in said
    assert 'stereo_driver' in said and 'REQUIRED' in said  # roslaunch ended the graph
