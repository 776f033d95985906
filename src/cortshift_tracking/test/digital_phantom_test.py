"""The paper's digital phantom: its figures are counted rightly, and the flow is at least as good as the paper's."""
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from cortshift_tracking.digital_phantom import PAPER, phantom_errors
from cortshift_tracking.errors import CortshiftError
from cortshift_tracking.flow_tool import flow_between, read_flo, run_flow_tool

TOOL = os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'scripts', 'digital_phantom')


def disc(radius, centre=(200, 200), size=400):
    row, column = np.mgrid[:size, :size]
    return np.hypot(column - centre[0], row - centre[1]) < radius


def test_errors_are_counted_where_the_paper_counts_them():
    craniotomy, patch = disc(150), disc(20)
    core = disc(110) & ~patch
    flow = np.zeros((400, 400, 2))
    flow[..., 0] = np.where(disc(140), 0.04, 0.6)   # a band of 10 px at the rim is wrong
    flow[patch] = 2.0
    flow[core & disc(30, (260, 200))] = [0.1, 0]
    errors = phantom_errors(flow, np.zeros_like(flow), craniotomy, core, patch)
    assert np.isclose(errors.core_median, 0.04) and np.isclose(errors.core_percentile_95, 0.1)
    assert np.isclose(errors.share_below_005, 1 - 30 ** 2 / (110 ** 2 - 20 ** 2), atol=0.005)
    assert np.isclose(errors.rim_band, 10, atol=1.0)
    assert np.isclose(errors.patch_largest, np.sqrt(8))


@pytest.fixture(scope='module')
def printed():
    """The table that the command prints: its numbers by (case, preset)."""
    done = subprocess.run([sys.executable, TOOL], stdout=subprocess.PIPE, universal_newlines=True, check=True)
    print(done.stdout)
    rows = [re.sub(' (px|%)', '', line).split() for line in done.stdout.splitlines()[1:]]
    return {(case, preset): numbers for case, preset, *numbers in rows}


def test_one_command_prints_the_table(printed):
    assert list(printed) == [(case, of) for case in ('outward', 'inward') for of in ('default', 'ji2014', 'paper')]
    bad = subprocess.run([sys.executable, TOOL, '--preset', 'nonsense'], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                         universal_newlines=True, check=False)
    assert bad.returncode == 1 and 'nonsense' in bad.stdout


@pytest.mark.parametrize('case', PAPER)
def test_flow_is_at_least_as_good_as_the_papers(printed, case):
    _, _, share_below_005, rim_band, patch_largest, _ = map(float, printed[case, 'default'])
    assert share_below_005 > 90        # [%]; the paper: the majority
    assert rim_band < PAPER[case]['rim_band']
    assert PAPER[case]['patch_largest'] is None or patch_largest < PAPER[case]['patch_largest']


def test_flow_tool(tmp_path):
    texture = np.random.default_rng(1).uniform(size=(96, 96, 3))
    for _ in range(3):
        texture = 0.25 * (texture + np.roll(texture, 1, 0) + np.roll(texture, 1, 1) + np.roll(texture, (1, 1), (0, 1)))
    flow = flow_between(texture, np.roll(texture, (1, 2), (0, 1)), preset='ji2014')
    assert np.abs(np.median(flow[20:-20, 20:-20], (0, 1)) - [2, 1]).max() < 0.05   # columns, rows
    with pytest.raises(CortshiftError, match='nothing.png'):
        run_flow_tool('flow_pair', str(tmp_path / 'nothing.png'), str(tmp_path / 'nothing.png'), str(tmp_path / 'out.flo'))
    (tmp_path / 'no.flo').write_bytes(b'JPEG')
    with pytest.raises(CortshiftError, match='not a .flo'):
        read_flo(tmp_path / 'no.flo')
