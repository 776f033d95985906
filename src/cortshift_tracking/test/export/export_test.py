"""Exports of a displacement field, read back by independent readers."""
import base64
import csv
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
import rosbag
from cortshift_msgs.msg import ShiftSummary

from cortshift_tracking.errors import CaseError
from cortshift_tracking.export import write_field
from cortshift_tracking.case.field_bag import summarise, to_message
from cortshift_tracking.case.messages import Field, Provenance, field_from_message
from offline_tools import run_tool

KEYS = ('before', 'after')


def make_field(strain=False):
    """A small field with a hole and ragged borders."""
    random = np.random.default_rng(1)
    height, width = 30, 40
    start = np.stack(np.meshgrid(np.arange(width), np.arange(height)) + [np.zeros((height, width))], -1) * 1e-3
    start[..., 2] = 0.07 + 0.001 * random.random((height, width))
    displacement = 0.004 * random.standard_normal((height, width, 3))
    valid = np.ones((height, width), bool)
    valid[10:15, 12:20] = False
    valid[0, :5] = False
    valid[25, 30] = False
    start[~valid] = displacement[~valid] = np.nan
    extra = random.random((height, width)).astype(np.float32) if strain else None
    T = np.eye(4)
    T[:3, 3] = 0.01, -0.02, 0.03
    return Field(*KEYS, 1.7e9, 1.7e9 + 1800, T, 1e-3, start.astype(np.float32).astype(float),
                 displacement.astype(np.float32).astype(float), random.integers(0, 256, (height, width, 3), np.uint8),
                 np.where(valid, random.random((height, width)), np.nan).astype(np.float32), None, extra, extra)


@pytest.mark.parametrize('strain', [False, True])
def test_npz(tmp_path, strain):
    field = make_field(strain)
    path = str(tmp_path / 'field.npz')
    write_field(path, field, 'LPS')
    with np.load(path) as arrays:      # allow_pickle is off: plain arrays only
        np.testing.assert_array_equal(arrays['start'], field.start)
        np.testing.assert_array_equal(arrays['displacement'], field.displacement)
        np.testing.assert_array_equal(arrays['confidence'], field.confidence)
        np.testing.assert_array_equal(arrays['colour'], field.colour)
        np.testing.assert_array_equal(arrays['T_pmr_projection'], field.T_pmr_projection)
        assert (arrays['from_key'], arrays['to_key'], arrays['space']) == (*KEYS, 'LPS')
        assert (arrays['resolution'], arrays['to_stamp']) == (field.resolution, field.to_stamp)
        assert sorted(arrays['documentation'][:, 0]) == sorted(arrays.files)   # every array is described
        assert ('strain_major' in arrays.files) == strain


def test_csv(tmp_path):
    field = make_field()
    path = str(tmp_path / 'field.csv')
    write_field(path, field)
    with open(path, encoding='utf-8', newline='') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == field.valid.sum()
    again = np.full(field.start.shape, np.nan)
    for row in rows:
        again[int(row['row']), int(row['column'])] = [float(row[name]) for name in ('dx_m', 'dy_m', 'dz_m')]
        assert row['space'] == 'RAS'
    np.testing.assert_array_equal(again.astype(np.float32), field.displacement.astype(np.float32))
    row, column = int(rows[77]['row']), int(rows[77]['column'])
    assert np.float32(rows[77]['z_m']) == np.float32(field.start[row, column, 2])
    assert int(rows[77]['blue']) == field.colour[row, column, 2]


def read_ply(path):
    """Header lines and {element: structured array}, from what the header says of the layout."""
    types = {'float': '<f4', 'uchar': 'u1', 'int': '<i4'}
    with open(path, 'rb') as file:
        header = []
        while not header or header[-1] != 'end_header':
            header.append(file.readline().decode().rstrip('\n'))
        body, layouts = file.read(), []
    for words in map(str.split, header):
        if words[0] == 'element':
            layouts.append((words[1], int(words[2]), []))
        elif words[0] == 'property' and words[1] == 'list':
            layouts[-1][2].extend([('count', types[words[2]]), (words[4], types[words[3]], 3)])
        elif words[0] == 'property':
            layouts[-1][2].append((words[2], types[words[1]]))
    elements, place = {}, 0
    for name, count, layout in layouts:
        elements[name] = np.frombuffer(body, np.dtype(layout), count, place)
        place += elements[name].nbytes
    assert place == len(body)
    return header, elements


def check_mesh(field, points_mm, vectors_mm, triangles):
    """Points and vectors are those of the field, in its order; triangles join neighbours and face the projection's z."""
    rows, columns = np.nonzero(field.valid)
    np.testing.assert_allclose(points_mm, 1000 * field.start[rows, columns], rtol=1e-6)
    np.testing.assert_allclose(vectors_mm, 1000 * field.displacement[rows, columns], rtol=1e-6)
    assert len(triangles) > 1.5 * len(rows) and triangles.min() >= 0 and triangles.max() < len(rows)
    assert np.ptp(rows[triangles], axis=1).max() == 1 and np.ptp(columns[triangles], axis=1).max() == 1
    a, b, c = (np.stack([columns[triangles[:, n]], rows[triangles[:, n]]], -1) for n in range(3))
    assert (np.cross(b - a, c - a) > 0).all()


def test_ply(tmp_path):
    field = make_field()
    path = str(tmp_path / 'field.ply')
    write_field(path, field, 'LPS')
    header, elements = read_ply(path)
    assert 'comment SPACE=LPS' in header and 'comment lengths in mm' in header
    vertex, face = elements['vertex'], elements['face']
    assert (face['count'] == 3).all()
    check_mesh(field, np.stack([vertex[n] for n in 'xyz'], -1), np.stack([vertex['d' + n] for n in 'xyz'], -1),
               face['vertex_indices'])
    np.testing.assert_array_equal(np.stack([vertex[n] for n in ('red', 'green', 'blue')], -1), field.colour[field.valid])
    np.testing.assert_array_equal(vertex['confidence'], field.confidence[field.valid])


def test_vtp(tmp_path):
    field = make_field()
    path = str(tmp_path / 'field.vtp')
    write_field(path, field)
    root = ElementTree.parse(path).getroot()
    assert root.get('type') == 'PolyData' and root.get('header_type') == 'UInt32'
    strings = {node.get('Name'): bytes(map(int, node.text.split())).rstrip(b'\0').decode() for node in root.iter('Array')}
    assert strings == {'SPACE': 'RAS', 'unit': 'mm', 'from_key': KEYS[0], 'to_key': KEYS[1]}
    arrays = {}
    for node in root.iter('DataArray'):
        data = base64.b64decode(node.text)
        kind = {'Float32': '<f4', 'Int32': '<i4', 'UInt8': 'u1'}[node.get('type')]
        assert np.frombuffer(data, '<u4', 1)[0] == len(data) - 4
        arrays[node.get('Name')] = np.frombuffer(data, kind, -1, 4).reshape(-1, int(node.get('NumberOfComponents')))
    piece = next(root.iter('Piece'))
    triangles = arrays['connectivity'].reshape(-1, 3)
    assert int(piece.get('NumberOfPoints')) == field.valid.sum() and int(piece.get('NumberOfPolys')) == len(triangles)
    np.testing.assert_array_equal(arrays['offsets'].ravel(), 3 * (1 + np.arange(len(triangles))))
    assert next(root.iter('PointData')).get('Vectors') == 'displacement'
    check_mesh(field, arrays['Points'], arrays['displacement'], triangles)
    np.testing.assert_allclose(arrays['magnitude'].ravel(), np.linalg.norm(arrays['displacement'], axis=1), rtol=1e-6)
    np.testing.assert_array_equal(arrays['colour'], field.colour[field.valid])


def test_tool(tmp_path):
    field = make_field()
    bag = str(tmp_path / 'before__after.bag')
    with rosbag.Bag(bag, 'w') as out:
        message = to_message(field, summarise(field, 1.0, 0.1, field.normal_pmr))
        out.write('/shift/field', message, message.header.stamp)
    outputs = [str(tmp_path / f'field.{ending}') for ending in ('npz', 'vtp', 'ply', 'csv')]
    run_tool('export_field', bag, *outputs, '--axes', 'LPS')
    for path in outputs:
        with open(path, 'rb') as file:
            written = file.read()
        write_field(path, field, 'LPS')
        if not path.endswith('.npz'):    # its zip carries the time
            with open(path, 'rb') as file:
                assert file.read() == written
    with np.load(outputs[0]) as arrays:
        np.testing.assert_array_equal(arrays['displacement'], field.displacement)
    _, said = run_tool('export_field', bag, tmp_path / 'field.xyz', status=1)
    assert 'no format ends with ".xyz"' in said
    (tmp_path / 'no.bag').write_bytes(b'nonsense')
    _, said = run_tool('export_field', tmp_path / 'no.bag', outputs[0], status=1)
    assert 'damaged, or not a bag' in said


def test_warnings_and_provenance_go_with_the_field(tmp_path):
    plain = make_field()
    doubt = 'stage \'after\': "rows" do not agree,\nby 1.2 px'
    field = replace(plain, uncertainty=np.where(plain.valid, 0.0003, np.nan).astype(np.float32),
                    provenance=Provenance('1.0 (abc)', 'c' * 64, 'd' * 64),
                    summary=ShiftSummary(warnings=[doubt, 'another']))
    said = {'software': '1.0 (abc)', 'configuration': 'c' * 64, 'calibration': 'd' * 64,
            'warnings': 'stage \'after\': "rows" do not agree, by 1.2 px | another'}
    # Through a bag, as the tool reads it.
    field = field_from_message(to_message(field, field.summary))
    assert field.remarks == said
    for ending in ('npz', 'csv', 'vtp', 'ply'):
        write_field(str(tmp_path / f'field.{ending}'), field)
    with np.load(str(tmp_path / 'field.npz')) as arrays:
        assert {name: str(arrays[name]) for name in said} == said
        np.testing.assert_array_equal(arrays['uncertainty'], field.uncertainty)
        assert sorted(arrays['documentation'][:, 0]) == sorted(arrays.files)
    with open(tmp_path / 'field.csv', encoding='utf-8', newline='') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == field.valid.sum()
    assert all({name: row[name] for name in said} == said and float(row['uncertainty_m']) == pytest.approx(3e-4) for row in rows)
    root = ElementTree.parse(tmp_path / 'field.vtp').getroot()
    strings = {node.get('Name'): bytes(map(int, node.text.split())).rstrip(b'\0').decode() for node in root.iter('Array')}
    assert {name: strings[name] for name in said} == said
    assert any(node.get('Name') == 'uncertainty' for node in root.iter('DataArray'))
    header, elements = read_ply(tmp_path / 'field.ply')
    assert all(f'comment {name} {text}' in header for name, text in said.items())
    np.testing.assert_allclose(elements['vertex']['uncertainty'], 0.3, rtol=1e-6)


def test_unknown_ending(tmp_path):
    with pytest.raises(CaseError):
        write_field(str(tmp_path / 'field'), make_field())
