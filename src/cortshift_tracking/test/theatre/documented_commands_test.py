"""Every command of the README and of doc/ stands there as it works: what it names exists, and knows the options that it is given."""
import pathlib
import re
import shlex
import subprocess

import pytest
import rosservice
import yaml
from graph import loaded
from roslib.message import get_service_class
from roslib.packages import find_node

ROOT = pathlib.Path(__file__).resolve().parents[4]
BLOCK = re.compile(r'^```sh\n(.*?)^```', re.MULTILINE | re.DOTALL)
INLINE = re.compile(r'`((?:roslaunch|rosrun|rosservice call|script/)[^`]*)`')
DOCUMENTS = [ROOT / 'README.md', *sorted((ROOT / 'doc').glob('*.md'))]
#: Services that they call, with their types: the graph that has them does not run here.
SERVICES = {'/shift_tracker/capture_stage': 'CaptureStage', '/shift_tracker/compute_shift': 'ComputeShift',
            '/stereo_driver/set_stage': 'SetPhantomStage'}


def commands():
    text = '\n'.join(path.read_text(encoding='utf-8') for path in DOCUMENTS).replace('\\\n', ' ')   # a line that goes on below
    lines = [line.split(' #')[0].strip() for block in BLOCK.findall(text) for line in block.splitlines()]
    return sorted({line for line in lines + [line.strip() for line in INLINE.findall(text)] if line and not line.startswith('#')})


def words_of(command):
    words = shlex.split(command)
    while words and ('=' in words[0] and ':=' not in words[0] or words[0] in ('export', 'script/machine')):
        words.pop(0)
    return words


@pytest.fixture(scope='module')
def helps():
    """What a program answers to --help, asked once."""
    known = {}

    def ask(*command):
        if command not in known:
            done = subprocess.run([*command, '--help'], capture_output=True, text=True, timeout=60, check=False, cwd=ROOT)
            assert done.returncode == 0, f'{command}: {done.stdout}{done.stderr}'
            known[command] = done.stdout
        return known[command]
    return ask


def test_there_are_commands():
    assert len(commands()) > 25 and any(line.startswith('roslaunch') for line in commands())


@pytest.mark.parametrize('command', [c for c in commands() if 'roslaunch' in words_of(c)[:1]])
def test_launch_files_take_their_arguments(command):
    words = [word for word in words_of(command)[1:] if not word.startswith('--')]
    file, arguments = words[0], [word.replace('$PWD', str(ROOT)) for word in words[1:]]
    config = loaded(ROOT / file, *arguments)
    assert config.nodes
    text = (ROOT / file).read_text()
    for argument in arguments:
        assert f'<arg name="{argument.split(":=")[0]}"' in text, argument


@pytest.mark.parametrize('command', [c for c in commands() if words_of(c)[:1] == ['rosrun']])
def test_tools_are_there_and_know_their_options(command, helps):
    _, package, name, *rest = words_of(command)
    for tool in [name.rstrip(',')] + [word for word in command.split('`, `')[1:]]:
        assert find_node(package, tool), f'{package} has no {tool}'
    told = helps('rosrun', package, name.rstrip(','))
    for option in (word.split('=')[0] for word in rest if word.startswith('--')):
        assert option in told, option


@pytest.mark.parametrize('command', [c for c in commands() if words_of(c)[:1] and words_of(c)[0].startswith('script/')])
def test_scripts_answer(command, helps):
    script, *rest = words_of(command)
    told = helps(str(ROOT / script))
    for option in (word.split('=')[0] for word in rest if word.startswith('--') and word != '--profile'):
        assert option in told, option


@pytest.mark.parametrize('command', [c for c in commands() if words_of(c)[:2] == ['rosservice', 'call']])
def test_service_calls_fit_their_types(command):
    _, _, name, text = words_of(command)
    kind = get_service_class('cortshift_msgs/' + SERVICES[name])
    request = kind._request_class()
    rosservice.genpy.message.fill_message_args(request, [yaml.safe_load(text)])
    assert all(getattr(request, key) == value for key, value in yaml.safe_load(text).items())


@pytest.mark.parametrize('command', [c for c in commands()])
def test_every_command_is_of_a_kind_that_is_looked_at(command):
    words = words_of(command)
    assert not words or words[0] in ('roslaunch', 'rosrun', 'rosservice', 'source', 'rosparam') or words[0].startswith('script/'), command
