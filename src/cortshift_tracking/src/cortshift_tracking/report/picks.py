"""Where a person found digitised features in the images: picks.csv of a case."""
from cortshift_tracking.errors import CaseError
from cortshift_tracking.texts import read_table

FILE_NAME = 'picks.csv'
COLUMNS = ('stage', 'label', 'column_px', 'row_px')


def read_picks(path):
    """Image positions of labels: {(stage, label): (column, row)} in pixels of the rectified left image; and the lines that were
    left out, with the reason.

    CSV with the columns COLUMNS. Raises CaseError where the file as a whole cannot be read.
    """
    table = read_table(path)
    missing = [name for name in COLUMNS if name not in table.columns]
    if missing:
        raise CaseError(f'{path}: columns missing: {", ".join(missing)}; needed are {", ".join(COLUMNS)}')
    picks, lines, bad = {}, {}, list(table.bad)
    for row in table.rows:
        of = row.cells['stage'], row.cells['label']
        try:
            picks[of] = row.number('column_px'), row.number('row_px')
            lines.setdefault(of, []).append(row.line)
        except ValueError as error:
            bad.append((row.line, str(error)))
    for of, several in lines.items():
        if len(several) > 1:  # which of them is meant nobody knows
            bad += [(line, f'label "{of[1]}" of stage "{of[0]}" stands twice, in lines {" and ".join(map(str, several))}; keep one of them')
                    for line in several]
            del picks[of]
    return picks, [f'{path}, line {line}: {reason}' for line, reason in sorted(bad)]
