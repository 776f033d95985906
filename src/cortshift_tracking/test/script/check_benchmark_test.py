"""Figures of the documents against those of the last run: what differs is named, what only the machine decides is not."""
import json

import pytest
from scripts import script

check = script('check_benchmark')

MEASURED = """
| case | method | error px | s, 1 thread | default / DIS, ratio |
| --- | --- | --- | --- | --- |
| outward | ours | 0.0073 / 0.0117 | 0.307 | 3.1 |
| outward | DIS | 0.1480 / 0.1807 | 0.120 | 1.0 |

threads: 2
| shift | error mm: median / 95 % |
|---|---|
| demo, a → b | 0.0226 / 0.078 |
"""


@pytest.fixture
def results(tmp_path):
    check.keep(tmp_path / 'flow.json', MEASURED)
    return check.results_of(tmp_path)


def said(text):
    return MEASURED.replace(*text)


def test_what_was_measured_is_the_same(results):
    assert check.differences(MEASURED, results) == []


@pytest.mark.parametrize('change, named', [
    (('0.0073', '0.0072'), 'outward | ours: error px'),
    (('0.1807', '0.3'), 'outward | DIS'),
    (('3.1', '5.1'), 'ratio'),
    (('| outward | DIS', '| inward | DIS'), 'no result shows the row "inward | DIS"'),
    (('error px', 'error mm'), 'no result has the table'),
    (('0.0226 / 0.078', '0.0226 / -'), 'demo, a → b'),
])
def test_what_differs_is_named(results, change, named):
    found = check.differences(said(change), results)
    assert len(found) == 1 and named in found[0]


@pytest.mark.parametrize('change', [
    ('0.307', '0.281'),         # seconds of another machine
    ('3.1', '2.9'),             # a ratio of times, nearly the same
    ('0.0226', '0.023'),        # fewer digits of the same number
    ('0.0226', '0.02'),
])
def test_what_may_differ(results, change):
    assert check.differences(said(change), results) == []


@pytest.mark.parametrize('mark, named', [
    ('0.02 mm<!-- benchmark: demo, a → b | error mm | 1 -->', None),
    ('0.08 mm<!-- benchmark: demo, a → b | error mm | 2 -->', None),
    ('0.03 mm<!-- benchmark: demo, a → b | error mm | 1 -->', 'said 0.03, measured 0.0226'),
    ('0.02 mm<!-- benchmark: demo, a → c | error mm | 1 -->', 'no result shows demo, a → c'),
    ('0.02 mm<!-- benchmark: demo, a → b | error mm | 3 -->', 'no result shows'),
    ('some<!-- benchmark: demo, a → b | error mm | 1 -->', 'behind no number'),
    ('0.02 mm<!-- benchmark: demo -->', 'behind no number'),
])
def test_figures_with_a_comment(results, mark, named):
    found = check.marked_differences(f'The median is {mark} there.', results)
    assert (found == []) if named is None else (len(found) == 1 and named in found[0])


def test_the_last_run_counts(tmp_path):
    (tmp_path / 'b.json').write_text(json.dumps({'commit': '', 'tables': [{'headings': ['x', 'error'], 'rows': [['a', '1']]}]}))
    (tmp_path / 'a.json').write_text(json.dumps({'commit': '', 'tables': [{'headings': ['x', 'error'], 'rows': [['a', '2']]}]}))
    import os
    os.utime(tmp_path / 'b.json', (1, 1))
    assert check.results_of(tmp_path)[('x', 'error')][('a',)] == ['a', '2']


def test_the_documents_have_something_to_check():
    tables = check.tables((check.ROOT / 'BENCHMARK.md').read_text())
    assert sum(len(rows) for _, rows in tables) > 150
    assert all(len(row) == len(headings) for headings, rows in tables for row in rows)
    assert (check.ROOT / 'README.md').read_text().count('<!-- benchmark:') >= 5
