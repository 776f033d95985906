#!/usr/bin/python3
"""Fits what the confidence of the flow makes of its evidence, or prints how reliable it is. script/fit_trust flow and script/benchmark flow trust
run it.

usage: fit_trust.py fit TOOLS HEADER [SET]     fits on SET (default fit), writes HEADER, prints figures of that set
       fit_trust.py report TOOLS SET [FOLDER]  how reliable the confidence is on SET (judge, choose); RubberWhale with FOLDER's truth
TOOLS is the folder of flow_evidence, flow_pair and make_phantom.
"""
import os
import pathlib
import subprocess
import sys
import tempfile
from multiprocessing.pool import ThreadPool

import cv2
import numpy as np

import trust_model
import trust_pairs

STEP = 4           # of the evidence's nodes [px]
PER_PAIR = 2500    # vectors of each pair that take part
FITS = 3           # kinds of fit: FitKind of trust/judgement.hpp
BINS = (0.5, 0.7, 0.9, 0.95, 0.98, 0.99, 1.0001)   # of confidence


def evidence_of(tools, names, images, flow, folder):
    """For each kind of fit: evidence (vectors, names) and error [px] where the flow is known."""
    paths = [str(pathlib.Path(folder) / name) for name in ('first.png', 'second.png', 'evidence')]
    for path, image in zip(paths, images):
        cv2.imwrite(path, image)
    subprocess.run([str(tools / 'flow_evidence'), *paths], check=True)
    raw = pathlib.Path(paths[2]).read_bytes()
    found, at = {}, 0
    while at < len(raw):
        kind, rows, columns = np.frombuffer(raw, '<i4', 3, at)
        values = np.frombuffer(raw, '<f4', rows * columns * (len(names) + 2), at + 12).reshape(rows, columns, -1)
        at += 12 + values.nbytes
        error = np.hypot(*np.moveaxis(values[..., :2] - flow[::STEP, ::STEP], -1, 0))
        known = np.isfinite(error)
        found[int(kind)] = values[..., 2:][known].astype(float), error[known]
    return found


def fit(tools, header, which):
    names = subprocess.run([str(tools / 'flow_evidence'), '--names'], check=True, stdout=subprocess.PIPE,
                           universal_newlines=True).stdout.split()
    random = np.random.default_rng(0)
    cues, errors, weights = ([[] for _ in range(FITS)] for _ in range(3))

    def gather(pair):
        name, first, second, flow = pair
        with tempfile.TemporaryDirectory() as folder:
            return name, evidence_of(tools, names, (first, second), flow, folder)
    with tempfile.TemporaryDirectory() as scratch:
        pairs = trust_pairs.pairs(which, str(tools / 'make_phantom'), scratch)
        count = 0
        for name, found in ThreadPool(os.cpu_count()).imap(gather, pairs):
            count += 1
            if sys.stderr.isatty():
                print(f'\r{count} pairs, {name}          ', end='', file=sys.stderr)
            for kind, (values, error) in found.items():
                taken = random.permutation(len(error))[:PER_PAIR]
                cues[kind].append(values[taken])
                errors[kind].append(error[taken])
                weights[kind].append(np.full(len(taken), 1 / max(1, len(taken))))   # every pair counts the same
    models = []
    for kind in range(FITS):
        all_cues, error, weight = (np.concatenate(parts[kind]) for parts in (cues, errors, weights))
        weight *= len(weight) / weight.sum()
        models.append(trust_model.fit(all_cues, (error > trust_model.WRONG).astype(float), weight))
        figures = trust_model.figures(trust_model.doubt(trust_model.probability_of_wrong(all_cues, models[-1])), error)
        print(f'fit {kind}: {len(error)} vectors; ' + ', '.join(f'{key} {100 * value:.2f} %' for key, value in figures.items()))
    header.write_text(trust_model.header(models, names, f'Fitted on the set "{which}" of benchmark/trust_pairs.py: {count} pairs.'))


def judged_pairs(tools, which, folder, scratch):
    for name, first, second, flow in trust_pairs.pairs(which, str(tools / 'make_phantom'), scratch):
        kind = 'phantom ' + name.split()[1] if name.startswith('phantom') else name.split()[1]
        yield kind, first, second, flow
    truth = pathlib.Path(folder) / 'rubberwhale' / 'flow_gt.flo' if folder else None
    if truth and truth.exists():
        yield ('RubberWhale', *(cv2.imread(str(trust_pairs.find(f'rubberwhale{number}.png'))) for number in (1, 2)),
               trust_pairs.read_flow(truth))


def report(tools, which, folder):
    """Prints a table by kind of disturbance and the reliability diagram over all."""
    found = {}

    def judge(pair):
        kind, first, second, flow = pair
        with tempfile.TemporaryDirectory() as place:
            paths = [str(pathlib.Path(place) / name) for name in ('first.png', 'second.png', 'out.flo', 'confidence.png')]
            for path, image in zip(paths, (first, second)):
                cv2.imwrite(path, image)
            subprocess.run([str(tools / 'flow_pair'), *paths[:3], '--confidence', paths[3], '--threads', '1'], check=True,
                           stdout=subprocess.DEVNULL)
            error = np.hypot(*np.moveaxis(trust_pairs.read_flow(paths[2]) - flow, -1, 0))
            known = np.isfinite(error)
            return kind, 1 - cv2.imread(paths[3], cv2.IMREAD_UNCHANGED)[known].astype(float) / 255, error[known]
    with tempfile.TemporaryDirectory() as scratch:
        for kind, wrong, error in ThreadPool(os.cpu_count()).imap(judge, judged_pairs(tools, which, folder, scratch)):
            found.setdefault(kind, []).append((wrong, error))
    print(f'| {"judging" if which == "judge" else which} set | median / mean px | wrong by 0.5 px | of these flagged | right to 0.1 px and '
          'kept | reported: wrong by 0.5 px | by 0.25 px | promised | confidently wrong, of all |\n' + '| --- ' * 9 + '|')
    joined = {kind: tuple(np.concatenate(part) for part in zip(*parts)) for kind, parts in found.items()}
    photographs = [value for kind, value in joined.items() if kind != 'RubberWhale' and not kind.startswith('phantom')]
    joined['all photographs'] = tuple(np.concatenate(part) for part in zip(*photographs))
    for kind, (wrong, error) in joined.items():
        figures = {key: f'{100 * value:.1f} %' for key, value in trust_model.figures(wrong, error).items()}
        print(f"| {kind} | {np.median(error):.3f} / {error.mean():.3f} | " + ' | '.join(figures[key] for key in (
            'wrong', 'flagged', 'kept', 'reported_wrong', 'off', 'promised', 'confidently_wrong')) + ' |')
    print('\n| confidence of the photographs\' vectors | share | promised to be off by 0.25 px | are |\n| --- | --- | --- | --- |')
    wrong, error = joined['all photographs']
    for low, high in zip(BINS, BINS[1:]):
        inside = (1 - wrong >= low) & (1 - wrong < high)
        if inside.any():
            print(f'| {low:.2f} to {min(high, 1):.2f} | {100 * inside.mean():.1f} % | {100 * wrong[inside].mean():.1f} % | '
                  f'{100 * (error[inside] > trust_model.WRONG).mean():.1f} % |')


def main():
    arguments = sys.argv[1:]
    cv2.setNumThreads(1)
    if len(arguments) in (3, 4) and arguments[0] == 'fit':
        fit(pathlib.Path(arguments[1]), pathlib.Path(arguments[2]), arguments[3] if len(arguments) == 4 else 'fit')
    elif len(arguments) in (3, 4) and arguments[0] == 'report' and arguments[2] in trust_pairs.PHOTOGRAPHS:
        report(pathlib.Path(arguments[1]), arguments[2], arguments[3] if len(arguments) == 4 else '')
    else:
        sys.exit(__doc__)


if __name__ == '__main__':
    main()
