"""The command that fits the confidence: its pairs are what it says, its fit finds what was put in, its file is the one that is compiled."""
import pathlib
import sys

import numpy as np
import pytest

BENCHMARK = pathlib.Path(__file__).parents[1] / 'benchmark'
sys.path.insert(0, str(BENCHMARK))

import trust_model  # noqa: E402  pylint: disable=wrong-import-position,import-error
import trust_pairs  # noqa: E402  pylint: disable=wrong-import-position,import-error

FITTED = BENCHMARK.parent / 'src' / 'trust' / 'fitted_weights.hpp'


def test_the_sets_share_no_photograph_and_no_phantom():
    for sets in (trust_pairs.PHOTOGRAPHS, trust_pairs.PHANTOMS):
        everything = [one for members in sets.values() for one in members]
        assert len(everything) == len(set(everything))


def test_nothing_is_fitted_on_rubberwhale():
    assert not [name for names in trust_pairs.PHOTOGRAPHS.values() for name in names if 'rubberwhale' in name]


@pytest.mark.parametrize('kind', ['clean', 'layers', 'bumps'])
def test_the_flow_of_a_pair_leads_to_the_same_colours(kind):
    first, second, flow = trust_pairs.photograph_pair('brick.png', f'{kind}#0', ['moon.png'])
    known = np.isfinite(flow[..., 0])
    assert known.mean() > 0.7
    end = trust_pairs.grid() + np.nan_to_num(flow)
    import cv2  # pylint: disable=import-outside-toplevel
    there = cv2.remap(second, end.astype(np.float32), None, cv2.INTER_CUBIC)
    assert np.median(np.abs(there.astype(float) - first)[known]) < 4
    still = np.median(np.abs(second.astype(float) - first)[known])
    assert np.median(np.abs(there.astype(float) - first)[known]) < 0.7 * still


def test_a_fit_promises_what_is_true():
    random = np.random.default_rng(3)
    cues = random.normal(size=(15000, 12))
    logit = -2 + cues[:, 0] + 0.7 * np.maximum(0, cues[:, 1] - 0.5)
    wrong = random.uniform(size=len(cues)) < 1 / (1 + np.exp(-logit))
    promised = trust_model.probability_of_wrong(cues, trust_model.fit(cues, wrong.astype(float), np.ones(len(cues))))
    for low, high in ((0, 0.05), (0.05, 0.2), (0.2, 0.5), (0.5, 1)):
        inside = (promised >= low) & (promised < high)
        assert wrong[inside].mean() == pytest.approx(promised[inside].mean(), abs=0.03)


def test_the_compiled_weights_are_the_commands():
    """Not a number of them was changed by hand."""
    text = FITTED.read_text(encoding='utf-8')
    assert text.startswith('// Written by script/fit_trust flow; do not edit. Fitted on the set "fit" of benchmark/trust_pairs.py:')
    assert f'// Digest of the numbers: {trust_model.digest(text)}\n' in text


def test_the_digest_shows_one_changed_number():
    models = [([(0.1, 0.2)] * 2, np.arange(1, 8) / 8)]
    text = trust_model.header(models, ['one', 'two'], 'Fitted.')
    assert f'Digest of the numbers: {trust_model.digest(text)}\n' in text
    assert trust_model.digest(text) == trust_model.digest(text.replace('Digest of the numbers: ', 'Digest of the numbers: 3f '))
    assert '{0.1f, 0.2f}' in text
    assert trust_model.digest(text.replace('{0.1f, 0.2f}', '{0.1f, 0.4f}', 1)) != trust_model.digest(text)
    assert trust_model.digest(text.replace('0.25f', '-0.25f', 1)) != trust_model.digest(text)
