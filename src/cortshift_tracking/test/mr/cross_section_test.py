"""Sections of surfaces and volumes, against geometry that is known."""
import numpy as np
import pytest
from cortshift_tracking.mr.cross_section import SECTION_CONFIDENCE, cut, mr_section, picture_axes, sure_points
from cortshift_tracking.mr.reader import load_volume
from cortshift_tracking.report.slice_figure import draw_slices
from cortshift_tracking.mr.volume import Volume

CH2 = '/usr/share/mricron/templates/ch2.nii.gz'  # Debian's mricron-data
RADIUS = 0.06


def cap(centre=(0.0, 0.0, 0.0), side=0.02, points=200):
    """Top of a sphere, organised."""
    x, y = np.meshgrid(np.linspace(-side, side, points), np.linspace(-side, side, points + 7))
    return np.stack([x, y, np.sqrt(RADIUS ** 2 - x * x - y * y)], -1) + centre


def test_section_of_a_sphere_is_a_circle():
    for axis, at in ((0, 0.0071), (1, -0.0103), (2, 0.0582)):
        segments = cut(cap(), axis, at)
        assert len(segments) > 100
        assert np.abs(segments[..., axis] - at).max() < 1e-12
        other = [n for n in range(3) if n != axis]
        circle = np.linalg.norm(segments[..., other], axis=-1)
        assert np.abs(circle - np.sqrt(RADIUS ** 2 - at ** 2)).max() < 2e-6  # sagitta of a 0.2 mm facet
    length = np.linalg.norm(np.diff(cut(cap(), 2, 0.0582), axis=1), axis=-1).sum()
    assert np.isclose(length, 2 * np.pi * np.sqrt(RADIUS ** 2 - 0.0582 ** 2), rtol=1e-4)  # closed, nothing twice


def test_section_keeps_holes_and_steps_open():
    surface = cap()
    surface[90:110] = np.nan
    assert np.abs(cut(surface, 0, 0.0)[..., 1]).min() > 0.0013
    step = cap()
    step[:, 100:, 2] += 0.004
    assert len(cut(step, 1, 0.0)) < len(cut(cap(), 1, 0.0))
    assert len(cut(cap(), 0, 0.5)) == 0


def test_section_has_a_gap_where_the_surface_is_not_sure():
    confidence = np.ones(cap().shape[:2])
    confidence[90:110] = SECTION_CONFIDENCE - 0.01
    confidence[:5] = np.nan
    assert np.abs(cut(sure_points(cap(), confidence), 0, 0.0)[..., 1]).min() > 0.0013
    assert np.isfinite(sure_points(cap(), np.full(confidence.shape, SECTION_CONFIDENCE))).all()
    assert not len(cut(sure_points(cap(), np.zeros(confidence.shape)), 0, 0.0))


@pytest.mark.parametrize('axes, sign', [('RAS', 1), ('LPS', -1)])
def test_slices_show_a_landmark_in_its_place(axes, sign):
    data = np.zeros((40, 50, 60), np.float32)
    T = np.diag([0.001, 0.001, 0.001, 1.0])
    T[:3, 3] = [-0.02, -0.025, -0.03]
    data[30, 45, 10] = 1  # right, anterior, inferior
    volume = Volume(data, np.diag([sign, sign, 1, 1.0]) @ T, axes)
    landmark = volume.to_pmr([30, 45, 10])
    assert np.allclose(landmark * [sign, sign, 1], [0.010, 0.020, -0.020])
    low, high = volume.corners_pmr()
    for plane, expected in (('axial', 'RLPA'), ('coronal', 'RLIS'), ('sagittal', 'APIS')):
        shown = picture_axes(plane, axes)
        assert ''.join(shown.letters) == expected
        pair = [shown.across, shown.up]
        axis = {'axial': 2, 'coronal': 1, 'sagittal': 0}[plane]
        grey = mr_section(volume, plane, landmark[axis], low[pair], high[pair], 0.001)
        row, column = np.unravel_index(grey.argmax(), grey.shape)
        assert np.isclose(grey.max(), 1, atol=1e-5)
        # As seen: from the left or from the bottom, after the flips.
        seen_x = (grey.shape[1] - 1 - column if shown.flip_across else column) / (grey.shape[1] - 1)
        seen_y = (grey.shape[0] - 1 - row if shown.flip_up else row) / (grey.shape[0] - 1)
        where = {'R': seen_x < 0.5, 'A': (seen_x < 0.5) if plane == 'sagittal' else seen_y > 0.5, 'S': seen_y < 0.5}
        assert all(where[letter] for letter in {'axial': 'RA', 'coronal': 'RS', 'sagittal': 'AS'}[plane])


def test_figure_draws_every_stage_on_a_real_head(tmp_path):
    volume = load_volume(CH2, template_space=True)
    doubtful = np.full(cap().shape[:2], 0.9)
    doubtful[:doubtful.shape[0] // 4] = 0.9 * SECTION_CONFIDENCE
    surfaces = [('first', cap((0.03, 0.02, 0.0)), np.ones(doubtful.shape)), ('second', cap((0.03, 0.02, -0.002)), doubtful)]
    figure = draw_slices(volume, surfaces)
    figure.savefig(tmp_path / 'slices.png')
    panels = figure.axes
    assert len(panels) == 6
    for panel in panels:
        assert len(panel.lines) == 4 and all(np.isfinite(line.get_xdata()).sum() > 40 for line in panel.lines)
        assert len({line.get_color() for line in panel.lines}) == 3  # two stages and their dark outline
    coronal = panels[1].lines[1].get_xydata()  # mm
    first = coronal[np.isfinite(coronal).all(1)]
    assert np.abs(np.hypot(first[:, 0] - 30, first[:, 1]) - 60).max() < 0.01
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ['first (100% drawn)', 'second (75% drawn)']
