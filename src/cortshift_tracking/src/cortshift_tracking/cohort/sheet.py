"""The cohort sheet: a CSV with one line for each case.

Columns: case (1-64 of A-Z a-z 0-9 _ -), bag, stages (KEY@SECONDS ..., or a plan file *.yaml as process_bag takes it),
calibration (YAML of static transforms that the bag lacks; may be empty), and as one likes: shifts (FROM:TO ...; by default
every stage to the next one and the first to the last), gravity (x,y,z in pmr). Paths are relative to the sheet. A line that makes
no case is left out and named, here and in the cohort's table. Commas, semicolons or tabs may separate; see texts.py.
"""
import os
from dataclasses import dataclass
from typing import Dict, List

from cortshift_tracking.errors import CaseError
from cortshift_tracking.keys import RULE, all_pairs, is_key
from cortshift_tracking.texts import read_table

REQUIRED = ('case', 'bag', 'stages', 'calibration')
OPTIONAL = ('shifts', 'gravity')


@dataclass(frozen=True)
class CohortCase:
    """One line of the sheet; paths absolute, empty text: not given."""
    name: str
    bag: str
    stages: List[str]
    plan: str
    calibration: str
    shifts: List[str]
    gravity: str

    def arguments(self):
        """What process_bag is called with, but for output and resources."""
        arguments = [self.bag]
        if self.plan:
            arguments += ['--plan', self.plan]
        else:
            arguments += ['--capture', *self.stages, '--shift', *self.shifts]
        if self.calibration:
            arguments += ['--static-tf', self.calibration]
        if self.gravity:
            arguments += ['--gravity', self.gravity]
        return arguments

    def files(self):
        """Files that the case is made from, as far as they are there."""
        return [path for path in (self.bag, self.plan, self.calibration) if path and os.path.exists(path)]


def _case(row, folder):
    """CohortCase of one line. Raises CaseError naming the column."""
    cells = row.cells
    for column in REQUIRED[:3]:
        if not cells[column]:
            raise CaseError(f'column {column} is empty')
    if not is_key(cells['case']):
        raise CaseError(f'case "{cells["case"]}" is not {RULE}')

    def path(column):
        return os.path.normpath(os.path.join(folder, os.path.expanduser(cells[column]))) if cells.get(column) else ''
    plan = path('stages') if cells['stages'].endswith('.yaml') else ''
    times = cells['stages'].replace(',', '.') if row.decimal_comma else cells['stages']
    stages = [] if plan else times.split()
    shifts = cells.get('shifts', '').split() or [
        f'{first}:{last}' for first, last in all_pairs([stage.rpartition('@')[0] for stage in stages])]
    return CohortCase(cells['case'], path('bag'), stages, plan, path('calibration'), shifts, cells.get('gravity', ''))


@dataclass(frozen=True)
class Sheet:
    """Cases by name, in the order of the sheet; left_out: (line, reason) of the lines that make no case."""
    cases: Dict[str, CohortCase]
    left_out: List[tuple]


def read_sheet(path) -> Sheet:
    """A sheet as spreadsheets write it. Raises CaseError where no line can be read, or columns are missing."""
    table = read_table(path)
    missing = [name for name in REQUIRED if name not in table.columns]
    unknown = [name for name in table.columns if name not in REQUIRED + OPTIONAL]
    if missing or unknown:
        raise CaseError(f'{path}: columns missing: {", ".join(missing) or "none"}; unknown: {", ".join(unknown) or "none"}; '
                        f'needed are {", ".join(REQUIRED)}, possible {", ".join(OPTIONAL)}')
    cases, lines, left_out = {}, {}, list(table.bad)
    for row in table.rows:
        try:
            case = _case(row, os.path.dirname(os.path.abspath(path)))
        except CaseError as error:
            left_out.append((row.line, str(error)))
            continue
        lines.setdefault(case.name, []).append(row.line)
        cases[case.name] = case
    for name, several in lines.items():
        if len(several) > 1:  # which of them is meant nobody knows
            left_out += [(line, f'case "{name}" stands twice, in lines {" and ".join(map(str, several))}') for line in several]
            del cases[name]
    left_out.sort()
    if not cases:
        raise CaseError(f'{path}: holds no case' + ''.join(f'; line {line}: {reason}' for line, reason in left_out))
    return Sheet(cases, left_out)
