"""One judgement of a preoperative MR at both doors, register_mr and case_report: refused for the same reason, or taken."""
import json
import os
import subprocess
import sys

import nibabel
import numpy as np
import pytest
from cortshift_tracking.case.folder import read_case
from cortshift_tracking.errors import VolumeError
from cortshift_tracking.mr.admission import MrSource, about_source, admit_mr, remembered_source
from cortshift_tracking.report.case_report import make_report

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, '..', 'support'))
import synthetic_case as synthetic  # noqa: E402

STEP, SIZE = 2.0, 60   # mm, voxels
FIRST = list(synthetic.STAGES)[0]


@pytest.fixture(scope='module')
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp('case')
    synthetic.write_stage(str(folder), 1, FIRST, 0)
    return folder


def ball():
    """Voxels of a bright ball whose border is the first stage's surface, and their place in RAS [mm]."""
    affine = np.diag([STEP, STEP, STEP, 1.0])
    affine[:3, 3] = synthetic.T_PMR_PATCH[:3, 3] * 1000 - SIZE * STEP / 2
    grid = np.stack(np.meshgrid(*[np.arange(SIZE)] * 3, indexing='ij'), -1) @ affine[:3, :3] + affine[:3, 3]
    patch = (grid / 1000 - synthetic.T_PMR_PATCH[:3, 3]) @ synthetic.T_PMR_PATCH[:3, :3]
    return (100.0 * (np.linalg.norm(patch - [0, 0, -0.075], axis=-1) < 0.075)).astype(np.float32), affine


def write(path, data, affine, sform=1, qform=0, unit='mm', change=None):
    image = nibabel.Nifti1Image(data, None)
    image.header.set_xyzt_units(unit)
    image.set_sform(affine, code=sform)
    image.set_qform(affine if qform else None, code=qform)
    if change:
        change(image.header)
    nibabel.save(image, path)
    return str(path)


def with_hole(data, at):
    data[tuple(slice(v, v + 2) for v in at)] = np.nan
    return data


def surfaces_of(case):
    return [(stage.key, stage.points) for stage in read_case(str(case)).stages]


REFUSED = {
    'MNI': ({'sform': 4}, None, r'sform_code 4 says coordinates of the MNI template.*--template-space'),
    'Talairach': ({'sform': 0, 'qform': 3}, None, r'qform_code 3 says coordinates of the Talairach atlas.*--template-space'),
    'unknown space': ({'change': lambda h: h.__setitem__('sform_code', 9)}, None, 'sform_code 9 is none that NIfTI knows|does not say where'),
    'four-dimensional': ({}, lambda d: np.stack([d, d], -1), r'holds 2 volumes'),
    'one slice': ({}, lambda d: d[:, :, 30:31], r'is a single slice \(60 x 60 x 1 voxels\)'),
    'unknown unit': ({'change': lambda h: h.__setitem__('xyzt_units', 7)}, None, 'xyzt_units 7 names no unit'),
    'microns': ({'unit': 'micron'}, None, 'voxel spacing|long, which is no head'),
    'blank': ({}, np.zeros_like, 'every voxel is 0, so it shows nothing'),
    'nothing finite': ({}, lambda d: d * np.nan, 'holds no finite voxel'),
    'holes at the surface': ({}, lambda d: with_hole(d, (30, 30, 30)), r'8 voxels around surface "dural_opening" are not numbers'),
    'elsewhere': ({}, lambda d: d[:8, :8, :], r'surface "dural_opening" lies outside .*: only 0% of it'),
}


@pytest.mark.parametrize('name', REFUSED)
def test_what_one_door_refuses_the_other_does(case, tmp_path, name):
    header, change, reason = REFUSED[name]
    data, affine = ball()
    path = write(tmp_path / 'mr.nii', change(data) if change else data, affine, **header)
    with pytest.raises(VolumeError, match=reason) as refusal:
        admit_mr(MrSource(path), surfaces_of(case))
    with pytest.raises(VolumeError) as at_report:
        make_report(str(case), MrSource(path))
    assert str(at_report.value) == str(refusal.value)


def test_an_mr_is_remembered_with_how_it_was_meant(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / 'mr.nii', *ball())
    about = json.loads(json.dumps(about_source(MrSource('mr.nii', 'LPS', 'qform', '77', True))))
    monkeypatch.chdir('/')
    assert remembered_source(about, '', '--mr') == MrSource(str(tmp_path / 'mr.nii'), 'LPS', 'qform', '77', True)
    older = {'mr_source': str(tmp_path / 'mr.nii'), 'axes': 'RAS'}   # of a model of earlier versions
    assert remembered_source(older, '', '--mr') == MrSource(str(tmp_path / 'mr.nii'))
    os.remove(tmp_path / 'mr.nii')
    with pytest.raises(VolumeError, match='mr.nii: the MR is not there any more; give it by parameter mr'):
        remembered_source(about, '', 'parameter mr')
    assert remembered_source(about, 'there.nii', '--mr').path == 'there.nii'


def test_tools_refuse_in_the_same_words(case, tmp_path):
    data, affine = ball()
    path = write(tmp_path / 'mr.nii', data, affine, sform=4)
    said = []
    for tool, words in (('register_mr', [case, FIRST, path]), ('case_report', [case, '--mr', path, '--no-pdf'])):
        run = subprocess.run([sys.executable, os.path.join(HERE, '..', '..', 'scripts', tool), *map(str, words)], capture_output=True,
                             text=True, check=False)
        assert run.returncode == 1 and 'Traceback' not in run.stderr
        said.append(run.stderr.replace(tool, ''))
    assert said[0] == said[1] and '--template-space' in said[0]


@pytest.mark.parametrize('header, source', [({'sform': 4}, {'template_space': True}), ({'sform': 2}, {}), ({'unit': 'unknown'}, {}),
                                            ({'sform': 4, 'qform': 1}, {'form': 'qform'})])
def test_what_is_meant_is_taken(case, tmp_path, header, source):
    volume = admit_mr(MrSource(write(tmp_path / 'mr.nii', *ball(), **header), **source), surfaces_of(case))
    assert np.allclose(volume.spacing, STEP / 1000) and volume.notes


def test_holes_far_from_the_surface_are_noted(case, tmp_path):
    data, affine = ball()
    volume = admit_mr(MrSource(write(tmp_path / 'mr.nii', with_hole(data, (0, 0, 0)), affine)), surfaces_of(case))
    assert any('8 voxels (0.00%) are not numbers' in note for note in volume.notes) and np.isfinite(volume.data).all()


def test_an_mr_that_was_only_found_does_not_stop_the_report(case, tmp_path):
    page, _ = make_report(str(case), MrSource(write(tmp_path / 'pmr.nii', *ball(), sform=4)), mr_may_fail=True)
    assert page.count('sform_code 4 says coordinates of the MNI template') == 2  # among the warnings, and in its section
