"""script/demo as a user runs it, but into a folder of its own: its numbers, its picture in rviz, its report."""
import csv
import json
import pathlib
import subprocess

import cv2
import nibabel
import numpy as np
import pytest
import yaml
from scipy import ndimage

ROOT = pathlib.Path(__file__).resolve().parents[4]
STAGES = ('dural_opening', 'early_resection', 'after_resection')


def demo(*arguments):
    return subprocess.run([str(ROOT / 'script/demo'), *map(str, arguments)], capture_output=True, text=True, check=False)


@pytest.fixture(scope='module')
def shown(tmp_path_factory):
    """What the demo prints and the folder that it leaves."""
    folder = tmp_path_factory.mktemp('demo') / 'out'
    done = demo('--built', folder)
    assert done.returncode == 0, done.stdout + done.stderr
    print(done.stdout)
    return done.stdout, folder


def test_its_numbers_are_those_of_the_readme(shown):
    printed, folder = shown
    with open(folder / 'summary.csv', newline='', encoding='utf-8') as file:
        rows = {row['pair']: row for row in csv.DictReader(file)}
    assert list(rows) == [f'{STAGES[a]} -> {STAGES[b]}' for a, b in ((0, 1), (1, 2), (0, 2))]
    for pair, row in rows.items():
        # The README: a median error of 0.02 mm and a 95th percentile of 0.08 mm over 98 % of the craniotomy.
        assert float(row['error_median_mm']) < 0.03 and float(row['error_p95_mm']) < 0.12 and float(row['coverage']) > 0.96
        assert pair in printed and f"{float(row['error_median_mm']):.3f}" in printed
    whole = rows[f'{STAGES[0]} -> {STAGES[2]}']
    assert float(whole['normal_mean_mm']) < 0 < float(whole['gravity_mean_mm'])   # it sinks


def test_rviz_shows_the_surface_and_the_arrows(shown):
    picture = cv2.imread(str(shown[1] / 'rviz.png')).astype(int)
    blue, green, red = np.moveaxis(picture, 2, 0)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 5000
    assert ((red > green + 40) & (red > blue + 40)).mean() > 0.04      # brain
    assert ((blue > red + 60) & (blue > green + 20)).mean() > 0.01     # drape
    assert ((green > red + 30) & (green > blue + 30)).mean() > 0.0003  # only arrows of middling length are green


def test_every_pair_has_its_pictures_and_the_report_holds_them(shown):
    _, folder = shown
    for pair in ((0, 1), (1, 2), (0, 2)):
        for name in ('before', 'after', 'magnitude'):
            assert cv2.imread(str(folder / f'{STAGES[pair[0]]}__{STAGES[pair[1]]}_{name}.png')).std() > 10
    page = (folder / 'report.html').read_text(encoding='utf-8')
    assert 'the built-in phantom' in page and f'pmr \u2192 {STAGES[0]}' in page
    # Timeline, MR, the MR brought up to date and its outlines; per pair overlays, maps, vectors, trust.
    assert page.count('<img src="data:image/png;base64,') == 4 + 4 * 4
    told = subprocess.run(['pdfinfo', str(folder / 'report.pdf')], capture_output=True, text=True, check=True).stdout
    assert 'the built-in phantom' in told or int(told.split('Pages:')[1].split()[0]) >= 3


def test_the_mr_is_brought_up_to_date(shown):
    printed, folder = shown
    update = folder / f'case/brain_model/pmr__{STAGES[2]}'
    summary = json.loads((update / 'summary.json').read_text())
    told = summary['labels']['tumour']
    assert f"tumour: its centre has moved by {told['centre_shift_mm']:.1f} mm" in printed
    before, tumour, now, labels = (nibabel.load(str(path)) for path in (folder / 'pmr.nii', folder / 'tumour.nii', update / 'updated_mr.nii.gz',
                                                                        update / 'labels_now.nii.gz'))
    assert np.allclose(before.affine, now.affine, atol=1e-3) and np.allclose(before.affine, labels.affine, atol=1e-3)
    was, is_now = (np.argwhere(np.asarray(image.dataobj) > 0.5) @ before.affine[:3, :3].T for image in (tumour, labels))
    moved = is_now.mean(0) - was.mean(0)
    assert np.linalg.norm(moved) == pytest.approx(told['centre_shift_mm'], abs=0.3)
    with open(ROOT / 'config/phantom/phantom_case.yaml', encoding='utf-8') as file:
        gravity = np.array(yaml.safe_load(file)['gravity_in_pmr'])
    assert 1 < moved @ gravity / np.linalg.norm(gravity) < 7   # it sinks, less than the surface above it
    # What is dark in the updated MR below the cortex is the tumour where it is now.
    inner = ndimage.binary_erosion(np.asarray(labels.dataobj) > 0.5, iterations=5)
    assert np.median(np.asarray(now.dataobj)[inner]) < 70 and len(was) > 0.9 * len(is_now) > 0.8 * len(was)
    overlay = cv2.imread(str(update / 'overlay.png'))
    green, red = (np.argwhere((overlay[:700] == colour).all(-1)) for colour in ((60, 220, 60), (60, 60, 255)))
    # A ball of 20 mm, 0.32 m away, at 3850 px of focal length: 240 px across. It sank along the view: red is partly below green.
    assert ((220 < np.ptp(green, axis=0)) & (np.ptp(green, axis=0) < 260)).all() and len(red) > 100
    page = (folder / 'report.html').read_text(encoding='utf-8')
    assert f'alt="outlines at {STAGES[2]}"' in page
    assert f'The MR brought up to date: pmr \u2192 {STAGES[2]}' in page and f'alt="MR before and after pmr \u2192 {STAGES[2]}"' in page
    assert f"<td>tumour</td><td class=n>{told['centre_shift_mm']:.2f}" in page


def test_arguments(tmp_path):
    assert '--built' in demo('--help').stdout
    assert demo('--nothing').returncode == 2 and demo(tmp_path / 'a', tmp_path / 'b').returncode == 2
    there = demo('--built', tmp_path)
    assert there.returncode == 1 and 'exists already' in there.stderr
