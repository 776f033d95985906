"""Random single faults in the shipped recording: the result is the untouched one, or refused, or warned of.

CORTSHIFT_FAULTS and CORTSHIFT_VARIANTS say how many of each (default 40 and 12; the benchmark takes 320 and 100).
"""
import collections
import copy
import os

import numpy as np
import pytest

import faults
import variants
from fault_trials import process, shipped_entries

SAME, WRONG = 0.0001, 0.00025   # [m]
SEED = 20140609


@pytest.fixture(scope='module')
def shipped(tmp_path_factory):
    entries = shipped_entries()
    status, said, result, warnings = process(copy.deepcopy(entries), tmp_path_factory.mktemp('untouched') / 'case')
    assert status == 0, said
    assert not warnings and 'WARNING' not in said
    return entries, result


def trials(table, count):
    names = sorted(table)
    return [(names[n % len(names)], np.random.default_rng([SEED, n])) for n in range(count)]


def test_no_fault_goes_unnoticed(shipped, tmp_path):
    entries, truth = shipped
    outcomes, silent, between = collections.Counter(), [], []
    for name, random in trials(faults.FAULTS, int(os.environ.get('CORTSHIFT_FAULTS', '40'))):
        status, said, result, warnings = process(faults.FAULTS[name](copy.deepcopy(entries), random), tmp_path / 'case')
        assert status in (0, 1), (name, status, said)
        if status == 1:
            assert 'was not captured: ' in said or 'no shift from' in said or 'process_bag: ' in said, (name, said)
            outcomes['refused'] += 1
            continue
        error = max(np.linalg.norm(result[:3] - truth[:3]), abs(result[3] - truth[3]))
        if warnings:
            outcomes['warned'] += 1
        elif error <= SAME:
            outcomes['unharmed'] += 1
        else:
            outcomes['off'] += 1
            (silent if error > WRONG else between).append(f'{name}: {1e3 * error:.3f} mm')
    total = sum(outcomes.values())
    print(f'{total} faults of {len(faults.FAULTS)} kinds: {dict(outcomes)}; silently wrong: {len(silent) / total:.1%} {silent}; '
          f'between {1e3 * SAME} and {1e3 * WRONG} mm: {between}')
    assert not silent and not between


def test_no_alarm_without_a_fault(shipped, tmp_path):
    entries, truth = shipped
    alarms = []
    count = int(os.environ.get('CORTSHIFT_VARIANTS', '12'))
    for name, random in trials(variants.VARIANTS, count):
        status, said, result, warnings = process(variants.VARIANTS[name](copy.deepcopy(entries), random), tmp_path / 'case')
        if status != 0 or warnings:
            alarms.append(f'{name}: {said if status else warnings}')
        elif np.linalg.norm(result[:3] - truth[:3]) > SAME:
            alarms.append(f'{name}: off by {1e3 * np.linalg.norm(result[:3] - truth[:3]):.3f} mm')
    print(f'{count} variants of {len(variants.VARIANTS)} kinds: {len(alarms)} alarms')
    assert not alarms, '\n'.join(alarms)
