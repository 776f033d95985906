"""The logistic model of trust/judgement.cpp: fitting it, writing it down, and how reliable it is."""
import hashlib
import re

import numpy as np

WRONG = 0.25     # the model gives the probability that a vector is off by more than this [px]
DOUBT = np.e - 1  # an error of root mean square 0.25 px (Rayleigh) exceeds it with odds of 1 / (e - 1): confidence one half
KNOT_SHARES = (0.5, 0.9)   # the slope over a cue may change at these quantiles of it
RIDGE = 1e-3     # of the standardised slopes, for each vector


def design(cues, knots):
    """Columns: 1, then for each cue itself and what is above each of its knots."""
    columns = [np.ones(len(cues))]
    for number, at in enumerate(knots):
        cue = cues[:, number]
        columns.append(cue)
        columns += [np.maximum(0, cue - knot) for knot in at]
    return np.stack(columns, 1)


def fit(cues, wrong, weights):
    """Knots (cues, 2) and coefficients by penalised maximum likelihood (iteratively reweighted least squares)."""
    knots = np.quantile(cues, KNOT_SHARES, axis=0).T
    columns = design(cues, knots)
    mean, scale = columns.mean(0), columns.std(0)
    mean[0], scale[0] = 0, 1
    scale[scale == 0] = 1
    columns = (columns - mean) / scale
    penalty = RIDGE * weights.sum() * np.eye(columns.shape[1])
    penalty[0, 0] = 0
    beta = np.zeros(columns.shape[1])
    for _ in range(30):
        probability = 1 / (1 + np.exp(-np.clip(columns @ beta, -30, 30)))
        gradient = columns.T @ (weights * (wrong - probability)) - penalty @ beta
        spread = weights * probability * (1 - probability)
        step = np.linalg.solve((columns * spread[:, None]).T @ columns + penalty + 1e-9 * np.eye(len(beta)), gradient)
        beta += step
        if np.abs(step).max() < 1e-6:
            break
    beta /= scale
    beta[0] -= (beta[1:] * mean[1:]).sum()
    return knots, beta


def probability_of_wrong(cues, model):
    knots, beta = model
    return 1 / (1 + np.exp(-np.clip(design(cues, knots) @ beta, -9, 9)))


def doubt(probability):
    """1 - confidence."""
    odds = DOUBT * probability / (1 - probability)
    return odds / (1 + odds)


def header(models, names, provenance):
    """trust/fitted_weights.hpp"""
    lines = [f'// Written by script/fit_trust flow; do not edit. {provenance}', '#pragma once', '', '#include "trust/evidence.hpp"', '',
             'namespace cortshift_flow {', '',
             '/// The logit changes by `slope` per unit of the cue, and by `bends` more above each of `knots`.',
             'struct CueWeights {', '  float slope, knots[2], bends[2];', '};', '',
             'struct FittedWeights {', '  float constant;', '  CueWeights cues[kCues];', '};', '',
             '/// By FitKind.', 'constexpr FittedWeights kFittedWeights[] = {']
    for knots, beta in models:
        lines.append(f'    {{{beta[0]:.5g}f,')
        lines.append('     {')
        for number, name in enumerate(names):
            slope, *bends = beta[1 + 3 * number:4 + 3 * number]
            lines.append(f'         {{{number_text(slope)}, {{{number_text(knots[number][0])}, {number_text(knots[number][1])}}}, '
                         f'{{{number_text(bends[0])}, {number_text(bends[1])}}}}},  // {name}')
        lines.append('     }},')
    text = '\n'.join(lines + ['};', '', '}  // namespace cortshift_flow', ''])
    return text.replace('#pragma once', f'// Digest of the numbers: {digest(text)}\n#pragma once', 1)


def digest(text):
    """Of the numbers of a header, those that end in f: it carries their digest, so that one changed by hand shows."""
    numbers = re.findall(r'-?\d[\d.]*(?:e[-+]?\d+)?(?=f\b)', re.sub('//.*', '', text))   # not in the comments: there it stands itself
    return hashlib.sha256(' '.join(numbers).encode()).hexdigest()[:16]


def number_text(value):
    text = f'{value:.4g}'
    return (text if '.' in text or 'e' in text else text + '.') + 'f'


def figures(doubted, error):
    """Of the vectors: share wrong by 0.5 px, of these flagged, of those right to 0.1 px kept; of the reported ones (confidence 0.5
    and more) the share wrong by 0.25 and 0.5 px and what their confidence promises, the mean of what is `doubted`."""
    low, wrong, right = doubted > 0.5, error > 0.5, error < 0.1
    reported = ~low

    def share(what, where):
        return what[where].mean() if where.any() else np.nan
    return {'wrong': wrong.mean(), 'flagged': share(low, wrong), 'kept': share(~low, right), 'off': share(error > WRONG, reported),
            'reported_wrong': share(wrong, reported), 'promised': share(doubted, reported),
            'confidently_wrong': (reported & wrong).mean()}
