"""Paths in launch files and scripts: with blanks and letters of any language, and as seen from the folder of the caller."""
import os
import pathlib
import shlex
import shutil
import subprocess

import pytest
from cortshift_tracking.theatre.launched import own_parameter
from graph import loaded
from roslaunch.core import RLException

ROOT = pathlib.Path(__file__).resolve().parents[4]
NAMES = ['plain', "O'Brien, Müller データ"]
#: Every argument that is a path: launch file, argument, the parameter that it becomes, and what else must be given.
PATHS = [('replay', 'bag', '/rosbag_play/bag', []), ('replay', 'static_tf', '/publish_static_tf/file', []),
         ('replay', 'case_folder', '/shift_tracker/case_folder', []), ('replay', 'case_folder', '/probe/case', []),
         ('replay', 'settings_calibration', '/surface_reconstruction/settings_calibration', []),
         ('phantom', 'case', '/stereo_driver/phantom_case', []), ('phantom', 'case_folder', '/shift_tracker/case_folder', []),
         ('intraop', 'site', '/preflight/site', []), ('intraop', 'case_folder', '/probe/case', []),
         ('intraop', 'settings_calibration', '/surface_reconstruction/settings_calibration', []),
         ('capture_pc', 'phantom', '/stereo_driver/phantom_case', []), ('capture_pc', 'site', '/preflight/site', []),
         ('compute_pc', 'case_folder', '/shift_tracker/case_folder', []), ('two_machines', 'case_folder', '/probe/case', []),
         *[(launch, 'model', '/brain_model/model', ['case_folder:=case']) for launch in ('phantom', 'replay', 'intraop', 'compute_pc')],
         ('replay', 'case_folder', '/brain_model/case', ['model:=model.npz'])]


@pytest.fixture(params=NAMES)
def place(tmp_path, monkeypatch, request):
    """The caller's folder, of that name, with a site file in it."""
    folder = tmp_path / request.param
    folder.mkdir()
    shutil.copy(ROOT / 'config/site.yaml', folder / 'a file.yaml')
    monkeypatch.chdir(folder)
    return folder


def parameters(launch, *arguments):
    config = loaded(ROOT / f'launch/{launch}.launch', *arguments)
    return {name: parameter.value for name, parameter in config.params.items()}, config


@pytest.mark.parametrize('launch', ['phantom', 'replay', 'intraop'])
def test_no_brain_model_without_a_model(launch):
    def nodes(*more):
        return [node.name for node in parameters(launch, 'case_folder:=case', *more)[1].nodes]
    assert 'brain_model' not in nodes() and 'brain_model' in nodes('model:=model.npz')


@pytest.mark.parametrize('launch', ['phantom', 'replay', 'intraop', 'compute_pc'])
def test_a_model_without_a_case_folder_ends_the_launch_with_what_to_give(launch, capfd):
    with pytest.raises(RLException):
        parameters(launch, 'model:=model.npz')
    assert 'model:= keeps the MR up to date in the folder of the case: give case_folder:=DIR beside it' in capfd.readouterr().err


def test_the_brain_model_goes_with_its_graph_into_a_namespace(tmp_path):
    (tmp_path / 'or1.launch').write_text(f'<launch><group ns="or1"><include file="{ROOT}/launch/phantom.launch"><arg name="model" value="/m.npz"/>'
                                         '<arg name="case_folder" value="/case"/></include></group></launch>')
    config = loaded(tmp_path / 'or1.launch')
    assert [node.namespace for node in config.nodes if node.name == 'brain_model'] == ['/or1/']
    given = {name: parameter.value for name, parameter in config.params.items() if 'brain_model' in name}
    assert given['/or1/brain_model/model'] == '/m.npz' and given['/or1/brain_model/case'] == '/case'
    assert all(name.startswith('/or1/') for name in given)


@pytest.mark.parametrize('given', ['a file.yaml', './a file.yaml', '{here}/a file.yaml'])
@pytest.mark.parametrize('launch', sorted({path[0] for path in PATHS}))
def test_paths_are_those_of_the_caller(place, launch, given):
    """Each argument by itself: two of them may lead to one parameter."""
    for _, argument, parameter, more in (path for path in PATHS if path[0] == launch):
        found = parameters(launch, f'{argument}:={given.format(here=place)}', *more)[0][parameter]
        assert found == str(place / 'a file.yaml'), f'{argument} as {parameter}'


def test_no_path_is_a_word_of_a_command_line(place):
    """roslaunch splits a node's arguments at blanks."""
    for launch, argument, _, more in PATHS:
        _, config = parameters(launch, f'{argument}:=a file.yaml', 'rviz:=true' if launch != 'capture_pc' else 'record:=true', *more)
        for node in config.nodes:
            assert 'a file' not in node.args, f'{launch} {node.name}: {node.args}'


def test_the_other_machine_finds_its_environment(place):
    """roslaunch puts env-loader into a command line of that machine's shell."""
    for folder in ('launch', 'script', 'config'):
        shutil.copytree(ROOT / folder, place / folder)
    config = loaded(place / 'launch/two_machines.launch')
    loader, = shlex.split(config.machines['compute_pc'].env_loader)
    assert pathlib.Path(loader).samefile(place / 'script/machine')


def test_live_graphs_set_the_clock_that_a_replay_leaves_behind():
    for launch in ('intraop', 'phantom', 'capture_pc', 'compute_pc', 'two_machines'):
        assert parameters(launch)[0]['/use_sim_time'] is False, launch
    assert parameters('replay')[0]['/use_sim_time'] is True


@pytest.mark.parametrize('given, seen', [('x y', '{here}/x y'), ('/a/../b c', '/b c'), ('~/d', '{home}/d'), ('ä/../ö', '{here}/ö')])
def test_absolute_path(tmp_path, given, seen):
    done = subprocess.run([str(ROOT / 'script/absolute_path'), given], capture_output=True, text=True, cwd=tmp_path, check=True)
    assert done.stdout == seen.format(here=tmp_path, home=os.environ['HOME'])


@pytest.mark.parametrize('form', [['--site', 'my site.yaml'], ['--site=my site.yaml']])
def test_preflight_reads_the_file_of_the_caller(place, form):
    (place / 'my site.yaml').write_text('preflight: {weeks: 3}\n')
    done = subprocess.run([str(ROOT / 'script/preflight'), *form], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and f'{place}/my site.yaml: preflight/weeks is unknown' in done.stderr


@pytest.mark.parametrize('words', [['__name:=rosbag_play'], [], ['bag.bag']])
def test_no_parameter_without_a_master(monkeypatch, words):
    monkeypatch.setenv('ROS_MASTER_URI', 'http://localhost:1')
    assert own_parameter('bag', words) == ''


def test_a_bag_that_is_not_there_is_named(monkeypatch):
    monkeypatch.setenv('ROS_MASTER_URI', 'http://localhost:1')
    done = subprocess.run([str(ROOT / 'src/cortshift_tracking/scripts/play_case'), '--clock', '__name:=x'], capture_output=True, text=True,
                          check=False)
    assert done.returncode == 1 and 'no such file; give bag:=FILE' in done.stderr
