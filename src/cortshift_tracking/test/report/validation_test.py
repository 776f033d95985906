"""Tables 2 and 3 on a case whose truth is a formula."""
import csv
import os
import sys
from dataclasses import replace

import numpy as np
import pytest
from cortshift_tracking.case.folder import read_case
from cortshift_tracking.errors import CaseError
from cortshift_tracking.probe.store import ProbeStore
from cortshift_tracking.report.border import immobile_misalignment
from cortshift_tracking.report.picks import read_picks
from cortshift_tracking.report.tables import TABLE_2_HEADER, TABLE_3_HEADER, table_2, table_3, to_csv
from cortshift_tracking.report.validation import compare_pair, surface_accuracy

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
import synthetic_case as synthetic  # noqa: E402

NAMES = list(synthetic.STAGES)


@pytest.fixture(scope='module')
def exact(tmp_path_factory):
    folder = str(tmp_path_factory.mktemp('exact'))
    synthetic.write_case(folder, probe_noise=0.0)
    return read_case(folder)


def moved(points, stage, label, by):
    """The points, that label at that stage displaced by a vector [m]."""
    return [replace(p, position_pmr=tuple(p.position + by)) if (p.stage, p.label) == (stage, label) else p for p in points]


def test_case_is_read_whole(exact):
    assert [s.key for s in exact.stages] == NAMES and not exact.left_out
    assert [(f.from_key, f.to_key) for f in exact.fields] == [(NAMES[0], NAMES[1]), (NAMES[1], NAMES[2]), (NAMES[0], NAMES[2])]
    assert np.allclose(exact.gravity_pmr, synthetic.GRAVITY, atol=1e-9)
    stage = exact.stages[0]
    assert stage.points.shape == (*synthetic.SIZE, 3) and np.isnan(stage.points[:6]).all()
    assert stage.colour[100, 100].tolist() != [0, 0, 0]  # packed rgb whose float is NaN is a colour all the same


def test_everything_refers_to_the_normal_of_the_first_stage(exact):
    normal = synthetic.T_PMR_PATCH[:3, 2]
    assert np.allclose(exact.first_normal_pmr, exact.field(NAMES[0], NAMES[1]).normal_pmr)
    turned = exact.fields[0].T_pmr_projection @ np.diag([1, -1, -1, 1])
    from_mr = replace(exact.fields[0], from_key='pmr', T_pmr_projection=turned)
    assert np.allclose(replace(exact, fields=[from_mr, *exact.fields]).first_normal_pmr, exact.first_normal_pmr)
    assert replace(exact, fields=[from_mr]).first_normal_pmr @ normal > np.cos(np.radians(1))


def test_exact_probe_and_field_agree(exact):
    picks = read_picks(os.path.join(exact.folder, 'picks.csv'))[0]
    for field in exact.fields:
        both = [surface_accuracy(exact.stage(key), exact.points, picks) for key in (field.from_key, field.to_key)]
        assert max(abs(a.to_surface) for a in both[0] + both[1]) < 3e-5 and max(a.to_homologous for a in both[0]) < 3e-5
        rows = compare_pair(field, exact.stage(field.from_key), *both, exact.points)
        assert [r.label for r in rows] == list(synthetic.LABELS)
        for row in rows:
            true = [synthetic.surface(key, *map(np.array, synthetic.LABELS[row.label])) for key in (field.from_key, field.to_key)]
            assert np.linalg.norm(row.flow - (true[1] - true[0])) < 5e-5   # must show: at most 0.05 mm
            assert np.linalg.norm(row.probe - (true[1] - true[0])) < 1e-9


def axes_of_the_surface(key, label, step=1e-5):
    """Outward normal and two tangents (unit, in pmr) at a labelled place, from the formula."""
    x, y = synthetic.LABELS[label]
    along = [synthetic.surface(key, np.array(x + dx), np.array(y + dy)) - synthetic.surface(key, np.array(x), np.array(y))
             for dx, dy in ((step, 0), (0, step))]
    normal = np.cross(*along)
    across = np.cross(normal, along[0])
    return [v / np.linalg.norm(v) for v in (normal, along[0], across)]


@pytest.mark.parametrize('label', synthetic.LABELS)
@pytest.mark.parametrize('amount', [0.0003, -0.0003])
def test_a_probe_that_is_off_shows_where_and_by_how_much(exact, label, amount):
    """To the picked point: the whole length; to the surface: what is along its normal, positive outside."""
    picks = read_picks(os.path.join(exact.folder, 'picks.csv'))[0]
    for axis, to_surface in zip(axes_of_the_surface(NAMES[1], label), (amount, 0, 0)):
        found = {a.label: a for a in surface_accuracy(exact.stage(NAMES[1]), moved(exact.points, NAMES[1], label, amount * axis), picks)}
        assert abs(found[label].to_homologous - abs(amount)) < 3e-5 and abs(found[label].to_surface - to_surface) < 3e-5
        assert all(a.to_homologous < 3e-5 for other, a in found.items() if other != label)


@pytest.mark.parametrize('label', synthetic.LABELS)
def test_a_displacement_that_is_off_shows_along_its_axis(exact, label):
    """A later point that is off by 0.3 mm: along the displacement its length changes by that, across it hardly."""
    field, stage = exact.field(NAMES[0], NAMES[2]), exact.stage(NAMES[0])
    picks = read_picks(os.path.join(exact.folder, 'picks.csv'))[0]
    true = np.subtract(*(synthetic.surface(key, *map(np.array, synthetic.LABELS[label])) for key in (NAMES[2], NAMES[0])))
    along = true / np.linalg.norm(true)
    across = np.cross(along, [1, 0, 0])
    for axis, longer in ((along, 0.0003), (-along, -0.0003), (across / np.linalg.norm(across), 0)):
        points = moved(exact.points, NAMES[2], label, 0.0003 * axis)
        rows = compare_pair(field, stage, *(surface_accuracy(exact.stage(key), points, picks) for key in (NAMES[0], NAMES[2])), points)
        row, = (r for r in rows if r.label == label)
        assert np.abs(row.difference - (0.0003 * axis @ stage.T_pmr_left[:3, :3])[[2, 0, 1]]).max() < 5e-5
        assert abs(np.linalg.norm(row.probe) - np.linalg.norm(row.flow) - longer) < 6e-5


def test_components_are_along_the_microscope(exact):
    key = NAMES[0]
    axis, right = (exact.stage(key).T_pmr_left[:3, n] for n in (2, 0))
    field = exact.field(NAMES[0], NAMES[1])
    points = []
    for p in exact.points:
        shift = 0.001 * axis + 0.0002 * right if p.stage == NAMES[1] else 0
        points.append(p.__class__(p.stage, p.label, p.stamp, tuple(p.position + shift), p.spread, p.samples))
    both = [surface_accuracy(exact.stage(name), points) for name in NAMES[:2]]
    for row in compare_pair(field, exact.stage(key), *both, points):
        assert np.allclose(row.difference, [0.001, 0.0002, 0.0], atol=5e-5)


def test_tables_hold_units_and_every_pair(exact):
    second, third = table_2(exact, read_picks(os.path.join(exact.folder, 'picks.csv'))[0]), table_3(exact)
    for header, rows in ((TABLE_2_HEADER, second), (TABLE_3_HEADER, third)):
        text = list(csv.reader(to_csv(header, rows).splitlines()))
        assert text[0] == header and len(text) == 4 and all(len(row) == len(header) for row in text)
        assert all(name in ('pair', 'points', 'points_with_flow', 'warnings', 'surround') or name.rsplit('_', 1)[1] in ('mm', 'min', 'deg', 's', 'percent')
                   for name in header)
    first = dict(zip(TABLE_3_HEADER, third[0]))
    valid = exact.fields[0].displacement[exact.fields[0].valid]
    assert np.isclose(first['d_mean_mm'], np.linalg.norm(valid, axis=1).mean() * 1000, atol=1e-3)
    assert np.isclose(first['gravity_mean_mm'], (valid @ synthetic.GRAVITY).mean() * 1000, atol=1e-3)
    assert first['normal_mean_mm'] < 0 and np.isclose(first['separation_min'], 31, atol=1e-4)
    assert np.isclose(first['angle_deg'], np.degrees(np.arccos(synthetic.GRAVITY @ synthetic.T_PMR_PATCH[:3, 2])))


def test_border_that_moves_is_measured(exact):
    median, high, common, count = immobile_misalignment(exact.field(NAMES[0], NAMES[2]))
    x = np.linspace(0.022, 0.026, 50)
    expected = np.linalg.norm(synthetic.displacement_patch(1.0, x, 0 * x), axis=-1)
    assert expected.min() < median < expected.max() and high > median and count > 1000


def test_what_is_missing_is_named(exact, tmp_path):
    with pytest.raises(CaseError, match='no stage "closing"; there are: dural_opening, before_resection, after_resection'):
        exact.stage('closing')
    with pytest.raises(CaseError, match='no field after_resection -> dural_opening; there are: dural_opening -> before'):
        exact.field(NAMES[2], NAMES[0])
    with pytest.raises(CaseError, match='no such folder'):
        read_case(str(tmp_path / 'nowhere'))
    with pytest.raises(CaseError, match='holds no stage'):
        read_case(str(tmp_path))
    (tmp_path / 'picks.csv').write_text('stage,label,column_px,row_px\nfirst,p1,ten,3\n')
    picks, left_out = read_picks(str(tmp_path / 'picks.csv'))
    assert not picks and len(left_out) == 1 and 'picks.csv, line 2: column column_px: "ten" is not a number' in left_out[0]
    with pytest.raises(CaseError, match='has no surface at column 10, row 2'):
        surface_accuracy(exact.stages[0], exact.points, {(NAMES[0], 'p1'): (10, 2)})
    far = [p.__class__(p.stage, p.label, p.stamp, tuple(p.position + 0.05), 0.0, 9) for p in exact.points]
    with pytest.raises(CaseError, match='from the surface; it belongs to another stage'):
        surface_accuracy(exact.stages[0], far)


def test_damaged_bag_is_left_out_and_named(tmp_path):
    synthetic.write_stage(str(tmp_path), 1, NAMES[0], 0)
    whole = (tmp_path / f'0001_{NAMES[0]}_0.bag').read_bytes()
    (tmp_path / '0002_cut_0.bag').write_bytes(whole[:len(whole) // 2])
    case = read_case(str(tmp_path))
    assert len(case.stages) == 1 and len(case.left_out) == 1 and '0002_cut_0.bag' in case.left_out[0]
    assert ProbeStore(str(tmp_path)).points == [] and case.gravity_pmr is None
