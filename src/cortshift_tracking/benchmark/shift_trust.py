#!/usr/bin/python3
"""Fits what the confidence of a shift makes of its evidence, or prints how reliable it is. script/fit_trust shift and script/benchmark
trust run it.

usage: shift_trust.py fit EVIDENCE HEADER   fits on the set `fit`, writes HEADER, prints figures of that set
       shift_trust.py report EVIDENCE SET   how reliable the confidence is on SET (judge, choose, fit)
EVIDENCE is the program shift_evidence. The sets are photographs as tissue in the cases of config/phantom/SET; they share none.
"""
import math
import os
import pathlib
import subprocess
import sys
import tempfile
from multiprocessing.pool import ThreadPool

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.special import erf, expit

ROOT = pathlib.Path(__file__).parents[3]
sys.path.insert(0, str(ROOT / 'src' / 'cortshift_flow' / 'benchmark'))

import trust_pairs  # noqa: E402  pylint: disable=wrong-import-position,import-error
from trust_model import digest, number_text  # noqa: E402  pylint: disable=wrong-import-position,import-error

PAINTED = 'painted'   # the phantom's own cortex
OWN = 'own'           # the photograph that the case names
CASES = ('photograph', 'cameras', 'defocus', 'weak', 'wet', 'operated', 'instrument', 'pulsing')
PICTURES = {
    'fit': (PAINTED, 'camera.png', 'brick.png', 'moon.png', 'rocket.jpg', 'hubble_deep_field.jpg', 'cell.png', 'messi5.jpg', 'stuff.jpg',
            'orange.jpg', 'squirrel_cls.jpg', 'aero1.jpg', 'ela_original.jpg', 'ihc.png'),
    'choose': (PAINTED, 'gravel.png', 'butterfly.jpg', 'building.jpg', 'leuvenA.jpg', 'coins.png', 'apple.jpg', 'board.jpg'),
    'judge': (PAINTED, 'grass.png', 'astronaut.png', 'graf1.png', 'fruits.jpg', 'baboon.jpg', 'home.jpg', 'rubberwhale1.png'),
}
PER_PICTURE = 2      # cases; all of CASES with a case's own photograph
CUES = ('flow_error', 'correlation', 'residual', 'hue', 'bend', 'aperture')   # of the match, as cuesOf() gives them
COLUMNS = len(CUES) + 6
RIGHT = 0.00025      # [m] within the plane and in height
REPORTED = 0.5       # confidence
PER_SHIFT = 1500     # vectors of each shift that take part in a fit
KNOT_SHARES = (0.005, 0.5, 0.9, 0.995)   # a cue's slope may change at these quantiles of it; beyond the outer ones it has none
SCALES = (0.5, 3)    # of the deviation that surfaces expect: between these the one that is found is looked for
SHIFTS = (-2, 3)     # of the logit that a vector is off within the plane, likewise
COVERED = 0.75       # share of the cases in which vectors are off no more often than promised, each of the two ways
FEWEST = 30          # vectors that are off, for a case to take part in that
RIDGE = 1e-3         # of the standardised slopes, for each vector


class Vectors:
    """All vectors of the shifts of one case with one picture."""

    def __init__(self, values):
        self.cues, self.roughness = values[:, :len(CUES)].astype(float), values[:, len(CUES)].astype(float)
        self.deviation, self.confidence = values[:, len(CUES) + 1].astype(float), values[:, len(CUES) + 2].astype(float)
        foreign, in_plane, height = values[:, len(CUES) + 3] > 0, values[:, len(CUES) + 4], values[:, len(CUES) + 5]
        self.off_plane = foreign | (in_plane > RIGHT)
        self.off_height = height > RIGHT
        self.wrong = self.off_plane | self.off_height

    def __len__(self):
        return len(self.wrong)


def jobs(which):
    """(case, picture) of a set."""
    for case in CASES:
        yield case, OWN
    for number, picture in enumerate(PICTURES[which]):
        for k in range(PER_PICTURE):
            yield CASES[(number * 3 + k * 5) % len(CASES)], picture


def vectors_of(evidence, which, case, picture):
    """A list of arrays (vectors, COLUMNS), one for each shift."""
    options = {PAINTED: ['--painted'], OWN: []}.get(picture)
    if options is None:
        options = ['--picture', str(trust_pairs.find(picture))]
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / 'out'
        subprocess.run([str(evidence), str(ROOT / 'config' / 'phantom' / which / f'{case}.yaml'), str(path), *options], check=True)
        raw = path.read_bytes()
    shifts, at = [], 0
    while at < len(raw):
        count = int(np.frombuffer(raw, '<i4', 1, at)[0])
        shifts.append(np.frombuffer(raw, '<f4', count * COLUMNS, at + 4).reshape(-1, COLUMNS))
        at += 4 + shifts[-1].nbytes
    return shifts


def gather(evidence, which):
    """Yields case, picture and the vectors of each shift."""
    todo = list(jobs(which))
    results = ThreadPool(os.cpu_count()).imap(lambda job: vectors_of(evidence, which, *job), todo)
    for number, (job, shifts) in enumerate(zip(todo, results)):
        if sys.stderr.isatty():
            print(f'\r{number + 1} of {len(todo)}: {job[0]}, {job[1]}          ', end='', file=sys.stderr)
        yield (*job, shifts)


def ramps(cue, knots):
    """(vectors, 3): how far a cue is along each piece between its four knots."""
    return np.stack([np.clip(cue, low, high) - low for low, high in zip(knots, knots[1:])], 1)


def knots_of(cue):
    knots = np.quantile(cue, KNOT_SHARES)
    return np.maximum.accumulate(knots + 1e-4 * np.arange(len(knots)))   # apart, also where many vectors have one value


def fit_monotone(columns, wrong, weights, factor=None):
    """Constant and slopes, none of them negative, of the logit that a vector is wrong: penalised maximum likelihood.

    factor(s) is the probability that what the model does not speak of is right, for a scale s that is fitted too; then the scale is
    returned as well.
    """
    spread = columns.std(0)
    spread[spread == 0] = 1
    scaled = columns / spread

    def loss(parameters):
        probability = expit(-(parameters[0] + scaled @ parameters[1:1 + scaled.shape[1]]))
        if factor is not None:
            probability = probability * factor(parameters[-1])
        probability = np.clip(probability, 1e-6, 1 - 1e-6)
        likelihood = np.where(wrong, np.log(1 - probability), np.log(probability))
        return -(weights * likelihood).sum() / weights.sum() + RIDGE * (parameters[1:1 + scaled.shape[1]] ** 2).sum()

    start = np.concatenate([[-3], np.full(scaled.shape[1], 0.1), [1.2] if factor is not None else []])
    bounds = [(None, None)] + [(0, None)] * scaled.shape[1] + ([SCALES] if factor is not None else [])
    found = minimize(loss, start, method='L-BFGS-B', bounds=bounds, options={'maxiter': 500, 'maxfun': 100000}).x
    slopes = found[1:1 + scaled.shape[1]] / spread
    return found[0], slopes.reshape(-1, 3), found[-1] if factor is not None else None


def within(deviation):
    """Probability that a normal error of this standard deviation [m] is at most RIGHT."""
    return erf(RIGHT / (np.sqrt(2) * np.maximum(deviation, 1e-9)))


def covering(promised, wrong, groups, bounds):
    """The value x at which in COVERED of the cases no more is wrong than promised(x) says.

    promised: probability that each vector is wrong, rising with x; groups: a number for each vector, the case that it is of.
    """
    found, (low, high) = [], bounds
    for group in np.unique(groups):
        of_group = groups == group
        if wrong[of_group].sum() < FEWEST:
            continue

        def excess(x, of_group=of_group):
            return promised(x)[of_group].sum() - wrong[of_group].sum()
        found.append(low if excess(low) >= 0 else high if excess(high) <= 0 else brentq(excess, low, high, xtol=1e-3))
    if not found:
        raise ValueError(f'no case has {FEWEST} vectors that are off: nothing can be fitted to them')
    value = np.sort(found)[math.ceil(COVERED * len(found)) - 1]
    if value == high:
        raise ValueError(f'more is wrong in one case of {1 / (1 - COVERED):.0f} than {high} promises: the evidence does not tell it')
    return value


class Model:
    """Both models of trust/probability.hpp."""

    def __init__(self, vectors, weights, groups):
        """groups: a number for each vector, the case that it is of."""
        self.knots = [knots_of(cue) for cue in vectors.cues.T]
        columns = np.concatenate([ramps(cue, knots) for cue, knots in zip(vectors.cues.T, self.knots)], 1)
        self.constant, self.slopes, _ = fit_monotone(columns, vectors.off_plane, weights)
        logit = self._logit_off_plane(vectors)
        likely = logit < 0   # what may be reported
        self.constant += covering(lambda shift: expit(logit[likely] + shift), vectors.off_plane[likely], groups[likely], SHIFTS)

        matched = ~vectors.off_plane
        roughness, deviation, off_height = vectors.roughness[matched], vectors.deviation[matched], vectors.off_height[matched]
        self.height_knots = knots_of(roughness)
        self.height_constant, slopes, _ = fit_monotone(ramps(roughness, self.height_knots), off_height, weights[matched],
                                                       lambda scale: within(scale * deviation))
        self.height_slopes = slopes[0]
        smooth = self._probability_of_smooth(roughness)
        self.too_little = covering(lambda scale: 1 - smooth * within(scale * deviation), off_height, groups[matched], SCALES)

    def _logit_off_plane(self, vectors):
        return self.constant + sum(ramps(cue, knots) @ slopes for cue, knots, slopes in zip(vectors.cues.T, self.knots, self.slopes))

    def _probability_of_smooth(self, roughness):
        return expit(-(self.height_constant + ramps(roughness, self.height_knots) @ self.height_slopes))

    def confidence(self, vectors):
        """Without what is dropped as an island."""
        return (expit(-self._logit_off_plane(vectors)) * self._probability_of_smooth(vectors.roughness) *
                within(self.too_little * vectors.deviation))

    def header(self, provenance):
        def piece(knots, slopes):
            return f'{{{{{", ".join(map(number_text, knots))}}}, {{{", ".join(map(number_text, slopes))}}}}}'
        lines = [f'// Written by script/fit_trust shift; do not edit. {provenance}', '#pragma once', '', 'namespace cortshift_tracking {', '',
                 'constexpr int kSlopes = 3;', '',
                 '/// The logit that a vector is wrong rises by slopes[i] per unit of the cue between knots[i] and knots[i + 1].',
                 'struct CueWeights {', '  float knots[kSlopes + 1], slopes[kSlopes];', '};', '',
                 f'constexpr float kMatchConstant = {number_text(self.constant)};',
                 'constexpr CueWeights kMatchWeights[] = {']
        lines += [f'    {piece(knots, slopes)},  // {name}' for name, knots, slopes in zip(CUES, self.knots, self.slopes)]
        lines += ['};', f'constexpr float kHeightConstant = {number_text(self.height_constant)};',
                  f'constexpr CueWeights kRoughnessWeights = {piece(self.height_knots, self.height_slopes)};',
                  f'constexpr float kExpectedTooLittle = {number_text(self.too_little)};  // times what surfaces expect: in three of four cases no more is found',
                  '', '}  // namespace cortshift_tracking', '']
        text = '\n'.join(lines)
        return text.replace('#pragma once', f'// Digest of the numbers: {digest(text)}\n#pragma once', 1)


def row_of(name, confidence, wrong):
    """Of a table: share reported, of the reported the share wrong, what is promised, and their ratio; right ones that are reported."""
    reported = confidence >= REPORTED
    is_wrong, promised = wrong[reported].mean(), (1 - confidence[reported]).mean()
    return (f'| {name} | {100 * reported.mean():.1f} % | {100 * is_wrong:.2f} % | {100 * promised:.2f} % | '
            f'{is_wrong / promised:.2f} | {100 * reported[~wrong].mean():.1f} % |')


HEADING = '| {} set: vectors of | reported | of these wrong by 0.25 mm | promised | wrong / promised | of the right ones reported |\n' + '| --- ' * 6 + '|'


def fit(evidence, header):
    random = np.random.default_rng(0)
    parts, weights, groups, shares = [], [], [], []
    for case, picture, shifts in gather(evidence, 'fit'):
        for values in shifts:
            taken = values[random.permutation(len(values))[:PER_SHIFT]]
            parts.append(taken)
            weights.append(np.full(len(taken), 1 / max(1, len(taken))))   # every shift counts the same
            groups.append(np.full(len(taken), len(shares)))
        shares.append((f'{case}, {picture}', sum(map(len, parts[-len(shifts):]))))
    vectors, weight = Vectors(np.concatenate(parts)), np.concatenate(weights)
    weight *= len(weight) / weight.sum()
    model = Model(vectors, weight, np.concatenate(groups))
    confidence, at = model.confidence(vectors), 0
    print(HEADING.format('fit'))
    for name, count in shares:
        print(row_of(name, confidence[at:at + count], vectors.wrong[at:at + count]))
        at += count
    print(row_of('all', confidence, vectors.wrong))
    header.write_text(model.header(f'Fitted on the set "fit" of benchmark/shift_trust.py: {len(parts)} shifts.'), encoding='utf-8')


def report(evidence, which):
    print(HEADING.format(which))
    everything = []
    for case, picture, shifts in gather(evidence, which):
        vectors = Vectors(np.concatenate(shifts))
        everything.append((vectors.confidence, vectors.wrong))
        print(row_of(f'{case}, {picture}', vectors.confidence, vectors.wrong), flush=True)
    confidence, wrong = (np.concatenate(part) for part in zip(*everything))
    print(row_of('all', confidence, wrong))
    print(f'\n| {which} set: confidence | share of the vectors | promised to be wrong | are |\n| --- | --- | --- | --- |')
    edges = (0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 0.98, 0.99, 1.0001)
    for low, high in zip(edges, edges[1:]):
        inside = (confidence >= low) & (confidence < high)
        print(f'| {low:.2f} to {min(high, 1):.2f} | {100 * inside.mean():.1f} % | {100 * (1 - confidence[inside]).mean():.1f} % | '
              f'{100 * wrong[inside].mean():.1f} % |')


def main():
    arguments = sys.argv[1:]
    if len(arguments) == 3 and arguments[0] == 'fit':
        fit(arguments[1], pathlib.Path(arguments[2]))
    elif len(arguments) == 3 and arguments[0] == 'report' and arguments[2] in PICTURES:
        report(arguments[1], arguments[2])
    else:
        sys.exit(__doc__)


if __name__ == '__main__':
    main()
