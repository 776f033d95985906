"""Every shipped YAML, launch file and rviz view loads, and what it names exists."""
import pathlib
import subprocess

import pytest
import roslaunch
import yaml
from roslib.packages import find_node

ROOT = pathlib.Path(__file__).resolve().parents[4]
YAML_FILES = sorted(p for folder in ('config', 'launch') for p in (ROOT / folder).rglob('*') if p.suffix in ('.yaml', '.rviz'))
LAUNCH_FILES = sorted((ROOT / 'launch').rglob('*.launch'))


def test_something_is_shipped():
    assert len(YAML_FILES) >= 4 and len(LAUNCH_FILES) >= 3


@pytest.mark.parametrize('path', YAML_FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_yaml_loads(path):
    assert yaml.safe_load(path.read_text())


@pytest.mark.parametrize('arguments', [[], ['rviz:=true']], ids=['plain', 'rviz'])
@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_launch_file_loads(path, arguments):
    if path.parent.name == 'include' and arguments == []:
        arguments = ['rviz:=false']
    config = roslaunch.config.load_config_default([(str(path), arguments)], port=None, assign_machines=False)
    assert config.nodes
    for node in config.nodes:
        assert find_node(node.package, node.type), f'{path.name}: {node.package}/{node.type} does not exist'


def test_replay_with_static_tf_and_bag():
    config = roslaunch.config.load_config_default([(str(ROOT / 'launch/replay.launch'), ['bag:=x.bag', 'static_tf:=y.yaml'])],
                                                  port=None, assign_machines=False)
    assert {'publish_static_tf', 'rosbag_play'} <= {node.name for node in config.nodes}


def test_gravity_of_phantom_launch_is_that_of_its_case():
    config = roslaunch.config.load_config_default([str(ROOT / 'launch/phantom.launch')], port=None, assign_machines=False)
    case = yaml.safe_load((ROOT / 'config/phantom/phantom_case.yaml').read_text())
    assert config.params['/shift_tracker/gravity'].value == case['gravity_in_pmr']


def test_rviz_view_shows_cloud_arrows_and_axes():
    view = yaml.safe_load((ROOT / 'config/rviz/shift.rviz').read_text())
    shown = {d['Class'] for d in view['Visualization Manager']['Displays'] if d['Enabled']}
    assert {'rviz/PointCloud2', 'rviz/MarkerArray', 'rviz/Axes'} <= shown


@pytest.mark.parametrize('text, complaint', [
    ('[]', 'expected a list'),
    ('- {parent: pmr, child: reference, translation: [0, 0, 0]}', 'exactly the keys'),
    ('- {parent: pmr, child: reference, translation: [0, 0], rotation: [0, 0, 0, 1]}', 'translation must be 3'),
    ('- {parent: pmr, child: reference, translation: [0, 0, .nan], rotation: [0, 0, 0, 1]}', 'translation must be 3'),
    ('- {parent: pmr, child: reference, translation: [0, 0, 0], rotation: [0, 0, 0, 2]}', 'length 2.0'),
])
def test_static_tf_refuses(tmp_path, text, complaint):
    file = tmp_path / 'static.yaml'
    file.write_text(text)
    result = subprocess.run(find_node('cortshift_stereo', 'publish_static_tf')[:1] + [str(file)], capture_output=True, text=True, timeout=60)
    assert result.returncode == 1
    assert complaint in result.stderr and str(file) in result.stderr
