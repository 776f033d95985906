"""The report of a case whose MR was brought up to date."""
import json
import re

import cv2
import nibabel
import numpy as np
import pytest
import synthetic_case as synthetic
from cortshift_tracking.case.folder import read_case
from cortshift_tracking.mr.admission import MrSource
from cortshift_tracking.mr.reader import load_volume
from cortshift_tracking.report import updated_mr
from cortshift_tracking.report.case_report import make_report

SIZE, STEP = 60, 2.7   # of the MR: voxels a side, mm
SUMMARY = {'from_key': 'dural_opening', 'to_key': 'after_resection', 'residual_at_surface_mm': 0.12, 'largest_displacement_mm': 7.5,
           'labels': {'tumour': {'value': 1, 'centre_shift_mm': 4.2, 'centre_sd_mm': 0.6, 'border_shift_mm': 4.4, 'border_sd_mm': None}},
           'warnings': ['gravity is <not> known']}
TUMOUR = synthetic.T_PMR_PATCH[:3, 3] - 0.02 * synthetic.T_PMR_PATCH[:3, 2]   # where it is now
UPDATE = 'brain_model/dural_opening__after_resection'


def save(path, data, low, step=STEP):
    affine = np.diag([step, step, step, 1.0])
    affine[:3, 3] = low
    image = nibabel.Nifti1Image(data.astype(np.float32), affine)
    image.header.set_xyzt_units('mm')
    nibabel.save(image, path)


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    """The case and the corner of its MR [mm]; of the update the brightness is known."""
    folder = tmp_path_factory.mktemp('case')
    synthetic.write_case(str(folder))
    low = synthetic.T_PMR_PATCH[:3, 3] * 1000 - SIZE * STEP / 2
    grid = np.stack(np.meshgrid(*[np.arange(SIZE) * STEP] * 3, indexing='ij'), -1) + low
    patch = (grid / 1000 - synthetic.T_PMR_PATCH[:3, 3]) @ synthetic.T_PMR_PATCH[:3, :3]
    inside = np.linalg.norm(patch - [0, 0, -0.075], axis=-1) < 0.075
    save(folder / 'pmr.nii', 100 * inside, low)
    update = folder / UPDATE
    update.mkdir(parents=True)
    (update / 'summary.json').write_text(json.dumps(SUMMARY))
    save(update / 'updated_mr.nii.gz', 100 * np.roll(inside, -2, axis=2), low)
    save(update / 'labels_now.nii.gz', 1.0 * (np.linalg.norm(grid / 1000 - TUMOUR, axis=-1) < 0.008), low)
    return folder, low


@pytest.fixture(scope='module')
def known(made):
    """The case as it was read, and its MR."""
    folder, _ = made
    return read_case(str(folder)), load_volume(str(folder / 'pmr.nii'))


def shown(folder, known):
    """HTML of the updates in the folder, and what was left out."""
    left_out = []
    sections = [updated_mr.section(update, *known, left_out) for update in updated_mr.read_updates(str(folder), left_out)]
    return '\n'.join(sections), left_out


def test_it_is_in_the_report(made, known):
    page, _ = make_report(str(made[0]), MrSource(str(made[0] / 'pmr.nii')))
    assert 'The MR brought up to date: dural_opening \u2192 after_resection' in page
    assert page.count('alt="MR before and after dural_opening \u2192 after_resection"') == 1


def test_it_is_found_where_the_case_lies_in_the_folder(made, tmp_path):
    (tmp_path / 'case').symlink_to(made[0])
    left_out = []
    update, = updated_mr.read_updates(str(tmp_path), left_out)
    assert update.summary == SUMMARY and not left_out


def test_table_and_warnings(made, known):
    page, left_out = shown(made[0], known)
    assert re.search('<td>tumour</td><td class=n>4.20 \u00b1 0.60</td><td class=n>4.40</td>', page), page[:800]
    assert 'Largest displacement 7.5 mm' in page and '0.12 mm (root mean square)' in page
    assert 'gravity is &lt;not&gt; known' in page and not left_out


def test_what_was_taken_out_of_a_structure_is_said(tmp_path, known):
    labels = {'tumour': {'value': 1, 'centre_shift_mm': None, 'centre_sd_mm': None, 'border_shift_mm': None, 'border_sd_mm': None, 'resected': 1.0},
              'vessel': {**SUMMARY['labels']['tumour'], 'resected': 0.25}}
    (tmp_path / UPDATE).mkdir(parents=True)
    (tmp_path / UPDATE / 'summary.json').write_text(json.dumps({**SUMMARY, 'labels': labels}))
    page, _ = shown(tmp_path, known)
    assert '<td>tumour (resected)</td>' in page and '<td>vessel (25% resected)</td>' in page, page[:800]


def test_the_difference_is_where_the_brain_has_sunk(made, known, monkeypatch):
    seen = []
    monkeypatch.setattr(updated_mr, 'picture', lambda figure, *texts: seen.append(figure) or '')
    shown(made[0], known)
    figure, = seen
    for row in range(3):
        before, now, difference = (panel.images[0].get_array() for panel in figure.axes[3 * row:3 * row + 3])
        np.testing.assert_allclose(difference, now - before, atol=1e-6)
        assert difference.min() < -50 and abs(before).max() == pytest.approx(100, abs=1)
        # The tumour's outline, in the plane through it.
        outline = np.concatenate([line for collection in figure.axes[3 * row + 1].collections for path in collection.get_paths()
                                  for line in [path.vertices]])
        away = np.linalg.norm(outline / 1000 - outline.mean(0) / 1000, axis=1)
        assert len(outline) > 20 and 0.0065 < away.min() and away.max() < 0.0095


def test_the_outlines_are_shown_and_a_damaged_picture_is_named(known, tmp_path):
    (tmp_path / UPDATE).mkdir(parents=True)
    (tmp_path / UPDATE / 'summary.json').write_text(json.dumps(SUMMARY))
    overlay = tmp_path / UPDATE / 'overlay.png'
    for content, there in ((cv2.imencode('.png', np.full((9, 9, 3), 80, np.uint8))[1].tobytes(), True), (b'', False), (b'no picture', False)):
        overlay.write_bytes(content)
        page, left_out = shown(tmp_path, known)
        assert ('alt="outlines at after_resection"' in page) == there
        assert (f'{overlay}: is damaged; run update_mr again' in left_out) == (not there)


@pytest.mark.parametrize('content, why', [('{', 'is damaged or cannot be read; run update_mr again'),
                                          ('[1]', 'is not what update_mr writes; run it again'),
                                          ('{"labels": {}}', 'is not what update_mr writes; run it again')])
def test_what_is_no_update_is_named(tmp_path, known, content, why):
    (tmp_path / UPDATE).mkdir(parents=True)
    (tmp_path / UPDATE / 'summary.json').write_text(content)
    assert shown(tmp_path, known) == ('', [f'{UPDATE}/summary.json: {why}'])


def test_an_update_of_another_mr_shows_no_pictures(made, known, tmp_path):
    (tmp_path / UPDATE).mkdir(parents=True)
    (tmp_path / UPDATE / 'summary.json').write_text(json.dumps(SUMMARY))
    page, left_out = shown(tmp_path, known)
    assert 'tumour' in page and '<img' not in page and 'updated_mr.nii.gz: no such file' in left_out[0]
    save(tmp_path / UPDATE / 'updated_mr.nii.gz', np.zeros((SIZE, SIZE, SIZE)), made[1] + 5)
    page, left_out = shown(tmp_path, known)
    assert 'tumour' in page and '<img' not in page
    assert left_out == [f'{tmp_path}/{UPDATE}/updated_mr.nii.gz: lies on another grid than the MR of this report; give that MR with --mr']
