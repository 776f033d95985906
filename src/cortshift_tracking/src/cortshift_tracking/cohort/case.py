"""One case of a cohort: process_bag, report and exports, and a result that says how it went."""
import csv
import glob
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import time

from cortshift_tracking.durable import write_durably
from cortshift_tracking.errors import CaseError

INTERRUPTED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)   # somebody stopped the cohort, not this case
TABLE = 'table_3.csv'
OUT_OF_MEMORY = re.compile('bad_alloc|MemoryError|SystemError|[Aa]llocat|cannot map|failed to map')


class Interrupted(Exception):
    """The run was stopped from outside; the case is to be done again."""


class CaseFailed(Exception):
    """The case cannot be processed; the message is its reason."""


def _run(tool, arguments, log, limit_mb=0):
    """Run a tool of this package. Raises CaseFailed with what it said on stderr."""
    def bound():
        if limit_mb:
            resource.setrlimit(resource.RLIMIT_DATA, (limit_mb << 20, limit_mb << 20))
    done = subprocess.run(['rosrun', 'cortshift_tracking', tool, *map(str, arguments)], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, universal_newlines=True, check=False, preexec_fn=bound,
                          # Each thread of OpenBLAS wants 128 MB, asks for them for ever, and its library waits for it at the end.
                          env=dict(os.environ, OPENBLAS_NUM_THREADS='1'))
    log.write(f'$ {tool} {" ".join(map(str, arguments))}\n{done.stdout}{done.stderr}')
    log.flush()
    if done.returncode < 0 or done.returncode > 128:
        number = -done.returncode if done.returncode < 0 else done.returncode - 128
        if number in INTERRUPTED:
            raise Interrupted(f'{tool} was stopped')
        raise CaseFailed(f'{tool} was ended by signal {number}; where memory is short, raise mem_mb')
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if line.strip() and 'WARN' not in line]
        if any(line.startswith('Traceback') for line in lines):
            lines = [f'{tool}: {lines[-1]}']
        reason = '; '.join(line.partition(f'{tool}: ')[2] or line for line in lines) or f'{tool} ended with {done.returncode}'
        raise CaseFailed(reason + ('; raise mem_mb' if OUT_OF_MEMORY.search(reason) else ''))


def process_case(case, folder, log, limit_mb, threads, config='', exports=()):
    """Stages, fields, report and exports of a CohortCase in `folder`, which appears when all of it is there.

    Returns the rows of its Table 3 as dictionaries of text. Raises CaseFailed, Interrupted, OSError.
    """
    part = folder + '.part'
    for stale in (part, folder):
        shutil.rmtree(stale, ignore_errors=True)
    try:
        arguments = [*case.arguments(), '--output', part, '--threads', threads]
        _run('process_bag', arguments + (['--config', config] if config else []), log, limit_mb)
        _run('case_report', [part, '--no-pdf', '--title', case.name], log, limit_mb)
        for bag in sorted(glob.glob(os.path.join(glob.escape(part), '*__*.bag'))):
            if exports:
                _run('export_field', [bag, *(f'{bag[:-4]}.{ending}' for ending in exports)], log, limit_mb)
        with open(os.path.join(part, TABLE), encoding='utf-8', newline='') as file:
            rows = list(csv.DictReader(file))
        os.rename(part, folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return rows


def run_case(case, folder, log_path, limit_mb, threads, config='', exports=()):
    """As process_case, with the outcome as a dictionary: case, status (done or failed), reason, seconds, peak_memory_mb,
    table. Raises Interrupted where the run was stopped."""
    begin = time.monotonic()
    rows, reason = [], ''
    with open(log_path, 'w', encoding='utf-8') as log:
        try:
            rows = process_case(case, folder, log, limit_mb, threads, config, exports)
        except (CaseFailed, OSError) as error:
            reason = str(error)
            log.write(f'failed: {reason}\n')
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    return {'case': case.name, 'status': 'failed' if reason else 'done', 'reason': reason,
            'seconds': round(time.monotonic() - begin, 2), 'peak_memory_mb': round(peak), 'table': rows}


def write_result(path, result):
    write_durably(path, json.dumps(result, indent=1) + '\n')


def read_result(path):
    """A result of write_result. Raises CaseError where it is none, OSError."""
    try:
        with open(path, encoding='utf-8') as file:
            result = json.load(file)
        return {key: result[key] for key in line_result(0, '')}
    except (ValueError, KeyError, TypeError) as error:
        raise CaseError(f'{path}: is no whole result of a case; process the case again') from error


def line_result(line, reason):
    """The result of a line of the sheet that makes no case."""
    return {'case': f'line {line}', 'status': 'failed', 'reason': reason, 'seconds': 0.0, 'peak_memory_mb': 0, 'table': []}
