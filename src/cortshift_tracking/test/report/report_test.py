"""The case report: complete, self-contained, readable in a browser, printed."""
import os
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser

import cv2
import nibabel
import numpy as np
import pytest

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, '..', 'support'))
import synthetic_case as synthetic  # noqa: E402

TOOL = os.path.join(HERE, '..', '..', 'scripts', 'case_report')


def run(*arguments):
    return subprocess.run([sys.executable, TOOL, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          universal_newlines=True, check=False)


class Page(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.images, self.headings, self.links, self._open = [], [], [], None
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        if tag == 'img':
            self.images.append(attributes)
        self.links += [attributes[k] for k in ('href', 'src') if k in attributes and tag != 'img']
        self._open = tag

    def handle_data(self, data):
        if self._open in ('h1', 'h2', 'h3') and data.strip():
            self.headings.append(data.strip())


@pytest.fixture(scope='module')
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp('case')
    synthetic.write_case(str(folder))
    # An MR in which the first surface is the border between bright and dark.
    size, step = 90, 1.8
    low = synthetic.T_PMR_PATCH[:3, 3] * 1000 - size * step / 2
    grid = np.stack(np.meshgrid(*[np.arange(size) * step] * 3, indexing='ij'), -1) + low
    patch = (grid / 1000 - synthetic.T_PMR_PATCH[:3, 3]) @ synthetic.T_PMR_PATCH[:3, :3]
    inside = np.linalg.norm(patch - [0, 0, -0.075], axis=-1) < 0.075
    affine = np.diag([step, step, step, 1.0])
    affine[:3, 3] = low
    image = nibabel.Nifti1Image((100 * inside).astype(np.float32), affine)
    image.header.set_xyzt_units('mm')
    nibabel.save(image, folder / 'pmr.nii')
    (folder / 'left.yaml').write_text('image_width: 1024\ncalibration:\n  date: 2026-03-01\n  rms_px: 0.21\n')
    done = run(folder)
    assert done.returncode == 0, done.stdout
    return folder


def test_everything_is_in_one_small_file(case):
    text = (case / 'report.html').read_text()
    page = Page(text)
    assert os.path.getsize(case / 'report.html') < 20e6
    assert not page.links and 'http' not in re.sub(r'base64,[^"]*', '', text)  # nothing is loaded from elsewhere
    assert all(image['src'].startswith('data:image/png;base64,') and image['alt'] for image in page.images)
    assert len(page.images) == 2 + 3 * 4  # timeline, MR; per pair overlay, maps, vectors, trust
    for wanted in ('Calibration', 'Stages', 'Displacement between stages (Table 3 of the paper)',
                   'Probe against surface and field (Table 2 of the paper)', 'Surfaces in the preoperative MR',
                   'dural_opening \u2192 after_resection'):
        assert wanted in page.headings
    assert 'rms_px 0.21' in text and '2026-03-01' in text and 'cortshift 0.1.0' in text
    assert (case / 'table_2.csv').read_text().count('\n') == 4 and (case / 'table_3.csv').read_text().count('\n') == 4


def test_warnings_name_the_border_that_moves(case):
    text = (case / 'report.html').read_text()
    assert re.search(r'dural_opening \u2192 after_resection: the border of the field.*moves by 1\.[0-9]+ mm', text)


def test_browser_shows_every_picture_at_1280_pixels(case, tmp_path):
    picture = tmp_path / 'page.png'
    subprocess.run(['chromium', '--headless', '--no-sandbox', '--disable-gpu', f'--user-data-dir={tmp_path / "profile"}',
                    '--window-size=1280,12000', '--hide-scrollbars', f'--screenshot={picture}', f'file://{case}/report.html'],
                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
    shown = cv2.imread(str(picture))
    assert shown.shape[1] == 1280
    dom = tmp_path / 'probe.html'
    script = ('<script>addEventListener("load",()=>{document.title=[...document.images].map(i=>i.complete&&i.naturalWidth>0?'
              'Math.round(i.getBoundingClientRect().width)+"/"+Math.round(i.getBoundingClientRect().right):"missing").join(" ")})'
              '</script>')
    dom.write_text((case / 'report.html').read_text().replace('</body>', script + '</body>'))
    out = subprocess.run(['chromium', '--headless', '--no-sandbox', '--disable-gpu', f'--user-data-dir={tmp_path / "profile"}',
                          '--window-size=1280,900', '--dump-dom', f'file://{dom}'], stdout=subprocess.PIPE,
                         stderr=subprocess.DEVNULL, universal_newlines=True, check=True).stdout
    title = re.search(r'<title>(.*?)</title>', out).group(1).split()
    assert len(title) == 14 and 'missing' not in title
    for entry in title:
        width, right = map(int, entry.split('/'))
        assert width >= 1000 and right <= 1280  # large enough to read, nothing beside the page


def test_pdf_is_printed(case):
    told = subprocess.run(['pdfinfo', str(case / 'report.pdf')], stdout=subprocess.PIPE, universal_newlines=True, check=True).stdout
    assert int(re.search(r'Pages:\s+(\d+)', told).group(1)) >= 4 and 'A4' in told
    text = subprocess.run(['pdftotext', str(case / 'report.pdf'), '-'], stdout=subprocess.PIPE, universal_newlines=True,
                          check=True).stdout
    assert 'Table 3 of the paper' in text and 'after_resection' in text


def test_damage_and_misuse_are_refused(case, tmp_path):
    assert run().returncode == 2 and run('--help').returncode == 0
    nothing = run(tmp_path / 'nowhere')
    assert nothing.returncode == 1 and 'no such folder' in nothing.stdout
    broken = tmp_path / 'broken.nii'
    broken.write_bytes((case / 'pmr.nii').read_bytes()[:200])
    refused = run(case, '--mr', broken, '--no-pdf')
    assert refused.returncode == 1 and 'broken.nii' in refused.stdout and 'Traceback' not in refused.stdout
    only = tmp_path / 'only'
    only.mkdir()
    shutil.copy(next(case.glob('0001_*.bag')), only)
    assert run(only, '--no-pdf').returncode == 0
    assert 'No displacement field was computed' in (only / 'report.html').read_text()
