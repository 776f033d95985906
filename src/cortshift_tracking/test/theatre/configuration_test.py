"""Every shipped YAML, launch file and rviz view loads, and what it names exists."""
import pathlib
import subprocess

import pytest
import yaml
from graph import loaded
from programs import program
from roslib.packages import find_node
from site_example import with_examples

ROOT = pathlib.Path(__file__).resolve().parents[4]
YAML_FILES = sorted(p for folder in ('config', 'launch') for p in (ROOT / folder).rglob('*') if p.suffix in ('.yaml', '.rviz'))
LAUNCH_FILES = sorted((ROOT / 'launch').rglob('*.launch'))


def test_something_is_shipped():
    assert len(YAML_FILES) >= 4 and len(LAUNCH_FILES) >= 3


class StrictLoader(yaml.SafeLoader):
    """As YAML wants it: a key that stands twice is an error, where PyYAML takes the last one."""

    def construct_mapping(self, node, deep=False):
        keys = [self.construct_object(key, deep=deep) for key, _ in node.value]
        assert len(keys) == len(set(keys)), f'twice: {sorted(key for key in keys if keys.count(key) > 1)}{node.start_mark}'
        return super().construct_mapping(node, deep)


def load(path):
    return yaml.load(path.read_text(), StrictLoader)


@pytest.mark.parametrize('path', YAML_FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_yaml_says_everything_once(path):
    assert isinstance(load(path), dict)


def test_a_key_that_stands_twice_is_seen(tmp_path):
    (tmp_path / 'x.yaml').write_text('a: {b: 1, c: 2, b: 3}')
    with pytest.raises(AssertionError, match="twice: .'b', 'b'"):
        load(tmp_path / 'x.yaml')


@pytest.mark.parametrize('path', sorted((ROOT / 'config/phantom').glob('*.yaml')), ids=lambda p: p.name)
def test_phantom_case_is_understood(path):
    """By the phantom's own reader: the middle of the craniotomy is on the surface, and moves to where the last stage says."""
    stages = [stage['name'] for stage in load(path)['stages']]
    told = subprocess.run([program('phantom_truth', 'cortshift_stereo'), str(path), stages[0], stages[-1], '--material'],
                          input='0,0\n', capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stderr
    header, line = (row.split(',') for row in told.stdout.splitlines())
    row = dict(zip(header, map(float, line)))
    moved = sum(row[name] ** 2 for name in ('dx_m', 'dy_m', 'dz_m')) ** 0.5
    deformations = [yaml.dump(stage.get('deformation')) for stage in (load(path)['stages'][0], load(path)['stages'][-1])]
    assert row['rim_m'] > 0.01 and (moved > 0.001) == (deformations[0] != deformations[1])


def test_site_names_parameters_that_its_nodes_have():
    """Those in the comments too: a site takes the # away."""
    site = yaml.load(with_examples((ROOT / 'config/site.yaml').read_text()), StrictLoader)
    assert {'stereo_driver', 'igtl_bridge', 'shift_tracker'} <= set(site)
    launched = loaded(ROOT / 'launch/phantom.launch')
    for node, parameters in site.items():
        own = ROOT / f'config/{node}.yaml'
        if own.exists():
            given = {name.split('/')[2] for name in launched.params if name.startswith(f'/{node}/')}
            unknown = set(parameters) - set(load(own)) - given
            assert not unknown, f'{node}: {unknown}'


@pytest.mark.parametrize('path', sorted((ROOT / 'src').glob('*/test/**/*.test')), ids=lambda p: p.name)
def test_what_a_graph_test_runs_is_there(path):
    config = loaded(path)
    assert config.tests
    for node in [*config.nodes, *config.tests]:
        assert find_node(node.package, node.type), f'{path.name}: {node.package}/{node.type} does not exist'


@pytest.mark.parametrize('arguments', [[], ['rviz:=true']], ids=['plain', 'rviz'])
@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_launch_file_loads(path, arguments):
    if path.parent.name == 'include' and arguments == []:
        arguments = ['rviz:=false']
    config = loaded(path, *arguments)
    assert config.nodes
    for node in config.nodes:
        assert find_node(node.package, node.type), f'{path.name}: {node.package}/{node.type} does not exist'


def test_replay_with_static_tf_and_bag():
    config = loaded(ROOT / 'launch/replay.launch', 'bag:=x.bag', 'static_tf:=y.yaml')
    assert {'publish_static_tf', 'rosbag_play'} <= {node.name for node in config.nodes}


def test_gravity_of_phantom_launch_is_that_of_its_case():
    config = loaded(ROOT / 'launch/phantom.launch')
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
