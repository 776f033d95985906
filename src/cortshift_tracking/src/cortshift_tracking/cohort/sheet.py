"""The cohort sheet: a CSV with one line for each case.

Columns: case (1-64 of A-Z a-z 0-9 _ -), bag, stages (KEY@SECONDS ..., or a plan file *.yaml as process_bag takes it),
calibration (YAML of static transforms that the bag lacks; may be empty), and as one likes: shifts (FROM:TO ...; by default
every stage to the next one and the first to the last), gravity (x,y,z in pmr). Paths are relative to the sheet.
"""
import csv
import os
from dataclasses import dataclass
from typing import Dict, List

from cortshift_tracking.errors import CaseError
from cortshift_tracking.keys import RULE, all_pairs, is_key

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


def _case(row, folder, where):
    for column in REQUIRED[:3]:
        if not row[column]:
            raise CaseError(f'{where}: column {column} is empty')
    if not is_key(row['case']):
        raise CaseError(f'{where}: case "{row["case"]}" is not {RULE}')

    def path(column):
        return os.path.normpath(os.path.join(folder, row[column])) if row.get(column) else ''
    plan = path('stages') if row['stages'].endswith('.yaml') else ''
    stages = [] if plan else row['stages'].split()
    shifts = (row.get('shifts') or '').split() or [
        f'{first}:{last}' for first, last in all_pairs([stage.rpartition('@')[0] for stage in stages])]
    return CohortCase(row['case'], path('bag'), stages, plan, path('calibration'), shifts, row.get('gravity') or '')


def read_sheet(path) -> Dict[str, CohortCase]:
    """Cases by name, in the order of the sheet. Raises CaseError naming line and column, OSError."""
    cases = {}
    with open(path, encoding='utf-8', newline='') as file:
        reader = csv.DictReader(file)
        columns = [name.strip() for name in reader.fieldnames or []]
        missing = [name for name in REQUIRED if name not in columns]
        unknown = [name for name in columns if name not in REQUIRED + OPTIONAL]
        if missing or unknown:
            raise CaseError(f'{path}: columns missing: {", ".join(missing) or "none"}; unknown: {", ".join(unknown) or "none"}; '
                            f'needed are {", ".join(REQUIRED)}, possible {", ".join(OPTIONAL)}')
        reader.fieldnames = columns
        for row in reader:
            where = f'{path}, line {reader.line_num}'
            if None in row or None in row.values():
                raise CaseError(f'{where}: it has another number of columns than the first line')
            case = _case({name: value.strip() for name, value in row.items()}, os.path.dirname(os.path.abspath(path)), where)
            if case.name in cases:
                raise CaseError(f'{where}: case "{case.name}" stands twice')
            cases[case.name] = case
    if not cases:
        raise CaseError(f'{path}: holds no case')
    return cases
