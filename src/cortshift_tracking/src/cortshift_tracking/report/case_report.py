"""The report of a case: one HTML file with everything in it, and tables as CSV beside it."""
import os

from cortshift_tracking.case.folder import read_case
from cortshift_tracking.durable import write_durably
from cortshift_tracking.errors import CaseError, VolumeError
from cortshift_tracking.mr.admission import admit_mr
from cortshift_tracking.report import picks as picked
from cortshift_tracking.report import sections, updated_mr
from cortshift_tracking.report.page import page, table, warning_box
from cortshift_tracking.report.tables import TABLE_2_HEADER, TABLE_3_HEADER, table_2, table_3, to_csv
from cortshift_tracking.report.warnings import warnings_of

NOTE_3 = ('Mean and standard deviation over all trusted points. Gravity: positive with it. Normal: of the first stage, positive bulging. '
          'Lateral: across that normal. Angle: from gravity to the normal. pmr: the brain of the preoperative MR. The points include '
          'what lies around the craniotomy. Empty: not known.')
NOTE_2 = ('Accuracy: digitised point to its homologous point on the surface (needs picks.csv). Distance: to the surface itself. Surface '
          '1, 2: all points digitised at the earlier and at the later stage; probe 1, 2: those that both stages share. Difference: '
          'probe minus flow; axis: the microscope\'s optical axis at the earlier stage; across: its two perpendiculars, mean absolute '
          'components.')


def make_report(folder, mr=None, title=None, mr_may_fail=False):
    """HTML text and {file name: CSV text} of a case folder.

    mr: MrSource, or None. mr_may_fail: it was not asked for, so that the report is made without it where it cannot be used.
    What cannot be read of the folder is left out and named in the report. Raises CaseError where nothing is left, VolumeError
    where the MR cannot be used.
    """
    case = read_case(folder)
    left_out = []
    volume = _volume(case, mr, left_out if mr_may_fail else None)
    second, third = table_2(case, _picks(folder, left_out), left_out), table_3(case)
    updates = [updated_mr.section(update, case, volume, left_out) for update in updated_mr.read_updates(folder, left_out)]
    title = title or os.path.basename(os.path.abspath(folder))
    parts = [sections.head(case, title), warning_box(warnings_of(case, left_out, volume)), sections.calibration(case),
             sections.timeline(case), table('Displacement between stages (Table 3 of the paper)', TABLE_3_HEADER, third, NOTE_3)]
    if second:
        parts.append(table('Probe against surface and field (Table 2 of the paper)', TABLE_2_HEADER, second, NOTE_2, transpose=True))
    else:
        parts.append('<h2>Probe against surface and field</h2><p>No label was digitised at both stages of a pair.</p>')
    parts.append(sections.slices(case, volume, *left_out[:1] if mr and not volume else ()))
    parts += updates
    parts += [sections.pair(case, field) for field in case.fields]
    if not case.fields:
        parts.append('<h2>Fields</h2><p>No displacement field was computed.</p>')
    return page(title, parts), {'table_2.csv': to_csv(TABLE_2_HEADER, second), 'table_3.csv': to_csv(TABLE_3_HEADER, third)}


def _volume(case, mr, left_out):
    if mr is None:
        return None
    try:
        return admit_mr(mr, [(stage.key, stage.points) for stage in case.stages])
    except VolumeError as error:
        if left_out is None:
            raise
        left_out.append(str(error))
        return None


def _picks(folder, left_out):
    path = os.path.join(folder, picked.FILE_NAME)
    if not os.path.exists(path):
        return {}
    try:
        picks, bad = picked.read_picks(path)
    except CaseError as error:
        left_out.append(str(error))
        return {}
    left_out += bad
    return picks


def write_report(folder, content, tables, name='report'):
    """Write the page and the tables into the case folder. Returns the page's path."""
    path = os.path.join(folder, name + '.html')
    write_durably(path, content)
    for file, rows in tables.items():
        write_durably(os.path.join(folder, file), rows)
    return path
