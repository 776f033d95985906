"""process_bag, validate_bag and recompute on small recorded cases: agreement, damaged bags, refusals, long recordings."""
import filecmp
import os
import re
import shutil
import subprocess

import numpy as np
import pytest
import rosbag
import yaml
from cortshift_tracking.case.messages import cloud_arrays

import recorded_cases as cases
from graph import field_arrays
from offline_tools import read_field, run_tool
from programs import program

SHIFT = ':'.join(cases.STAGES)
FIELD = '__'.join(cases.STAGES) + '.bag'
IMAGE_ENDING = 'image_raw/compressed'


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    """A small case: (bag, phantom description, what process_bag makes of it)."""
    folder = str(tmp_path_factory.mktemp('recorded'))
    bag, description = cases.record(folder, 'case')
    process(bag, os.path.join(folder, 'out'))
    return bag, description, os.path.join(folder, 'out')


def process(bag, output, *arguments, config=cases.CONFIG, status=0):
    return run_tool('process_bag', bag, '--capture', *cases.CAPTURES, '--shift', SHIFT, '--output', output, '--config', config,
                    *arguments, status=status)


def same_files(a, b):
    """Every file but timing.csv is the same, bit for bit."""
    names = sorted(os.path.relpath(os.path.join(place, name), a) for place, _, found in os.walk(a) for name in found)
    others = sorted(os.path.relpath(os.path.join(place, name), b) for place, _, found in os.walk(b) for name in found)
    assert names == others and len(names) == 6
    return all(filecmp.cmp(os.path.join(a, name), os.path.join(b, name), False) for name in names if name != 'timing.csv')


@pytest.mark.parametrize('threads', [1, 2])
def test_bit_identical(recorded, tmp_path, threads):
    process(recorded[0], tmp_path / 'out', '--threads', threads)
    assert same_files(recorded[2], str(tmp_path / 'out'))


def test_field_is_right(recorded):
    output, _ = run_tool('field_error', '--case', recorded[1], '--from', cases.STAGES[0], '--to', cases.STAGES[1],
                         os.path.join(recorded[2], FIELD))
    error = {name: float(value) for name, value in (line.split(': ') for line in output.splitlines())}
    # Measured: 0.132 / 0.490 mm and 96 %; a pixel of disparity is 3 mm of height here.
    assert error['error_median_mm'] < 0.2 and error['error_p95_mm'] < 0.75 and error['coverage'] > 0.9


def test_summary(recorded):
    with open(os.path.join(recorded[2], 'summary.csv'), encoding='utf-8') as file:
        header, line = (row.split(',') for row in file.read().splitlines())
    row = dict(zip(header, line))
    summary = read_field(os.path.join(recorded[2], FIELD)).summary
    assert (row['from_key'], row['to_key']) == cases.STAGES and int(row['valid_points']) == summary.valid_points
    assert float(row['magnitude_mean_m']) == summary.magnitude_mean and row['gravity_mean_m'] == ''
    assert np.isnan([summary.compute_time, summary.latency]).all()   # wall times would differ from run to run


def test_plan_file(recorded, tmp_path):
    plan = {'captures': [{'key': key, 'at': float(at)} for key, at in (text.split('@') for text in cases.CAPTURES)],
            'shifts': [dict(zip(('from', 'to'), cases.STAGES))]}
    (tmp_path / 'plan.yaml').write_text(yaml.safe_dump(plan))
    run_tool('process_bag', recorded[0], '--plan', tmp_path / 'plan.yaml', '--output', tmp_path / 'out', '--config', cases.CONFIG)
    assert same_files(recorded[2], str(tmp_path / 'out'))


# ---- bags of every kind

def fields_agree(a, b):
    for one, other in zip(field_arrays(read_field(a)), field_arrays(read_field(b))):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize('kind', ['bz2', 'lz4', 'unsorted', 'raw', 'raw_and_compressed', 'no_index', 'cut', 'cut_index'])
def test_kinds_of_bags(recorded, tmp_path, kind):
    source, target = recorded[0], str(tmp_path / 'case.bag')
    if kind in ('bz2', 'lz4'):
        cases.rewrite(source, target, compression=kind)
    elif kind == 'unsorted':   # neighbouring messages far apart in the file, chunks that overlap in time
        cases.rewrite(source, target, order=lambda time: (time.to_nsec() * 7919) % 10007, chunk_threshold=20000)
    elif kind == 'raw':
        cases.rewrite(source, target, cases.raw_images, chunk_threshold=100000)
    elif kind == 'raw_and_compressed':
        cases.rewrite(source, target, lambda *entry: [entry] + (cases.raw_images(*entry) if entry[0].endswith('compressed') else []))
    elif kind == 'no_index':
        cases.forget_index(cases.rewrite(source, str(tmp_path / 'small.bag'), chunk_threshold=50000), target)
    elif kind == 'cut':             # within one of the last chunks
        small = cases.rewrite(source, str(tmp_path / 'small.bag'), chunk_threshold=5000, compression='lz4')
        cases.cut(small, target, cases.index_place(small) - 3000)
    else:                           # within the index of the last chunk
        small = cases.rewrite(source, str(tmp_path / 'small.bag'), chunk_threshold=5000)
        cases.cut(small, target, cases.index_place(small) - 40)
    _, said = process(target, tmp_path / 'out')
    fields_agree(tmp_path / 'out' / FIELD, os.path.join(recorded[2], FIELD))
    assert ('left out' in said) == (kind == 'cut')


def test_stage_beyond_the_cut(recorded, tmp_path):
    """What comes before the cut is processed, what lies beyond it is named."""
    small = cases.rewrite(recorded[0], str(tmp_path / 'small.bag'), chunk_threshold=5000)
    bag = cases.cut(small, str(tmp_path / 'cut.bag'), int(0.8 * os.path.getsize(small)))
    _, said = process(bag, tmp_path / 'out', status=1)
    assert f"stage '{cases.STAGES[1]}' was not captured" in said and 'left out' in said
    assert [name for name in os.listdir(tmp_path / 'out/stages') if cases.STAGES[0] in name]


@pytest.mark.parametrize('content, reason', [(b'', 'does not begin as a bag'), (b'#ROSBAG V1.2\n', 'old format'),
                                             (b'PK\x03\x04 something', 'does not begin as a bag'),
                                             (b'#ROSBAG V2.0\n', 'ends too early')])
def test_not_a_bag(tmp_path, content, reason):
    (tmp_path / 'x.bag').write_bytes(content)
    for tool, arguments in (('process_bag', ['--capture', 'a@1', '--output', tmp_path / 'out']), ('validate_bag', [])):
        _, said = run_tool(tool, tmp_path / 'x.bag', *arguments, status=1)
        assert reason in said and 'x.bag' in said
    assert not (tmp_path / 'out').exists()


def test_damaged_everywhere(recorded, tmp_path):
    """Whatever bytes are hit: the same field, one whose stamps say that another pair was taken, or a refusal with its reason."""
    with open(recorded[0], 'rb') as file:
        good = file.read()
    whole = read_field(os.path.join(recorded[2], FIELD))
    random = np.random.default_rng(5)
    ends = {'same': 0, 'another pair': 0, 'refused': 0}
    for n in range(25):
        data = bytearray(good)
        start = int(random.integers(13, len(data) - 2000)) if n % 2 else len(data) - int(random.integers(100, 4000))
        data[start:start + 40] = random.bytes(40)
        (tmp_path / 'x.bag').write_bytes(data)
        done = subprocess.run([program('process_bag'), tmp_path / 'x.bag', '--capture', *cases.CAPTURES, '--shift', SHIFT, '--output',
                               tmp_path / f'out{n}', '--config', cases.CONFIG], capture_output=True, text=True, check=False)
        if done.returncode == 0:
            field = read_field(tmp_path / f'out{n}' / FIELD)
            if (field.from_stamp, field.to_stamp) == (whole.from_stamp, whole.to_stamp):
                fields_agree(tmp_path / f'out{n}' / FIELD, os.path.join(recorded[2], FIELD))
                ends['same'] += 1
            else:
                ends['another pair'] += 1
        else:
            assert done.returncode == 1, (start, done.stderr)
            assert re.search(r"x\.bag|stage '\w+' was not captured: .* the pair at", done.stderr), (start, done.stderr)
            ends['refused'] += 1
    print(ends)
    assert ends['same'] >= 10 and ends['refused'] >= 3


# ---- what is missing or wrong in it

def static_edges(bag_path):
    with rosbag.Bag(bag_path) as bag:
        edges = [edge for _, message, _ in bag.read_messages('/tf_static') for edge in message.transforms]
    return [{'parent': edge.header.frame_id, 'child': edge.child_frame_id,
             'translation': [getattr(edge.transform.translation, axis) for axis in 'xyz'],
             'rotation': [getattr(edge.transform.rotation, axis) for axis in 'xyzw']} for edge in edges]


def test_static_transforms_from_file(recorded, tmp_path):
    bag = cases.rewrite(recorded[0], str(tmp_path / 'case.bag'),
                        lambda topic, message, time: [] if topic == '/tf_static' else [(topic, message, time)])
    _, said = process(bag, tmp_path / 'none', status=1)
    assert '(pose)' in said and 'frame pmr is not in tf' in said
    file = tmp_path / 'static.yaml'
    file.write_text(yaml.safe_dump(static_edges(recorded[0])))
    process(bag, tmp_path / 'out', '--static-tf', file)
    fields_agree(tmp_path / 'out' / FIELD, os.path.join(recorded[2], FIELD))
    _, said = process(recorded[0], tmp_path / 'both', '--static-tf', file, status=1)
    assert 'is in the file of static transforms and on /tf_static' in said
    broken = static_edges(recorded[0])
    broken[0]['rotation'][0] += 0.1
    file.write_text(yaml.safe_dump(broken))
    _, said = process(bag, tmp_path / 'broken', '--static-tf', file, status=1)
    assert 'pmr -> reference' in said and 'rotation has length' in said


def test_gap_in_tracking(recorded, tmp_path):
    def hole(topic, message, time):
        return [] if topic == '/tf' and abs(time.to_sec() - 1.7e9 - 12.0) < 1.5 else [(topic, message, time)]
    bag = cases.rewrite(recorded[0], str(tmp_path / 'case.bag'), hole)
    _, said = process(bag, tmp_path / 'out', status=1)
    assert 'reference -> microscope' in said and 'max_pose_gap' in said


def blank(second):
    """For rewrite: the image of that second is black."""
    import cv2

    def change(topic, message, time):
        if topic.endswith(IMAGE_ENDING) and abs(time.to_sec() - 1.7e9 - second) < 0.1:
            message.data = cv2.imencode('.png', np.zeros((240, 320, 3), np.uint8))[1].tobytes()
        return [(topic, message, time)]
    return change


def stamp_of(output, key):
    name, = (name for name in os.listdir(os.path.join(output, 'stages')) if key in name)
    with rosbag.Bag(os.path.join(output, 'stages', name)) as bag:
        (_, info, _), = bag.read_messages('/stage/info')
    return info.stamp.to_sec() - 1.7e9


@pytest.mark.parametrize('at, blanked, expected', [
    (0.0, None, 3.0),    # the next pair
    (2.9, None, 3.0),
    (4.9, None, 3.0),    # 1.9 s old: recent enough
    (5.1, None, 5.0),    # the newest
    (6.5, 5.0, 12.0),    # the newest gives no surface, the one before is too old: the next one
    (4.95, 3.0, 5.0),
    (13.9, None, 12.0),
    (7.5, None, 12.0)])
def test_which_pair_is_captured(recorded, tmp_path, at, blanked, expected):
    bag = recorded[0]
    if blanked is not None:
        bag = cases.rewrite(bag, str(tmp_path / 'case.bag'), blank(blanked))
    run_tool('process_bag', bag, '--capture', f'key@{at}', '--output', tmp_path / 'out')
    assert abs(stamp_of(tmp_path / 'out', 'key') - expected) < 1e-6


def test_nothing_to_capture(recorded, tmp_path):
    _, said = run_tool('process_bag', recorded[0], '--capture', 'late@17', '--output', tmp_path / 'out', status=1)
    assert "stage 'late' was not captured" in said and '0 tried' in said


@pytest.mark.parametrize('arguments, reason', [
    (['--capture', 'a'], 'KEY@SECONDS'), (['--capture', 'a b@1'], 'a b'), (['--capture', 'a@x'], 'not a number'),
    (['--capture', 'a@1', 'a@2'], 'twice'), (['--capture', 'a@1x0'], 'allowed is 1 to 64'),
    (['--capture', 'a@1x2.5'], 'allowed is 1 to 64'),
    (['--capture', 'pmr@1'], 'stands for the preoperative MR'),
    (['--capture', 'a@1', '--shift', 'pmr:a'], 'register_mr DIR STAGE MR'),
    (['--capture', 'a@-1'], 'before'), ([], 'nothing to capture'),
    (['--capture', 'a@1', '--shift', 'a:b'], "'b' is not captured"), (['--capture', 'a@2', 'b@1', '--shift', 'a:b'], 'swap'),
    (['--capture', 'a@1', '--shift', 'a'], 'FROM:TO'), (['--capture', 'a@1', '--threads', '1.5'], '--threads'),
    (['--capture', 'a@1', '--gravity', '0,0,0'], 'direction'), (['--capture', 'a@1', '--nonsense', '1'], 'no such option')])
def test_bad_usage(recorded, tmp_path, arguments, reason):
    _, said = run_tool('process_bag', recorded[0], *arguments, '--output', tmp_path / 'out', status=2)
    assert reason in said
    assert not (tmp_path / 'out').exists()


def test_nothing_is_overwritten(recorded, tmp_path):
    shutil.copytree(recorded[2], tmp_path / 'out')
    _, said = process(recorded[0], tmp_path / 'out', status=1)
    assert 'not empty' in said and same_files(recorded[2], str(tmp_path / 'out'))


@pytest.fixture
def config(tmp_path):
    """A copy of the parameters to change: function of file, key and value, which returns the folder."""
    folder = tmp_path / 'config'
    shutil.copytree(cases.CONFIG, folder)

    def change(name, key, value):
        values = yaml.safe_load((folder / name).read_text())
        values[key] = value
        (folder / name).write_text(yaml.safe_dump(values))
        return folder
    return change


@pytest.mark.parametrize('key, value, reason', [('min_coverage', 7, 'min_coverage = 7'), ('nonsense', 1, 'nonsense is unknown'),
                                                ('min_coverage', 'high', 'not of the type'), ('average_pairs', True, 'not of the type')])
def test_parameters_are_checked(recorded, tmp_path, config, key, value, reason):
    _, said = process(recorded[0], tmp_path / 'out', config=config('surface_reconstruction.yaml', key, value), status=1)
    assert reason in said and 'surface_reconstruction.yaml' in said


def test_parameters_count(recorded, tmp_path, config):
    for key, value in (('resolution', 0.0008), ('surround', False), ('gravity', [0, -1, 0])):   # False: off, by YAML
        folder = config('shift_tracker.yaml', key, value)
    process(recorded[0], tmp_path / 'out', config=folder)
    field = read_field(tmp_path / 'out' / FIELD)
    assert field.resolution == 0.0008 and np.isfinite(field.summary.gravity_mean) and 'surround: off' in field.summary.surround


def surface_of(output):
    """Points (H, W, 3) [m] of the one stage that process_bag wrote, and their stamp."""
    name, = (name for name in os.listdir(os.path.join(output, 'stages')) if name.endswith('.bag'))
    with rosbag.Bag(os.path.join(output, 'stages', name)) as bag:
        (_, message, _), = bag.read_messages('/surface/points')
    columns = cloud_arrays(message)
    return np.stack([columns[axis] for axis in 'xyz'], -1), message.header.stamp


def test_mean_of_pairs(recorded, tmp_path, config):
    """With average_pairs a surface is the mean with the pairs before it, as in the node: here halfway between the two."""
    for output, at in (('first', 3.1), ('second', 5.2)):
        run_tool('process_bag', recorded[0], '--capture', f'key@{at}', '--output', tmp_path / output, '--config', cases.CONFIG)
    run_tool('process_bag', recorded[0], '--capture', 'key@5.2', '--output', tmp_path / 'mean', '--config',
             config('surface_reconstruction.yaml', 'average_pairs', 4))
    (first, _), (second, stamp), (mean, stamp_of_mean) = (surface_of(tmp_path / output) for output in ('first', 'second', 'mean'))
    assert stamp_of_mean == stamp
    apart, off = (np.linalg.norm(gap, axis=-1) for gap in (second - first, mean - (first + second) / 2))
    assert np.isfinite(mean).all(-1).mean() > 0.9 and np.nanmedian(apart) > 5e-6
    assert np.nanmedian(off) < 0.05 * np.nanmedian(apart)


def test_mean_of_the_next_pairs(recorded, tmp_path):
    """Asked for with the capture: from pairs of one view, or not at all."""
    plan = {'captures': [{'key': 'dural_opening', 'at': 2.5, 'pairs': 2}]}
    (tmp_path / 'plan.yaml').write_text(yaml.safe_dump(plan))
    told, _ = run_tool('process_bag', recorded[0], '--plan', tmp_path / 'plan.yaml', '--output', tmp_path / 'out', '--config',
                       cases.CONFIG)
    assert 'mean of 2 pairs' in told
    _, said = run_tool('process_bag', recorded[0], '--capture', 'a@2.5x3', '--output', tmp_path / 'none', '--config', cases.CONFIG,
                       status=1)
    assert "stage 'a' was not captured: only " in said and ' of 3 pairs of one view came, of 3 pairs in all' in said


# ---- validate_bag

def test_validate(recorded, tmp_path):
    output, _ = run_tool('validate_bag', recorded[0])
    assert 'from 3.00 s to 5.00 s: 2 pairs' in output and 'tf and camera_info agree' in output
    assert 'the same         3' in output and 'reference -> microscope' in output and 'gaps' not in output.split('probe_tip')[0]


def test_validate_names_what_is_wrong(recorded, tmp_path):
    def spoil(topic, message, time):
        second = time.to_sec() - 1.7e9
        if topic == '/stereo/right/camera_info' and second < 4:
            message.R = [1, 0, 0, 0, 2, 0, 0, 0, 1]
        if topic.startswith('/stereo/right/image') and 4 < second < 6:
            message.header.stamp += cases.seconds(0.004) - cases.seconds(0)
        if topic == '/tf' and abs(second - 12) < 1:
            return []
        return [] if topic in ('/microscope/settings', '/microscope/pose') else [(topic, message, time)]
    bag = cases.rewrite(recorded[0], str(tmp_path / 'case.bag'), spoil)
    output, said = run_tool('validate_bag', bag, status=1)
    assert 'calibration: The calibration is refused' in output          # the pair at 3 s
    assert '1.0 to   10.0         1' in output and 'no stage can be captured' in said   # the pair at 5 s
    assert 'pose: The pose of the camera is not known' in output        # the pair at 12 s


def test_validate_sees_another_calibration_in_tf(recorded, tmp_path):
    def turn(topic, message, time):
        if topic == '/tf_static':
            for edge in message.transforms:
                if edge.child_frame_id == 'right_optical':
                    edge.transform.translation.x += 0.003
        return [(topic, message, time)]
    output, _ = run_tool('validate_bag', cases.rewrite(recorded[0], str(tmp_path / 'case.bag'), turn), status=1)
    assert 'tf and camera_info differ' in output and '3.00 mm' in output   # process_bag refuses it


# ---- recompute

def test_recompute_changes_nothing(recorded, tmp_path):
    before = sorted(os.listdir(os.path.join(recorded[2], 'stages')))
    output, _ = run_tool('recompute', recorded[2], '--output', tmp_path / 'again', '--config', cases.CONFIG)
    changes = [line.split() for line in output.splitlines() if line.startswith(('stage', 'shift'))]
    assert len(changes) == 3
    for line in changes:
        assert line[-5] == line[-4] == line[-3] and float(line[-1]) < 1e-3   # micrometres
    assert sorted(os.listdir(os.path.join(recorded[2], 'stages'))) == before
    ours, theirs = (field_arrays(read_field(os.path.join(folder, FIELD))) for folder in (recorded[2], str(tmp_path / 'again')))
    for one, other in zip(ours, theirs):
        valid = np.isfinite(one) & np.isfinite(other)
        assert valid.sum() > 0.999 * np.isfinite(one).sum() and np.abs(one - other)[valid].max() < 1e-6


def test_recompute_with_other_settings(recorded, config):
    output, _ = run_tool('recompute', recorded[2], '--config', config('surface_reconstruction.yaml', 'max_deviation', 0.05))
    before, after = (int(next(line for line in output.splitlines() if line.startswith('stage')).split()[n]) for n in (2, 3))
    assert after < before


def test_recompute_without_raw_pair(recorded, tmp_path):
    def drop(topic, message, time):
        return [] if 'image_raw' in topic else [(topic, message, time)]
    (tmp_path / 'case').mkdir()
    stage = sorted(name for name in os.listdir(os.path.join(recorded[2], 'stages')) if name.endswith('.bag'))[0]
    cases.rewrite(os.path.join(recorded[2], 'stages', stage), str(tmp_path / 'case' / stage), drop)
    _, said = run_tool('recompute', tmp_path / 'case', status=1)
    assert stage in said and 'keeps no raw pair' in said


# ---- long recordings

def test_long_recording(recorded, tmp_path):
    """Memory does not grow with the recording, and only what is needed is read."""
    task = ['--capture', *cases.CAPTURES, '--shift', SHIFT, '--config', cases.CONFIG, '--threads', 1]
    short, long = (cases.long_bag(recorded[0], str(tmp_path / f'{size}.bag'), size) for size in (20, 320))
    costs = [cases.cost(bag, *task, output=str(tmp_path / f'out{n}')) for n, bag in enumerate((short, long))]
    for n in range(2):
        fields_agree(tmp_path / f'out{n}' / FIELD, os.path.join(recorded[2], FIELD))
    print(costs)
    growth = os.path.getsize(long) - os.path.getsize(short)
    assert growth > 290e6
    assert costs[1]['memory'] - costs[0]['memory'] < 0.01 * growth
    assert costs[1]['read'] - costs[0]['read'] < 0.002 * growth
