"""The house stays in order: who may include whom, how long a file may be, where tests live and that they run.

Each rule is also shown a small project that breaks it: a rule that finds nothing anywhere would prove nothing."""
import os
import pathlib

import house
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[3]
BUILD = pathlib.Path(os.environ.get('CORTSHIFT_BUILD', ROOT / 'build'))

STEREO_CORE = {'stereo', 'stereo/geometry', 'stereo/calibration', 'stereo/rectification', 'stereo/matching', 'stereo/refinement',
               'stereo/averaging', 'stereo/admission', 'stereo/images'}
TRACKING_CORE = {'tracking', 'tracking/projection', 'tracking/matching', 'tracking/field', 'tracking/surround', 'tracking/trust'}

# Room (package/folder) to the rooms that its files may include, besides their own. A package without a folder stands for the
# files above the folders, such as the settings and the step that calls all others.
ROOMS = {
    'flow': {'flow/*'},
    'flow/images': {'flow', 'flow/start', 'flow/variational'},
    'flow/variational': {'flow', 'flow/images'},
    'flow/start': {'flow', 'flow/images', 'flow/variational', 'flow/trust'},
    'flow/polish': {'flow', 'flow/images', 'flow/variational', 'flow/start', 'flow/trust'},
    'flow/trust': {'flow', 'flow/images', 'flow/variational', 'flow/polish'},
    'flow/phantom': {'flow'},   # how loops are compiled
    'stereo': STEREO_CORE | {'flow'},
    'stereo/geometry': {'stereo'},
    'stereo/images': set(),
    'stereo/calibration': {'stereo', 'stereo/geometry', 'stereo/images', 'flow'},
    'stereo/rectification': {'stereo', 'stereo/geometry', 'stereo/calibration', 'stereo/admission'},
    'stereo/matching': {'stereo', 'stereo/geometry', 'stereo/rectification'},
    'stereo/refinement': {'stereo', 'stereo/geometry', 'stereo/rectification', 'flow'},
    'stereo/averaging': {'stereo', 'stereo/geometry', 'stereo/rectification', 'stereo/refinement', 'stereo/admission'},
    'stereo/admission': STEREO_CORE | {'flow'},   # judges what is known of all of them
    'stereo/phantom': {'stereo', 'stereo/geometry', 'stereo/calibration', 'stereo/rectification', 'flow/phantom', 'flow'},
    'stereo/sources': STEREO_CORE | {'stereo/phantom', 'flow'},
    'stereo/ros': {'stereo/*', 'flow'},
    'stereo/nodes': {'stereo/*'},
    'tracking': TRACKING_CORE | STEREO_CORE | {'flow'},
    'tracking/projection': {'tracking', 'stereo/geometry', 'flow'},
    'tracking/matching': {'tracking', 'tracking/projection', 'tracking/trust', 'flow'},
    'tracking/trust': {'tracking', 'tracking/projection', 'tracking/matching', 'stereo/geometry', 'flow'},
    'tracking/field': TRACKING_CORE | {'tracking/case', 'stereo', 'stereo/geometry', 'flow'},   # of case the names of stages alone
    'tracking/surround': TRACKING_CORE | {'stereo', 'stereo/geometry', 'stereo/refinement', 'flow'},
    'tracking/case': TRACKING_CORE | STEREO_CORE | {'stereo/ros'},
    'tracking/igtl': {'tracking', 'flow', 'stereo', 'tracking/case'},   # of case what a key is alone
    'tracking/model': TRACKING_CORE | STEREO_CORE | {'flow'},
    'tracking/phantom': TRACKING_CORE | STEREO_CORE | {'stereo/phantom', 'flow/phantom'},
    'tracking/ros': TRACKING_CORE | STEREO_CORE | {'stereo/ros', 'tracking/case', 'tracking/igtl', 'tracking/model', 'flow'},
    'tracking/offline': TRACKING_CORE | STEREO_CORE | {'stereo/ros', 'tracking/case', 'tracking/ros', 'flow'},
    'tracking/nodes': {'tracking/*', 'stereo/ros', 'stereo', 'stereo/geometry'},
}

# Rooms that may see ROS; all others are core.
BORDER = {'stereo/ros', 'stereo/nodes', 'tracking/ros', 'tracking/nodes', 'tracking/case', 'tracking/offline'}

# Of these, the rooms that know messages and bags as a format of files alone.
FILES_ONLY = {'tracking/case', 'tracking/offline'}

PYTHON_ROOMS = {
    'top': set(),
    'case': {'top', 'probe'},
    'probe': {'top'},
    'mr': {'top', 'case'},
    'report': {'top', 'case', 'mr', 'probe'},
    'cohort': {'top', 'case', 'report'},
    'deidentify': {'top', 'case', 'mr', 'probe', 'report'},
    'export': {'top', 'case'},
    'console': {'top', 'case'},
    'theatre': {'top', 'case'},
    'model': {'top', 'case', 'mr', 'probe'},
}

# Longer than MOST_LINES because one job needs it; with the job.
LONG = {}

RULES = {
    'no file includes itself through others': house.include_cycles,
    'no Python module imports itself through others': house.import_cycles,
    'rooms include what they may know': lambda root: house.broken_rooms(root, ROOMS),
    'Python rooms import what they may know': lambda root: house.broken_python_rooms(root, PYTHON_ROOMS),
    'cores see no ROS header': lambda root: house.ros_in_cores(root, BORDER),
    'rooms of files have no log': lambda root: house.logs_of_files(root, FILES_ONLY),
    'files have one job': lambda root: house.long_files(root, LONG),
    'folders can be overlooked': house.full_folders,
    'tests have one name': house.misnamed_tests,
    'every test is run': lambda root: house.unreached_tests(root, BUILD),
    'nothing outside the project is named': house.paths_outside,
}


@pytest.mark.parametrize('rule', RULES)
def test_house_keeps(rule):
    assert RULES[rule](ROOT) == []


def test_rooms_are_all_there():
    """The rules look at something: every package, every folder of the cores, more than a few files."""
    rooms = {house.room_of(ROOT, path) for path in house.cpp_graph(ROOT)}
    assert rooms >= STEREO_CORE | (TRACKING_CORE - {'tracking/surround'}) | {'flow', 'flow/polish', 'stereo/phantom', 'tracking/ros'}
    assert sum(len(own) for own, _ in house.cpp_graph(ROOT).values()) > 500
    assert sum(len(targets) for targets in house.python_graph(ROOT).values()) > 50
    assert len(list(house.files_of_tests(ROOT))) > 80


# ---- each rule on a project that breaks it --------------------------------------------------------------------------------

@pytest.fixture
def small(tmp_path):
    """A project of a few files that keeps every rule, and a function that adds one."""
    def add(name, text=''):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path
    for top in house.TOP_FOLDERS:
        (tmp_path / top).mkdir()
    for package in house.PACKAGES:
        (tmp_path / 'src' / package).mkdir()
    add('src/cortshift_tracking/include/cortshift_tracking/field/a.hpp', '#include <vector>\n')
    add('src/cortshift_tracking/include/cortshift_tracking/ros/b.hpp', '#include <ros/ros.h>\n#include "cortshift_tracking/field/a.hpp"\n')
    add('src/cortshift_tracking/src/field/a.cpp', '#include "cortshift_tracking/field/a.hpp"\n')
    add('src/cortshift_tracking/src/cortshift_tracking/__init__.py')
    add('src/cortshift_tracking/src/cortshift_tracking/errors.py')
    add('src/cortshift_tracking/src/cortshift_tracking/case/__init__.py', 'from cortshift_tracking.errors import Any\n')
    add('src/cortshift_tracking/test/field/a_test.cpp', 'TEST(A, Holds) {}\n')
    add('script/run', '#!/bin/bash\ncd "$(dirname "$0")/.."\n')
    tmp_path.joinpath('build').mkdir()
    add('build/CTestTestfile.cmake', 'add_test(a_test)\n')
    add('build/CMakeFiles/a_test.dir/build.make', 'src/cortshift_tracking/test/field/a_test.cpp\n')
    small_rules = dict(RULES, **{'files have one job': lambda root: house.long_files(root, {}),
                                 'every test is run': lambda root: house.unreached_tests(root, root / 'build')})
    add.broken = lambda: {rule for rule in small_rules if small_rules[rule](tmp_path)}
    add.root = tmp_path
    return add


def test_a_project_in_order_breaks_nothing(small):
    assert small.broken() == set()


@pytest.mark.parametrize('rule, name, text', [
    ('no file includes itself through others', 'src/cortshift_tracking/include/cortshift_tracking/field/a.hpp',
     '#include "cortshift_tracking/ros/b.hpp"\n'),
    ('no Python module imports itself through others', 'src/cortshift_tracking/src/cortshift_tracking/errors.py',
     'def late():\n    from cortshift_tracking import case\n'),
    ('rooms include what they may know', 'src/cortshift_tracking/src/projection/c.cpp', '#include "cortshift_tracking/field/a.hpp"\n'),
    ('rooms include what they may know', 'src/cortshift_tracking/src/attic/c.cpp', ''),
    ('Python rooms import what they may know', 'src/cortshift_tracking/src/cortshift_tracking/export/x.py',
     'from cortshift_tracking.console import page\n'),
    ('cores see no ROS header', 'src/cortshift_tracking/src/trust/c.cpp', '#include <sensor_msgs/Image.h>\n'),
    ('cores see no ROS header', 'src/cortshift_tracking/src/trust/c.cpp', '#include "cortshift_tracking/ros/b.hpp"\n'),
    ('rooms of files have no log', 'src/cortshift_tracking/src/case/c.cpp', '#include <ros/console.h>\n'),
    ('files have one job', 'src/cortshift_tracking/src/field/long.cpp', '\n' * 401),
    ('files have one job', 'script/long', '#!/usr/bin/python3\n' + '\n' * 400),
    ('tests have one name', 'src/cortshift_tracking/test/field/check_a.cpp', 'TEST(A, Holds) {}\n'),
    ('tests have one name', 'src/cortshift_tracking/test/field/alone.test', '<launch/>\n'),
    ('tests have one name', 'src/cortshift_tracking/test/support/help_test.py', ''),
    ('every test is run', 'src/cortshift_tracking/test/field/b_test.cpp', 'TEST(B, Holds) {}\n'),
    ('every test is run', 'src/cortshift_tracking/test/field/b_test.py', 'def test_b():\n    pass\n'),
    ('nothing outside the project is named', 'config/site.yaml', 'folder: ' + '/ho' + 'me/someone/case\n'),
    ('nothing outside the project is named', 'script/reach', '#!/bin/bash\nls "$(dirname "$0")/../../sha' + 'red"\n'),
])
def test_rule_finds(small, rule, name, text):
    small(name, text)
    if 'console' in text:
        small('src/cortshift_tracking/src/cortshift_tracking/console/page.py')
    assert rule in small.broken()


def test_rule_finds_a_full_folder(small):
    for number in range(16):
        small(f'src/cortshift_tracking/src/field/part_{number}.cpp')
    assert small.broken() == {'folders can be overlooked'}


def test_rule_finds_an_excuse_that_is_not_needed(small):
    assert house.long_files(small.root, {'src/cortshift_tracking/src/field/a.cpp': 'it was long once'})
