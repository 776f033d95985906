"""Pieces of the report's page: text, pictures, tables."""
import html
import math
import re

import numpy as np

from cortshift_tracking.report import figures

STYLE = '''
body { font: 15px/1.45 "DejaVu Sans", Arial, sans-serif; color: #1c1c1c; max-width: 1200px; margin: 24px auto; padding: 0 20px; }
h1 { font-size: 26px; margin-bottom: 4px; } h2 { font-size: 20px; border-bottom: 1px solid #bbb; margin-top: 34px; }
h3 { font-size: 16px; } img { max-width: 100%; display: block; }
table { border-collapse: collapse; margin: 10px 0; font-size: 13px; } td, th { border: 1px solid #c9c9c9; padding: 4px 8px; }
tr { page-break-inside: avoid; } th { background: #f1f1f1; text-align: left; } td.n { text-align: right; white-space: nowrap; }
.warning { background: #fff4d6; border-left: 5px solid #d89b00; padding: 8px 14px; margin: 12px 0; }
.small { color: #555; font-size: 13px; } figure { margin: 12px 0; page-break-inside: avoid; } figcaption { font-weight: bold; font-size: 16px; margin: 14px 0 6px; }
@page { size: A4; margin: 12mm; } @media print { body { max-width: none; margin: 0; font-size: 11px; } table { font-size: 8.5px; }
 table, h1, h2 { page-break-inside: avoid; } td, th { padding: 2px 3px; } h2, h3 { page-break-after: avoid; }
 h2.pair { page-break-before: always; } img { max-height: 118mm; margin: 0 auto; } figcaption { font-size: 12px; } }
'''


def text(value):
    """HTML of any text."""
    return html.escape(str(value))


def page(title, sections):
    """A whole HTML file; sections: HTML of each."""
    return (f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>cortshift: {text(title)}</title>'
            f'<style>{STYLE}</style></head><body>\n' + '\n'.join(sections) + '\n</body></html>\n')


def picture(figure, description, caption=''):
    """figure: of matplotlib, or the bytes of a PNG."""
    above = f'<figcaption>{text(caption)}</figcaption>' if caption else ''
    uri = figures.png_uri(figure) if isinstance(figure, bytes) else figures.to_data_uri(figure)
    return f'<figure>{above}<img src="{uri}" alt="{text(description)}"></figure>'


def warning_box(warnings):
    if not warnings:
        return '<p>No warnings.</p>'
    return '<div class="warning"><b>Warnings</b><ul>' + ''.join(f'<li>{text(w)}</li>' for w in warnings) + '</ul></div>'


def _number(value):
    if isinstance(value, (float, np.floating)):
        return f'{value:.2f}' if math.isfinite(value) else ''
    return str(value)


def _cells(header, row):
    """(name, text, whether it is a number) for each column; NAME_mean_mm and NAME_sd_mm become one, millimetres go unsaid."""
    cells = []
    for name, value in zip(header, row):
        if name.endswith('_sd_mm') and cells and name[:-6] == cells[-1][0]:
            if _number(value):
                cells[-1] = (*cells[-1][:1], f'{cells[-1][1]} \u00b1 {_number(value)}', True)
        else:
            cells.append((re.sub('(_mean)?_mm$', '', name), _number(value), not isinstance(value, str)))
    return cells


def _column_title(name):
    """What a reader sees of a column's name in the CSV."""
    if name == 'pair':
        return 'pair; lengths in mm'
    if name == 'd':
        return '|d|'
    base, _, unit = name.rpartition('_')
    sign = {'min': 'min', 's': 's', 'deg': '\u00b0', 'percent': '%'}.get(unit)
    return f'{base.replace("_", " ")} / {sign}' if base and sign else name.replace('_', ' ')


def table(title, header, rows, note, transpose=False):
    """Rows as a table; transposed, a row becomes a column."""
    titles = [_column_title(name) for name, _, _ in _cells(header, [0.0] * len(header))]
    columns = [[(shown, number) for _, shown, number in _cells(header, row)] for row in rows]

    def cell(value, number):
        return f'<td{" class=n" if number else ""}>{text(value)}</td>'
    if transpose:
        body = ''.join(f'<tr><th>{text(name)}</th>{"".join(cell(*column[n]) for column in columns)}</tr>'
                       for n, name in enumerate(titles))
    else:
        body = f'<tr>{"".join(f"<th>{text(name)}</th>" for name in titles)}</tr>' + ''.join(
            f'<tr>{"".join(cell(*c) for c in column)}</tr>' for column in columns)
    return f'<h2>{text(title)}</h2><table>{body}</table><p class="small">{text(note)}</p>'
