"""script/soak: a short one with faults passes, and what it watches sees what is wrong."""
import os
import pathlib
import re
import subprocess
import sys
import zlib

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[4]
SUPPORT = ROOT / 'src/cortshift_tracking/test/support'
sys.path[:0] = [str(SUPPORT), str(SUPPORT / 'soak')]
import soak  # noqa: E402
import soak_watch  # noqa: E402
from programs import program  # noqa: E402
from soak_faults import Fault  # noqa: E402


def cameras():
    """Without Aravis, or without the right to give cameras their addresses, the phantom's driver stands in."""
    try:
        return ['--cameras'] * (os.geteuid() == 0 and bool(program('fake_gige_camera', 'cortshift_stereo')))
    except AssertionError:
        return []


def test_a_short_one_with_faults(tmp_path):
    report = tmp_path / 'report.md'
    done = subprocess.run([ROOT / 'script/soak', '0.5', '--faults', *cameras(), '--seed', '2', '--report', report], capture_output=True,
                          text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    told = report.read_text()
    assert re.search(r'Acknowledged [1-9]\d*, found afterwards with their checksum [1-9]\d*, lost 0', told), told
    assert 'kill -9' in told and '| master ends | 1 |' in told and '| `/surface/points` |' in told and '| shift_tracker | ' in told and 'parts of the recording' in told
    assert not subprocess.run(['pgrep', '-f', r'cortshift_soak\.'], capture_output=True, text=True, check=False).stdout   # nothing is left


def test_usage():
    for words in ([], ['0'], ['many'], ['1', '--fault-free']):
        assert subprocess.run([ROOT / 'script/soak', *words], capture_output=True, check=False).returncode == 2, words


def test_a_damaged_stage_is_not_found(tmp_path):
    (tmp_path / 'case').mkdir()
    for number, (key, content) in enumerate((('whole', b'stage'), ('changed', b'stage'))):
        (tmp_path / 'case' / f'{number:04d}_{key}_{zlib.crc32(content):08x}.bag').write_bytes(content)
    (changed,) = (tmp_path / 'case').glob('*changed*')
    changed.write_bytes(b'stagE')
    (tmp_path / 'case/0003_cut_00000000.bag.part').write_bytes(b'')
    assert soak.whole_stages(tmp_path) == {'whole'}


def test_gaps_tell_those_of_faults_apart():
    gaps = soak_watch.Gaps()
    for at in (0.0, 1.0, 3.0, 30.0, 39.0, 41.0):
        gaps.tick('stream', at)
    (name, count, longest, quiet), = gaps.rows([Fault('kill', began=33.0, ended=34.0)])
    assert (name, count, longest) == ('stream', 6, 27.0) and quiet == pytest.approx(27.0)
    assert gaps.rows([Fault('kill', 33.0, 34.0), Fault('kill', 5.0, 6.0)])[0][3] == 2.0
    assert gaps.since('stream', 40.0) and not gaps.since('stream', 41.0)


def test_memory_is_of_the_process_that_lived_longest():
    memory = soak_watch.Memory(['node'])
    memory._samples['node'] = {1: [(0.0, 50.0), (10.0, 51.0)], 2: [(t, 100.0 + t / 100) for t in range(0, 1201, 5)]}
    memory._samples['node'][2][-1] = (1200, 150.0)   # in the middle of something
    (node, processes, seconds, start, end, growth), = memory.rows()
    assert (node, processes, seconds) == ('node', 2, 1200) and start == pytest.approx(100.9) and end == pytest.approx(111.7)
    assert growth == pytest.approx(100 * (111.7 / 106.3 - 1))
    assert soak_watch.resident(os.getpid()) > 5 and soak_watch.resident(2 ** 22 + 1) is None
