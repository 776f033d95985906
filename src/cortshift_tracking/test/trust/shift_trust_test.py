"""The command that fits the confidence of a shift: its sets are apart, its fit finds what was put in, its file is the one that is compiled."""
import pathlib
import re
import sys

import numpy as np
import pytest
from scipy.special import erf, expit

PACKAGE = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(PACKAGE / 'benchmark'))

import shift_trust  # noqa: E402  pylint: disable=wrong-import-position,import-error

FITTED = PACKAGE / 'src' / 'trust' / 'fitted_weights.hpp'
SETS = ('fit', 'choose', 'judge')


def named_by(which):
    """Photographs of the cases of a set."""
    cases = (shift_trust.ROOT / 'config' / 'phantom' / which / f'{case}.yaml' for case in shift_trust.CASES)
    return {name for case in cases for name in re.findall(r'file: \S*/(\S+?)[,\s]', case.read_text(encoding='utf-8'))}


def test_the_sets_share_no_photograph():
    for which in SETS:
        assert named_by(which), 'the pattern finds none'
        mine = set(shift_trust.PICTURES[which]) - {shift_trust.PAINTED} | named_by(which)
        for other in set(SETS) - {which}:
            assert not mine & (set(shift_trust.PICTURES[other]) | named_by(other))


@pytest.mark.parametrize('which', SETS)
def test_every_picture_and_every_case_takes_part(which):
    jobs = list(shift_trust.jobs(which))
    assert {case for case, _ in jobs} == set(shift_trust.CASES)
    assert {picture for _, picture in jobs} == set(shift_trust.PICTURES[which]) | {shift_trust.OWN}


def generated(count, random):
    """Vectors whose evidence says how often they are wrong: doubt in two cues, heights that are 1.5 times as wrong as expected."""
    values = np.zeros((count, shift_trust.COLUMNS), np.float32)
    values[:, :7] = random.normal(size=(count, 7))
    values[:, 7] = random.uniform(2e-5, 2e-4, count)   # expected deviation [m]
    logit = -3 + 1.5 * values[:, 0] + 2 * np.maximum(0, values[:, 5])
    values[:, 10] = np.where(random.uniform(size=count) < expit(logit), 1e-3, 1e-5)
    rough = random.uniform(size=count) < expit(-4 + 1.5 * values[:, 6])
    values[:, 11] = np.where(rough, 1e-3, np.abs(random.normal(size=count)) * 1.5 * values[:, 7])
    return values


def test_a_fit_promises_what_is_true():
    random = np.random.default_rng(3)
    vectors = shift_trust.Vectors(generated(20000, random))
    model = shift_trust.Model(vectors, np.ones(len(vectors)), np.zeros(len(vectors)))
    assert model.too_little == pytest.approx(1.5, abs=0.05)
    others = shift_trust.Vectors(generated(20000, random))
    confidence = model.confidence(others)
    for low, high in ((0, 0.3), (0.3, 0.6), (0.6, 0.9), (0.9, 1)):
        inside = (confidence >= low) & (confidence < high)
        assert 1 - others.wrong[inside].mean() == pytest.approx(confidence[inside].mean(), abs=0.03)


def test_in_three_of_four_cases_no_more_is_wrong_than_promised():
    random = np.random.default_rng(6)
    rates = np.array([0.02, 0.04, 0.06, 0.08, 0.10, 0.12])
    groups = np.repeat(np.arange(len(rates)), 20000)
    wrong = random.uniform(size=len(groups)) < rates[groups]
    promised = shift_trust.covering(lambda x: np.full(len(groups), x), wrong, groups, (0, 1))
    assert promised == pytest.approx(0.10, abs=0.005)   # five of six; four are too few
    with pytest.raises(ValueError, match='more is wrong in one case of 4 than 0.05 promises'):
        shift_trust.covering(lambda x: np.full(len(groups), x), wrong, groups, (0, 0.05))
    with pytest.raises(ValueError, match='no case has 30 vectors that are off'):
        shift_trust.covering(lambda x: np.full(len(groups), x), np.zeros(len(groups), bool), groups, (0, 1))


def test_a_photograph_that_is_missing_ends_the_fit(monkeypatch):
    monkeypatch.setitem(shift_trust.PICTURES, 'fit', ('nobody.png',))
    monkeypatch.setattr(shift_trust, 'CASES', ())
    monkeypatch.setattr(shift_trust, 'jobs', lambda which: [('wet', 'nobody.png')])
    with pytest.raises(FileNotFoundError, match='nobody.png: the photographs come with opencv-doc and python3-skimage'):
        list(shift_trust.gather('no_program', 'fit'))


def test_no_doubt_makes_a_vector_likelier_to_be_right():
    """Also where a cue of the fitting set says the opposite by chance."""
    random = np.random.default_rng(4)
    columns = random.normal(size=(4000, 3))
    wrong = random.uniform(size=4000) < expit(-1 - columns[:, 0])
    _, slopes, _ = shift_trust.fit_monotone(columns, wrong, np.ones(4000))
    assert (slopes >= 0).all()


def test_what_heights_are_expected_to_be_off_counts_as_a_normal_distribution():
    vectors = shift_trust.Vectors(generated(20000, np.random.default_rng(5)))
    model = shift_trust.Model(vectors, np.ones(len(vectors)), np.zeros(len(vectors)))
    exact, unsure = (shift_trust.Vectors(np.zeros((1, shift_trust.COLUMNS), np.float32)) for _ in range(2))
    unsure.deviation[:] = shift_trust.RIGHT
    ratio = model.confidence(unsure)[0] / model.confidence(exact)[0]
    assert ratio == pytest.approx(erf(1 / (np.sqrt(2) * model.too_little)), rel=1e-6)


def test_the_compiled_weights_are_the_commands():
    """Not a number of them was changed by hand."""
    text = FITTED.read_text(encoding='utf-8')
    assert text.startswith('// Written by script/fit_trust shift; do not edit. Fitted on the set "fit" of benchmark/shift_trust.py:')
    assert f'// Digest of the numbers: {shift_trust.digest(text)}\n' in text
    assert shift_trust.digest(text.replace('1', '2')) != shift_trust.digest(text)


def test_a_table_says_how_often_what_is_reported_is_wrong():
    confidence = np.array([0.9] * 8 + [0.6] * 2 + [0.2] * 10)
    wrong = np.array([False] * 7 + [True] + [True, False] + [True] * 5 + [False] * 5)
    assert shift_trust.row_of('these', confidence, wrong) == '| these | 50.0 % | 20.00 % | 16.00 % | 1.25 | 61.5 % |'
