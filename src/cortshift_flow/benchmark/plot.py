#!/usr/bin/python3
"""Plots benchmark_flow's table: median error against time, one panel per case.

usage: plot.py TABLE.md OUT.png
"""
import sys

import matplotlib
matplotlib.use('Agg')
import matplotlib.pyplot as plt  # noqa: E402


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    cases = {}
    for line in open(sys.argv[1]):
        cells = [cell.strip() for cell in line.strip().strip('|').split('|')]
        if len(cells) == 10 and cells[0] not in ('case', '---'):
            cases.setdefault(cells[0], []).append((cells[1], float(cells[2].split('/')[0]), float(cells[8])))
    figure, axes = plt.subplots(1, len(cases), figsize=(5.5 * len(cases), 4.5), squeeze=False)
    for axis, (case, rows) in zip(axes[0], cases.items()):
        for method, error, seconds in rows:
            ours = method.startswith('cortshift')
            axis.plot(seconds, error, 'o', color='tab:red' if ours else 'tab:grey')
            axis.annotate(method, (seconds, error), fontsize=7, xytext=(3, 3), textcoords='offset points')
        axis.set(xscale='log', yscale='log', title=case, xlabel='time with two threads [s]',
                 ylabel='median error [px]')
        axis.grid(True, which='both', alpha=0.2)
    figure.tight_layout()
    figure.savefig(sys.argv[2], dpi=110)


if __name__ == '__main__':
    main()
