"""The cohort's Table 3: every pair of every patient, mean and standard deviation over the patients, failures by name."""
import html
import math

import numpy as np

from cortshift_tracking.report.tables import TABLE_3_HEADER, TABLE_3_WORDS, to_csv

COLUMNS = [name for name in TABLE_3_HEADER if name not in TABLE_3_WORDS]   # numbers
HEADER = ['case', 'status', 'pair'] + COLUMNS + ['case_seconds', 'case_peak_memory_mb', 'reason', 'warnings']
PAIRED = (('d', 'Magnitude'), ('gravity', 'Along gravity'), ('normal', 'Along the normal'), ('lateral', 'Lateral'),
          ('brain_d', 'Brain alone'))
NAN = float('nan')


def _number(text):
    return float(text) if text not in ('', None) else NAN


def overall_pair(result):
    """The row of a result's table that spans the case: of the longest separation in time. None for a failed case."""
    rows = result['table']
    return max(rows, key=lambda row: _number(row['separation_min'])) if rows else None


def over_patients(results):
    """(N, mean, sd) of the patients' overall pairs: two dictionaries by column of COLUMNS; sd of a sample, NaN for one."""
    rows = [row for row in map(overall_pair, results) if row is not None]
    mean, sd = {}, {}
    for column in COLUMNS:
        values = np.array([_number(row.get(column)) for row in rows])
        values = values[np.isfinite(values)]
        mean[column] = float(values.mean()) if len(values) else NAN
        sd[column] = float(values.std(ddof=1)) if len(values) > 1 else NAN
    return len(rows), mean, sd


def table_rows(results):
    """Rows under HEADER: one for each pair, one for each failed case, then mean and sd over the patients."""
    rows = []
    for result in results:
        tail = [result['seconds'], result['peak_memory_mb'], result['reason']]
        for row in result['table'] or [None]:
            numbers = [_number(row.get(column)) if row else NAN for column in COLUMNS]
            rows.append([result['case'], result['status'], row['pair'] if row else ''] + numbers + tail
                        + [row.get('warnings', '') if row else ''])
    count, mean, sd = over_patients(results)
    for name, values in ((f'mean over {count} patients', mean), (f'sd over {count} patients', sd)):
        rows.append([name, '', 'first -> last'] + [values[column] for column in COLUMNS] + [NAN, NAN, '', ''])
    return rows


def csv_text(results):
    return to_csv(HEADER, table_rows(results))


def _pm(row, name, digits=2):
    mean, sd = _number(row.get(f'{name}_mean_mm')), _number(row.get(f'{name}_sd_mm'))
    if not math.isfinite(mean):
        return ''
    return f'{mean:.{digits}f} ± {sd:.{digits}f}' if math.isfinite(sd) else f'{mean:.{digits}f}'


def _cells(values, tag='td'):
    return '<tr>' + ''.join(f'<{tag}>{html.escape(str(value))}</{tag}>' for value in values) + '</tr>\n'


def html_page(results, pictures):
    """A self-contained page. pictures: (data URI, description) of each."""
    body = _cells(['Case', 'Pair', 'Minutes'] + [f'{title} [mm]' for _, title in PAIRED]
                  + ['Gravity to normal [deg]', 'Overlap [%]', 'Case [s]', 'Memory [MB]'], 'th')
    for result in results:
        time_and_memory = [f'{result["seconds"]:.1f}', result['peak_memory_mb']]
        if result['status'] != 'done':
            body += (f'<tr class="failed"><td>{html.escape(result["case"])}</td><td colspan="{4 + len(PAIRED)}">failed: '
                     f'{html.escape(result["reason"])}</td><td>{time_and_memory[0]}</td><td>{time_and_memory[1]}</td></tr>\n')
            continue
        for row in result['table']:
            angle, overlap = _number(row['angle_deg']), _number(row['overlap_percent'])
            body += _cells([result['case'], row['pair'], f'{_number(row["separation_min"]):.1f}']
                           + [_pm(row, name) for name, _ in PAIRED]
                           + [f'{angle:.0f}' if math.isfinite(angle) else '', f'{overlap:.0f}'] + time_and_memory)
            if row.get('warnings'):
                body += f'<tr class="warned"><td colspan="{5 + len(PAIRED) + 2}">{html.escape(row["warnings"])}</td></tr>\n'
    count, mean, sd = over_patients(results)

    def spread(column):
        if not math.isfinite(mean[column]):
            return ''
        return f'{mean[column]:.2f}' + (f' ± {sd[column]:.2f}' if math.isfinite(sd[column]) else '')
    body += _cells([f'{count} patients', 'first -> last', spread('separation_min')]
                   + [spread(f'{name}_mean_mm') for name, _ in PAIRED] + [spread('angle_deg'), spread('overlap_percent'), '', ''], 'th')
    failed = [result['case'] for result in results if result['status'] != 'done']
    images = '\n'.join(f'<p><img src="{uri}" alt="{html.escape(text)}"></p>' for uri, text in pictures)
    style = ('body{font:15px/1.4 sans-serif;margin:24px}table{border-collapse:collapse;font-size:13px}td,th{border:1px solid #ccc;'
             'padding:3px 8px;text-align:left}th{background:#f1f1f1}.failed{background:#fde4e1}.warned{background:#fff3cd}img{max-width:100%}')
    return (f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>cortshift: cohort</title><style>{style}</style>'
            f'</head><body>\n<h1>Cortical shift of {len(results)} cases</h1>\n<p>{len(results) - len(failed)} processed'
            + (f', {len(failed)} failed: {html.escape(", ".join(failed))}' if failed else '')
            + '. Within a pair: mean ± standard deviation over all trusted points. Last line: mean ± standard deviation over '
            'the patients, of their first to their last stage. Research software, not for clinical use.</p>\n'
            f'<table>\n{body}</table>\n{images}\n</body></html>\n')
