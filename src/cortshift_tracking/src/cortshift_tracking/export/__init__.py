"""Displacement fields as files of other programs: one module for each format, each with write(path, field, axes)."""
import os

from cortshift_tracking.errors import CaseError
from cortshift_tracking.export import csv_table, npz, ply, vtp

FORMATS = {'npz': npz, 'vtp': vtp, 'ply': ply, 'csv': csv_table}


def write_field(path, field, axes='RAS'):
    """Write a messages.Field in the format that the path's ending names. axes: what pmr's axes point to, RAS or LPS.

    The file is there whole or not at all. Raises CaseError for an unknown ending, OSError where it cannot be written.
    """
    ending = os.path.splitext(path)[1].lstrip('.').lower()
    if ending not in FORMATS:
        raise CaseError(f'{path}: no format ends with ".{ending}"; there are: {", ".join(FORMATS)}')
    FORMATS[ending].write(path, field, axes)
