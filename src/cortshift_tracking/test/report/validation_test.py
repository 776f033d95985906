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


@pytest.fixture(scope='module')
def noisy(tmp_path_factory):
    """Accuracies and pairs of first -> last over 40 sets of probe points with 0.3 mm noise."""
    folder = str(tmp_path_factory.mktemp('noisy'))
    synthetic.write_case(folder, probe_noise=0.0)
    case = read_case(folder)
    picks = read_picks(os.path.join(folder, 'picks.csv'))[0]
    random = np.random.default_rng(4)
    accuracies, rows = [], []
    for _ in range(40):
        points = [p.__class__(p.stage, p.label, p.stamp, tuple(p.position + random.normal(0, 0.0003, 3)), p.spread, p.samples)
                  for p in case.points if p.stage in (NAMES[0], NAMES[2])]
        both = [surface_accuracy(case.stage(key), points, picks) for key in (NAMES[0], NAMES[2])]
        accuracies += both[0]
        rows += compare_pair(case.field(NAMES[0], NAMES[2]), case.stage(NAMES[0]), *both, points)
    return accuracies, rows


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


def test_noise_of_the_probe_appears_as_it_should(noisy):
    accuracies, rows = noisy
    # To the homologous point: the length of three components of 0.3 mm; to the surface: one component.
    assert np.isclose(np.sqrt(np.mean([a.to_homologous ** 2 for a in accuracies])), 0.0003 * np.sqrt(3), rtol=0.1)
    assert np.isclose(np.sqrt(np.mean([a.to_surface ** 2 for a in accuracies])), 0.0003, rtol=0.12)
    # A displacement is the difference of two points; its length sees the noise along itself.
    differences = np.array([r.difference for r in rows])
    assert np.allclose(np.sqrt((differences ** 2).mean(0)), 0.0003 * np.sqrt(2), rtol=0.15)
    lengths = np.array([np.linalg.norm(r.probe) - np.linalg.norm(r.flow) for r in rows])
    assert np.isclose(lengths.std(), 0.0003 * np.sqrt(2), rtol=0.15)


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
        assert all(name in ('pair', 'points', 'points_with_flow') or name.rsplit('_', 1)[1] in ('mm', 'min', 'deg', 's', 'percent')
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
