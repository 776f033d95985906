"""A synthetic cohort of twelve through script/cohort: two cases that fail alone, a kill in the middle, the table; on cores and
through Slurm."""
import csv
import json
import math
import os
import re
import shutil
import signal
import statistics
import subprocess
import time

import pytest

import recorded_cases as cases
from cortshift_tracking.cohort.sheet import read_sheet
from cortshift_tracking.errors import CaseError
from cortshift_tracking.report.tables import TABLE_3_HEADER
from offline_tools import ROOT, run_tool
from slurm import Slurm

COHORT = str(ROOT / 'script/cohort')
SETTINGS = ('--config', 'settings=' + cases.CONFIG)
GOOD = [f'p{n:02d}' for n in range(1, 11)]
SIZE = (240, 180)


@pytest.fixture(scope='module')
def sheet(tmp_path_factory):
    """Sheet of twelve cases: ten patients with five different displacements, one cut recording, one camera that has moved."""
    folder = str(tmp_path_factory.mktemp('cohort'))
    bags = [cases.record(folder, f'base{n}', SIZE, sag=0.002 + 0.001 * n, lateral=0.0004 * n, seed=3 + n)[0] for n in range(5)]
    lines = ['case,bag,stages,calibration,gravity']
    stages = ' '.join(cases.CAPTURES)
    for n, name in enumerate(GOOD):
        shutil.copy(bags[n % 5], os.path.join(folder, name + '.bag'))
        lines.append(f'{name},{name}.bag,{stages},,"-0.42,-0.66,-0.62"')
    chunks = cases.rewrite(bags[0], os.path.join(folder, 'chunks.bag'), chunk_threshold=5000)
    cases.cut(chunks, os.path.join(folder, 'cut.bag'), os.path.getsize(chunks) // 2)
    cases.rewrite(bags[1], os.path.join(folder, 'moved.bag'), cases.tilt_right_camera)
    lines[5:5] = [f'cut,cut.bag,{stages},,', f'moved,moved.bag,{stages},,']
    path = os.path.join(folder, 'sheet.csv')
    with open(path, 'w', encoding='utf-8') as file:
        file.write('\n'.join(lines) + '\n')
    return path


def run(sheet, output, *arguments):
    return subprocess.run([COHORT, sheet, output, *SETTINGS, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          universal_newlines=True, check=False)


def results_in(output):
    folder = os.path.join(output, 'results')
    return sorted(name[:-5] for name in os.listdir(folder) if name.endswith('.json')) if os.path.isdir(folder) else []


def written(output):
    """{case: its result, and which file that is}. Snakemake touches what is finished, so that the time says nothing."""
    found = {}
    for name in results_in(output):
        path = os.path.join(output, 'results', name + '.json')
        with open(path, encoding='utf-8') as file:
            found[name] = os.stat(path).st_ino, file.read()
    return found


def table_of(output):
    with open(os.path.join(output, 'cohort.csv'), encoding='utf-8', newline='') as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope='module')
def on_cores(sheet, tmp_path_factory):
    """Folder, results of before and what was said of a run that was killed and called again."""
    output = str(tmp_path_factory.mktemp('cores') / 'out')
    first = subprocess.Popen([COHORT, sheet, output, *SETTINGS, '--cores', '2'], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                             start_new_session=True)
    while len(results_in(output)) < 5 and first.poll() is None:
        time.sleep(0.05)
    assert first.poll() is None, 'it ended before it could be killed'
    os.killpg(first.pid, signal.SIGKILL)
    first.wait()
    before = written(output)
    assert 5 <= len(before) < 12 and not os.path.exists(os.path.join(output, 'cohort.csv'))
    second = run(sheet, output, '--cores', '2')
    assert second.returncode == 0, second.stdout
    return output, before, second.stdout


def test_cohort(on_cores):
    output, before, said = on_cores
    assert len(results_in(output)) == 12 and before.items() <= written(output).items()   # not done again
    assert sorted(name for name in os.listdir(os.path.join(output, 'cases'))) == GOOD
    for name in GOOD:
        assert os.path.getsize(os.path.join(output, 'cases', name, 'report.html')) > 100000
    assert '10 of 12 cases processed' in said and 'cut failed' in said and 'moved failed' in said

    rows = table_of(output)
    by_case = {row['case']: row for row in rows}
    assert len(rows) == 14 and all(by_case[name]['status'] == 'done' for name in GOOD)
    assert 'was not captured' in by_case['cut']['reason'] and by_case['cut']['status'] == 'failed'
    assert 'and the calibration' in by_case['moved']['reason'] and by_case['moved']['status'] == 'failed'
    for name in (*GOOD, 'cut', 'moved'):
        assert float(by_case[name]['case_seconds']) > 0 and float(by_case[name]['case_peak_memory_mb']) > 20
    for column in ('d_mean_mm', 'gravity_mean_mm', 'normal_mean_mm', 'lateral_mean_mm', 'angle_deg'):
        values = [float(by_case[name][column]) for name in GOOD]
        assert math.isclose(float(by_case['mean over 10 patients'][column]), statistics.mean(values), abs_tol=2e-4)
        assert math.isclose(float(by_case['sd over 10 patients'][column]), statistics.stdev(values), abs_tol=2e-4)
    assert float(by_case['sd over 10 patients']['d_mean_mm']) > 0.1
    with open(os.path.join(output, 'cohort.html'), encoding='utf-8') as file:
        page = file.read()
    assert '10 processed, 2 failed: cut, moved' in page and page.count('data:image/png') == 2



def kill_in_the_middle(slurm, output, cohort):
    """Kill the node while it works and some results are there. Returns those results."""
    while True:
        while len(results_in(output)) < 3 and cohort.poll() is None:
            time.sleep(0.05)
        assert cohort.poll() is None and len(results_in(output)) < 12, 'it ended before the node could be killed'
        slurm.signal_jobs(signal.SIGSTOP)   # what is written now stays so
        before, running = written(output), slurm.running_jobs()
        if any(job.startswith('cohort-') and job[len('cohort-'):] not in before for job in running):
            slurm.fail_node()
            return before
        slurm.signal_jobs(signal.SIGCONT)


def test_slurm(sheet, on_cores, tmp_path):
    """The node's power fails while it works: the same table as on cores, and nothing finished is done again."""
    output = str(tmp_path / 'out')
    with Slurm() as slurm, open(tmp_path / 'said', 'w', encoding='utf-8') as file:
        cohort = subprocess.Popen([COHORT, sheet, output, *SETTINGS, '--profile', 'slurm'], stdout=file, stderr=subprocess.STDOUT,
                                  env=dict(slurm.environment, CI='true'))   # for CI Snakemake asks each second, not every ten
        try:
            before = kill_in_the_middle(slurm, output, cohort)
            slurm.start_node()
            status = cohort.wait()
        finally:
            cohort.kill()
            cohort.wait()
        restarts = slurm.ask('scontrol', '--oneliner', 'show', 'jobs')
    said = (tmp_path / 'said').read_text()
    assert status == 0 and '10 of 12 cases processed' in said, said
    assert 3 <= len(before) < 12 and before.items() <= written(output).items()   # not done again
    assert re.search('Restarts=[1-9]', restarts), restarts   # what was lost is done by Slurm's queue, not by another submission
    assert said.count('Submitted job') == 12

    def without_cost(rows):
        return [{name: value for name, value in row.items() if not re.search('seconds|memory|time', name)} for row in rows]
    assert without_cost(table_of(output)) == without_cost(table_of(on_cores[0]))


def test_one_changed_line_is_one_case_done_again(sheet, on_cores):
    output, before, _ = on_cores
    third = run(sheet, output)
    assert third.returncode == 0 and 'Nothing to be done' in third.stdout
    with open(sheet, encoding='utf-8') as file:
        changed = file.read().replace('cut,cut.bag,' + ' '.join(cases.CAPTURES), 'cut,cut.bag,dural_opening@3.1 again@3.2')
    with open(sheet, 'w', encoding='utf-8') as file:
        file.write(changed)
    fourth = run(sheet, output)
    assert fourth.returncode == 0 and '11 of 12 cases processed' in fourth.stdout, fourth.stdout
    assert {name: result for name, result in before.items() if name != 'cut'}.items() <= written(output).items()


def test_memory_is_bounded(sheet, tmp_path):
    """A case gets no more memory than declared, and says so."""
    with open(sheet, encoding='utf-8') as file:
        lines = file.read().splitlines()
    one = os.path.join(os.path.dirname(sheet), 'one.csv')
    with open(one, 'w', encoding='utf-8') as file:
        file.write('\n'.join(lines[:2]) + '\n')
    done = run(one, str(tmp_path / 'out'), '--config', 'mem_mb=40')
    assert done.returncode == 0 and 'p01 failed' in done.stdout, done.stdout
    with open(tmp_path / 'out/results/p01.json', encoding='utf-8') as file:
        result = json.load(file)
    assert result['status'] == 'failed' and 'raise mem_mb' in result['reason'] and result['table'] == []
    done = run(one, str(tmp_path / 'out'), '--retry-failed', '--config', 'exports=npz csv')
    assert '1 of 1 cases processed' in done.stdout, done.stdout
    assert os.path.exists(tmp_path / 'out/cases/p01' / ('__'.join(cases.STAGES) + '.npz'))


@pytest.mark.parametrize('text, reason', [
    ('case,bag,stages\np1,a.bag,a@1\n', 'columns missing: calibration'),
    ('case,bag,stages,calibration,colour\n', 'unknown: colour'),
    ('case,bag,stages,calibration\n', 'holds no case'),
    ('case,bag,stages,calibration\np1,,a@1,\n', 'line 2: column bag is empty'),
    ('case,bag,stages,calibration\np/1,a.bag,a@1,\n', 'line 2: case "p/1"'),
    ('case,bag,stages,calibration\np1,a.bag,a@1,\np1,b.bag,a@1,\n', 'line 3: case "p1" stands twice, in lines 2 and 3'),
    ('case,bag,stages,calibration\np1,a.bag,a@1\n', 'line 2: it has 3 columns, the first line 4')])
def test_a_sheet_of_which_nothing_is_left_is_refused(tmp_path, text, reason):
    (tmp_path / 'sheet.csv').write_text(text)
    with pytest.raises(CaseError) as refused:
        read_sheet(str(tmp_path / 'sheet.csv'))
    assert reason in str(refused.value)


def test_bad_lines_are_left_out_and_stand_in_the_table(tmp_path):
    lines = ['p1,a.bag,a@1 b@2,', 'p/2,a.bag,a@1,', 'p3,,a@1,', 'p4,a.bag,a@1', 'p5,a.bag,a@1,', 'p5,b.bag,a@1,']
    (tmp_path / 'sheet.csv').write_text('case,bag,stages,calibration\n' + '\n'.join(lines) + '\n')
    sheet = read_sheet(str(tmp_path / 'sheet.csv'))
    assert list(sheet.cases) == ['p1'] and [line for line, _ in sheet.left_out] == [3, 4, 5, 6, 7]
    row = dict.fromkeys(TABLE_3_HEADER, '1.0')
    row.update(pair='a -> b', warnings='the microscope moved')
    (tmp_path / 'p1.json').write_text(json.dumps({'case': 'p1', 'status': 'done', 'reason': '', 'seconds': 1.0, 'peak_memory_mb': 50,
                                                  'table': [row]}))
    said, _ = run_tool('cohort_table', tmp_path / 'p1.json', '--output', tmp_path, '--sheet', tmp_path / 'sheet.csv')
    assert '1 of 6 cases processed' in said and 'line 4 failed: column bag is empty' in said
    with open(tmp_path / 'cohort.csv', encoding='utf-8', newline='') as file:
        rows = {row['case']: row for row in csv.DictReader(file)}
    assert rows['line 5']['reason'] == 'it has 3 columns, the first line 4' and rows['line 3']['status'] == 'failed'
    assert rows['p1']['warnings'] == 'the microscope moved'
    page = (tmp_path / 'cohort.html').read_text()
    assert 'the microscope moved' in page and 'case &quot;p5&quot; stands twice, in lines 6 and 7' in page
    (tmp_path / 'p1.json').write_text('{')
    _, refused = run_tool('cohort_table', tmp_path / 'p1.json', '--output', tmp_path, status=1)
    assert 'p1.json: is no whole result of a case; process the case again' in refused


@pytest.mark.parametrize('encoded', [
    lambda text: text.encode('utf-8-sig'), lambda text: text.encode('utf-16'), lambda text: text.encode('latin-1'),
    lambda text: text.replace(',', ';').replace('@2.5', '@2,5').replace('\n', '\r\n').encode('cp1252')],
    ids=['mark', 'utf-16', 'latin-1', 'semicolons'])
def test_sheets_of_spreadsheets(tmp_path, encoded):
    text = 'case,bag,stages,calibration\np1,Müller case/a b.bag,a@1 b@2.5,\n'
    (tmp_path / 'sheet.csv').write_bytes(encoded(text))
    case = read_sheet(str(tmp_path / 'sheet.csv')).cases['p1']
    assert case.bag == str(tmp_path / 'Müller case/a b.bag') and case.stages == ['a@1', 'b@2.5']


def test_sheet(tmp_path):
    (tmp_path / 'sheet.csv').write_text('case,bag,stages,calibration\np1,sub/a.bag,a@1 b@2.5 c@3,../fixed.yaml\np2,b.bag,plan.yaml,\n')
    first, second = read_sheet(str(tmp_path / 'sheet.csv')).cases.values()
    assert first.arguments() == [str(tmp_path / 'sub/a.bag'), '--capture', 'a@1', 'b@2.5', 'c@3', '--shift', 'a:b', 'b:c', 'a:c',
                                 '--static-tf', str(tmp_path.parent / 'fixed.yaml')]
    assert second.arguments() == [str(tmp_path / 'b.bag'), '--plan', str(tmp_path / 'plan.yaml')]
