"""How tests are declared: each has one label and a limit that works."""
import json
import os
import pathlib
import re
import subprocess
import sys
import time

import pytest

PACKAGES = pathlib.Path(__file__).resolve().parents[2]
FUNCTION = PACKAGES / 'cortshift_flow/cmake/cortshift_test.cmake'
PROJECT = f"""
cmake_minimum_required(VERSION 3.16)
project(scratch CXX)
find_package(catkin REQUIRED)
catkin_package()
include({FUNCTION})
cortshift_test(hanging_test pytest quick 5 FILES hanging_test.py)
"""
PACKAGE = """<package format="2"><name>scratch</name><version>0.0.0</version><description>-</description><license>-</license>
<maintainer email="nobody@example.org">-</maintainer><buildtool_depend>catkin</buildtool_depend></package>"""
HANGING = """
import pathlib, subprocess
def test_that_hangs():
    child = subprocess.Popen(['sleep', '600'])
    pathlib.Path('child').write_text(str(child.pid))
    child.wait()
"""


def runs(pid):
    """Whether a process is there and is more than an entry that nobody has asked for."""
    try:
        return pathlib.Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()[0] != 'Z'
    except FileNotFoundError:
        return False


def test_a_test_that_hangs_is_killed_with_what_it_started(tmp_path):
    (tmp_path / 'hanging_test.py').write_text(HANGING)
    (tmp_path / 'CMakeLists.txt').write_text(PROJECT)
    (tmp_path / 'package.xml').write_text(PACKAGE)
    subprocess.run(['cmake', '-S', tmp_path, '-B', tmp_path / 'build', '-DPYTHON_EXECUTABLE=' + sys.executable], check=True)
    done = subprocess.run(['ctest'], cwd=tmp_path / 'build', capture_output=True, text=True, check=False)
    assert done.returncode != 0 and '***Timeout' in done.stdout, done.stdout
    end = time.monotonic() + 20   # the signal is sent; on a busy machine dying takes its time
    while runs((tmp_path / 'child').read_text()) and time.monotonic() < end:
        time.sleep(0.05)
    assert not runs((tmp_path / 'child').read_text())


@pytest.mark.parametrize('arguments, complaint', [
    ('t pytest fast 5 FILES t.py', "label quick, graph or long and a limit in seconds, not 'fast'"),
    ('t pytest quick soon FILES t.py', "not 'quick' 'soon'"),
    ('t pytest quick 0 FILES t.py', "not 'quick' '0'"),
    ('t nosetests quick 5 FILES t.py', "kind 'nosetests' is none of"),
    ('t rostest quick 5 FILES t.test', 'labelled graph, not quick'),
    ('t pytest quick 5 FILES t.py WAITS', 'WAITS is said of graphs'),
    ('t pytest quick 5', 'no FILES')])
def test_a_declaration_that_lacks_something_is_refused(tmp_path, arguments, complaint):
    script = tmp_path / 'declare.cmake'
    script.write_text(f'include({FUNCTION})\ncortshift_test({arguments})\n')
    done = subprocess.run(['cmake', '-P', script], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert complaint in re.sub(r'\s+', ' ', done.stderr)


def test_every_test_of_the_build_has_a_label_and_a_limit():
    told = subprocess.run(['ctest', '--show-only=json-v1'], cwd=os.environ['BUILD_FOLDER'], capture_output=True, text=True,
                          check=True).stdout
    tests = json.loads(told)['tests']
    assert tests
    for test in tests:
        properties = {entry['name']: entry['value'] for entry in test['properties']}
        assert len(properties.get('LABELS', [])) == 1, f'{test["name"]}: labels {properties.get("LABELS")}'
        assert properties['LABELS'][0] in ('quick', 'graph', 'long'), test['name']
        assert properties.get('TIMEOUT', 0) > 0, f'{test["name"]} has no limit'
