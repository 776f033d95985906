#!/usr/bin/python3
"""Plots benchmark_flow's table: median error against time, one panel per case.

usage: plot.py TABLE.md OUT.png
"""
import sys

import matplotlib
matplotlib.use('Agg')
import matplotlib.pyplot as plt  # noqa: E402


def letter(methods, method):
    return chr(ord('a') + methods.index(method))


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    cases = {}
    for line in open(sys.argv[1]):
        cells = [cell.strip() for cell in line.strip().strip('|').split('|')]
        if len(cells) == 10 and cells[0] not in ('case', '---'):
            cases.setdefault(cells[0], []).append((cells[1], float(cells[2].split('/')[0]), float(cells[8])))
    methods = list(dict.fromkeys(method for rows in cases.values() for method, _, _ in rows))
    figure, axes = plt.subplots(1, len(cases), figsize=(4.5 * len(cases) + 2.5, 4.5), squeeze=False)
    for axis, (case, rows) in zip(axes[0], cases.items()):
        for method, error, seconds in rows:
            # A letter in the dot and one list beside the panels: names at the dots would cover one another.
            colour = 'tab:red' if method.startswith('cortshift') else 'tab:grey'
            axis.plot(seconds, error, 'o', color=colour, markersize=11, alpha=0.75)
            axis.annotate(letter(methods, method), (seconds, error), color='white', fontsize=8, ha='center', va='center')
        axis.set(xscale='log', yscale='log', title=case, xlabel='time with two threads [s]',
                 ylabel='median error [px]')
        axis.grid(True, which='both', alpha=0.2)
    names = '\n'.join(f'{letter(methods, method)}  {method}' for method in methods)
    figure.tight_layout(rect=(0, 0, 1 - 2.5 / figure.get_figwidth(), 1))
    figure.text(1 - 2.4 / figure.get_figwidth(), 0.5, names, va='center', linespacing=1.6)
    figure.savefig(sys.argv[2], dpi=110)


if __name__ == '__main__':
    main()
