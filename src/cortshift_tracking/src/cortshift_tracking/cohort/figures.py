"""Pictures of a cohort."""
import matplotlib
import numpy as np
from matplotlib.figure import Figure

from cortshift_tracking.cohort.table import PAIRED, overall_pair

matplotlib.rcParams['savefig.dpi'] = 110
COLOURS = ('#3b4cc0', '#8a8a8a', '#d1495b', '#2a9d8f', '#e9a23b')


def displacement_figure(results):
    """Mean and standard deviation of each patient's first to last stage, and over the patients."""
    done = [(result['case'], overall_pair(result)) for result in results if result['table']]
    figure = Figure(figsize=(max(7, 1.0 * len(done) + 3), 4.5), constrained_layout=True)
    axes = figure.add_subplot()
    width = 0.8 / len(PAIRED)
    for n, (name, title) in enumerate(PAIRED):
        means = np.array([float(row.get(f'{name}_mean_mm') or 'nan') for _, row in done])
        sds = np.array([float(row.get(f'{name}_sd_mm') or 'nan') for _, row in done])
        if not np.isfinite(means).any():
            continue
        place = np.arange(len(done)) + (n - (len(PAIRED) - 1) / 2) * width
        axes.bar(place, means, width, yerr=sds, color=COLOURS[n], label=title, error_kw={'lw': 0.8})
        axes.bar(len(done) + 0.5 + (n - (len(PAIRED) - 1) / 2) * width, np.nanmean(means), width, color=COLOURS[n],
                 yerr=np.nanstd(means, ddof=1) if np.isfinite(means).sum() > 1 else None, error_kw={'lw': 1.6})
    axes.axhline(0, color='black', lw=0.6)
    axes.axvline(len(done) - 0.25, color='#bbbbbb', lw=0.8)
    axes.set_xticks([*range(len(done)), len(done) + 0.5])
    axes.set_xticklabels([name for name, _ in done] + ['all patients'], rotation=30, ha='right')
    axes.set_ylabel('displacement [mm]')
    axes.set_title('First to last stage: mean ± standard deviation', loc='left')
    axes.legend(frameon=False, ncol=len(PAIRED))
    return figure


def cost_figure(results):
    """Time and peak memory of each case."""
    figure = Figure(figsize=(max(7, 0.7 * len(results) + 3), 4), constrained_layout=True)
    for n, (key, label) in enumerate((('seconds', 'time [s]'), ('peak_memory_mb', 'peak memory [MB]'))):
        axes = figure.add_subplot(2, 1, n + 1)
        axes.bar(range(len(results)), [result[key] for result in results],
                 color=['#3b4cc0' if result['status'] == 'done' else '#d1495b' for result in results])
        axes.set_ylabel(label)
        axes.set_xticks(range(len(results)))
        axes.set_xticklabels([result['case'] for result in results] if n else [''] * len(results), rotation=30, ha='right')
    figure.axes[0].set_title('Cost of each case (red: failed)', loc='left')
    return figure
