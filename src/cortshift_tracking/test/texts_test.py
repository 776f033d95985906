"""Text files as people's programs write them."""
import codecs

import pytest
from cortshift_tracking.errors import CaseError
from cortshift_tracking.texts import read_table, read_text, read_yaml

LINES = 'stage,label,column_px\nöffnung,Müller,1.5\nzu,Ångström,-2\n'
WESTERN = {'utf-8': LINES.encode(), 'utf-8 with mark': codecs.BOM_UTF8 + LINES.encode(), 'latin-1': LINES.encode('latin-1'),
           'utf-16 of a spreadsheet': LINES.encode('utf-16'), 'utf-16 big': codecs.BOM_UTF16_BE + LINES.encode('utf-16-be'),
           'utf-16 without mark': LINES.encode('utf-16-le'), 'utf-16 big without mark': LINES.encode('utf-16-be'),
           'utf-32': LINES.encode('utf-32'), 'carriage returns': LINES.replace('\n', '\r\n').encode(),
           'old carriage returns': LINES.replace('\n', '\r').encode(), 'no last line end': LINES.rstrip().encode(),
           'tabs': LINES.replace(',', '\t').encode(), 'semicolons': LINES.replace(',', ';').encode(),
           'decimal commas': LINES.replace(',', ';').replace('1.5', '1,5').encode('cp1252'),
           'quoted': LINES.replace('Müller', '"Müller"').encode(), 'blanks': LINES.replace(',', ' , ').encode(),
           'separators at the end': LINES.replace('\n', ',,\n').encode() + b',,,,\n\n',
           'sep line': b'sep=;\r\n' + LINES.replace(',', ';').encode()}


@pytest.mark.parametrize('name', WESTERN)
def test_the_same_table_however_it_is_written(tmp_path, name):
    (tmp_path / 'a.csv').write_bytes(WESTERN[name])
    table = read_table(str(tmp_path / 'a.csv'))
    assert table.columns == ['stage', 'label', 'column_px'] and not table.bad
    assert [(row.cells['stage'], row.cells['label'], row.number('column_px')) for row in table.rows] == [
        ('öffnung', 'Müller', 1.5), ('zu', 'Ångström', -2)]
    assert [row.line for row in table.rows] == ([3, 4] if name == 'sep line' else [2, 3])


@pytest.mark.parametrize('text, line, reason', [
    ('a,b\n1\n1,2\n', 2, 'it has 1 columns, the first line 2'), ('a,b\n1,2\n\n1,2,3\n', 4, 'it has 3 columns, the first line 2')])
def test_lines_that_do_not_fit_are_told(tmp_path, text, line, reason):
    (tmp_path / 'a.csv').write_text(text)
    table = read_table(str(tmp_path / 'a.csv'))
    assert table.bad == [(line, reason)] and len(table.rows) == 1


@pytest.mark.parametrize('text', ['ten', '1,5', '', 'nan', 'inf', '1.5 mm', '0x10'])
def test_what_is_no_number_is_told(tmp_path, text):
    (tmp_path / 'a.csv').write_text(f'a,b\n"{text}",x\n')
    with pytest.raises(ValueError) as refusal:
        read_table(str(tmp_path / 'a.csv')).rows[0].number('a')
    assert str(refusal.value) == f'column a: "{text}" is not a number'


@pytest.mark.parametrize('data, reason', [(b'\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\x01', 'is not a text file; save it as text in UTF-8'),
                                          (codecs.BOM_UTF8 + b'\xff\xff', 'is not a text file'), (b'a,"b\n1,2\0', 'is not a text file')])
def test_what_is_no_text_is_refused(tmp_path, data, reason):
    (tmp_path / 'a.csv').write_bytes(data)
    with pytest.raises(CaseError, match=reason):
        read_text(str(tmp_path / 'a.csv'))


def test_what_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(CaseError, match=r'nothing.csv: cannot be read \(No such file or directory\)'):
        read_table(str(tmp_path / 'nothing.csv'))
    with pytest.raises(CaseError, match=r'cannot be read \(Is a directory\)'):
        read_table(str(tmp_path))


@pytest.mark.parametrize('text, reason', [('date: 2024-13-45', 'month must be in 1..12'), ('code: 0x_', 'invalid literal'),
                                          ('[' * 3000, 'maximum recursion depth exceeded')], ids=['date', 'number', 'deep'])
def test_yaml_of_values_that_are_none_is_refused_by_the_file(tmp_path, text, reason):
    (tmp_path / 'a.yaml').write_text(text)
    with pytest.raises(CaseError, match=rf'a.yaml: holds a value that cannot be read \({reason}.*\); correct it, or restore it from a copy$'):
        read_yaml(tmp_path / 'a.yaml')


def test_yaml_of_opencv(tmp_path):
    (tmp_path / 'a.yaml').write_text('%YAML:1.0\n---\nK: !!opencv-matrix\n   rows: 1\n   cols: 2\n   dt: d\n   data: [ 1., 2.5 ]\n')
    assert read_yaml(tmp_path / 'a.yaml') == {'K': {'rows': 1, 'cols': 2, 'dt': 'd', 'data': [1.0, 2.5]}}
    (tmp_path / 'a.yaml').write_text('K: !!opencv-matrix\n  [1\n')
    with pytest.raises(CaseError, match='is not YAML'):
        read_yaml(tmp_path / 'a.yaml')
