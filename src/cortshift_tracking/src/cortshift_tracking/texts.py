"""Text files as people's programs write them: UTF-8 with or without mark, UTF-16, Latin-1; CSV with commas,
semicolons or tabs; YAML."""
import codecs
import csv
import math
import re
from dataclasses import dataclass

import yaml

from cortshift_tracking.errors import CaseError

#: Longest first: the mark of UTF-32 begins like that of UTF-16.
MARKS = ((codecs.BOM_UTF8, 'utf-8'), (codecs.BOM_UTF32_LE, 'utf-32-le'), (codecs.BOM_UTF32_BE, 'utf-32-be'),
         (codecs.BOM_UTF16_LE, 'utf-16-le'), (codecs.BOM_UTF16_BE, 'utf-16-be'))
DELIMITERS = ',;\t'
OPENCV_HEAD = re.compile(r'\A%YAML:1\.\d')  # OpenCV's FileStorage; YAML has a blank there


class YamlReader(yaml.SafeLoader):
    """YAML as yaml-cpp reads it in the nodes: the matrices of OpenCV are dictionaries."""


YamlReader.add_constructor('tag:yaml.org,2002:opencv-matrix', lambda reader, node: reader.construct_mapping(node, deep=True))


def decoded(data, path):
    """Text of bytes. Raises CaseError where they are no text. path: for the message."""
    for mark, encoding in MARKS:
        if data.startswith(mark):
            candidates, data = [encoding], data[len(mark):]
            break
    else:
        # Without mark, UTF-16 of western text has a zero in every second byte.
        zeros = [data[first::2].count(0) * 4 > len(data) for first in (0, 1)]
        candidates = ['utf-16-be'] if zeros[0] else ['utf-16-le'] if zeros[1] else ['utf-8', 'cp1252', 'latin-1']
    for encoding in candidates:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if '\0' not in text:
            return text
    raise CaseError(f'{path}: is not a text file; save it as text in UTF-8')


def read_text(path):
    """Text of a file. Raises CaseError where it cannot be read, or is no text."""
    try:
        with open(path, 'rb') as file:
            return decoded(file.read(), path)
    except OSError as error:
        raise CaseError(f'{path}: cannot be read ({error.strerror})') from error


def read_yaml(path):
    """Content of a YAML file, also of OpenCV's. Raises CaseError where it cannot be read, or is no YAML."""
    try:
        return yaml.load(OPENCV_HEAD.sub('#', read_text(path)), YamlReader)
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        raise CaseError(f'{path}: is not YAML{f" (line {mark.line + 1})" if mark else ""}; correct it, or restore it from a copy') from error
    except (ValueError, RecursionError) as error:  # a date or a number that looks like one and is none; lists in lists without end
        raise CaseError(f'{path}: holds a value that cannot be read ({error}); correct it, or restore it from a copy') from error


@dataclass(frozen=True)
class Row:
    """One line of a table: number of the line in the file, and the texts by column without blanks around them."""
    line: int
    cells: dict
    decimal_comma: bool

    def number(self, column):
        """Finite number in a column; with a decimal comma where semicolons or tabs separate. Raises ValueError naming the column."""
        text = self.cells[column]
        try:
            value = float(text.replace(',', '.') if self.decimal_comma else text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise ValueError(f'column {column}: "{text}" is not a number')
        return value


@dataclass(frozen=True)
class Table:
    """columns: names in the first line; rows: lines that hold something; bad: (line, reason) of lines that do not fit."""
    columns: list
    rows: list
    bad: list


def read_table(path):
    """A CSV with a line of column names. Raises CaseError where the file as a whole cannot be read."""
    lines = read_text(path).splitlines(keepends=True)
    skipped = 0
    if lines and lines[0].lower().startswith('sep='):  # written by spreadsheets, for spreadsheets
        skipped = 1
    head = lines[skipped] if len(lines) > skipped else ''
    delimiter = max(DELIMITERS, key=head.count)
    reader = csv.reader(lines[skipped:], delimiter=delimiter)
    columns, rows, bad = [], [], []
    try:
        for cells in reader:
            cells, line = [cell.strip() for cell in cells], reader.line_num + skipped
            if not any(cells):  # spreadsheets add separators without anything between
                continue
            if not columns:
                columns = cells
                while not columns[-1]:
                    columns.pop()
                continue
            while len(cells) > len(columns) and not cells[-1]:
                cells.pop()
            if len(cells) != len(columns):
                bad.append((line, f'it has {len(cells)} columns, the first line {len(columns)}'))
            else:
                rows.append(Row(line, dict(zip(columns, cells)), delimiter != ','))
    except csv.Error as error:
        raise CaseError(f'{path}, line {reader.line_num + skipped}: is not CSV; check its quotation marks') from error
    return Table(columns, rows, bad)
