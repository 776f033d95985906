"""The border of a label, and its outline in the left camera's image, against a ball whose outline is a formula."""
from types import SimpleNamespace

import numpy as np
import pytest
from cortshift_tracking.model.brain import ModelError
from cortshift_tracking.model.overlay import MARGIN, NOW, WAS, camera_of, outlines, overlay
from cortshift_tracking.model.structures import Structure, border_of_label
from cortshift_tracking.mr.volume import Volume
from scipy.spatial.transform import Rotation

RADIUS, STEP = 0.010, 0.0008        # of the ball, of its voxels [m]
MIDDLE = np.array([0.031, 0.022, 0.045])
SHIFT = np.array([-0.0021, 0.0012, -0.0034])
SIZE = (768, 1024)


def ball(turn, mirrored):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ np.diag([-STEP if mirrored else STEP, STEP, STEP])
    T[:3, 3] = MIDDLE - T[:3, :3] @ [16.3, 15.8, 16.1]
    index = np.stack(np.meshgrid(*[np.arange(33)] * 3, indexing='ij'), -1)
    inside = np.linalg.norm(index @ T[:3, :3].T + T[:3, 3] - MIDDLE, axis=-1) < RADIUS
    return Volume(inside.astype(np.float32), T, 'RAS', 'ball')


@pytest.fixture
def stage():
    """A camera 0.3 m above the ball that looks past it a little, its rectified image turned by 2.4 degrees."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler('xyz', [2.6, 0.3, -0.4]).as_matrix()
    T[:3, 3] = MIDDLE - T[:3, :3] @ [0.004, -0.006, 0.30]
    turn = Rotation.from_euler('xyz', [0.003, 0.042, -0.001]).as_matrix()
    info = SimpleNamespace(R=turn.ravel(), P=[3847.7, 0, 357.2, 0, 0, 3847.7, 383.0, 0, 0, 0, 1, 0], height=SIZE[0], width=SIZE[1])
    return SimpleNamespace(key='after', T_pmr_left=T, left_info=info, colour=np.full((*SIZE, 3), 90, np.uint8))


def true_outline(middle, stage, T_pmr_left=None):
    """Pixels (N, 2): where rays touch the ball, by geometry and not by the projection that is tested."""
    T_left_pmr = np.linalg.inv(stage.T_pmr_left if T_pmr_left is None else T_pmr_left)
    centre = np.reshape(stage.left_info.R, (3, 3)) @ (T_left_pmr[:3, :3] @ middle + T_left_pmr[:3, 3])
    away = np.linalg.norm(centre)
    axis = centre / away
    across = np.cross(axis, [0, 0, 1.0])
    across /= np.linalg.norm(across)
    angle = np.linspace(0, 2 * np.pi, 720)[:, None]
    ring = np.cos(angle) * across + np.sin(angle) * np.cross(axis, across)
    touch = centre * (1 - (RADIUS / away) ** 2) + RADIUS * np.sqrt(1 - (RADIUS / away) ** 2) * ring
    fx, _, cx, _, _, fy, cy = stage.left_info.P[:7]
    return np.stack([fx * touch[:, 0] / touch[:, 2] + cx, fy * touch[:, 1] / touch[:, 2] + cy], -1)


def distances(line, truth):
    return np.linalg.norm(line[:, None] - truth[None], axis=-1).min(1)


@pytest.mark.parametrize('turn, mirrored', [((0, 0, 0), True), ((0.2, -0.3, 0.4), False), ((0.2, -0.3, 0.4), True)])
def test_the_border_is_closed_lies_on_the_ball_and_looks_outwards(turn, mirrored):
    vertices, quads = border_of_label(ball(turn, mirrored))
    away = np.linalg.norm(vertices - MIDDLE, axis=1)
    assert abs(away.mean() - RADIUS) < 0.1 * STEP and np.abs(away - RADIUS).max() < 0.5 * STEP
    corners = vertices[quads]
    area = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]) / 2
    assert (np.einsum('qj,qj->q', area, corners.mean(1) - MIDDLE) > 0).mean() > 0.99
    assert np.abs(area.sum(0)).max() < 1e-9   # closed
    volume = np.einsum('qj,qj->', area, corners.mean(1) - MIDDLE) / 3
    assert volume == pytest.approx(4 / 3 * np.pi * RADIUS ** 3, rel=0.03)


def test_a_thin_vessel_and_nothing_at_all():
    data = np.zeros((5, 20, 5), np.float32)
    data[2, :, 2] = 1
    vertices, quads = border_of_label(Volume(data, np.diag([0.001, 0.001, 0.001, 1])))
    assert np.ptp(vertices, axis=0)[1] == pytest.approx(0.020, abs=0.0011) and len(quads) == 4 * 20 + 2
    assert len(border_of_label(Volume(0 * data, np.diag([0.001, 0.001, 0.001, 1])))[1]) == 0


def test_outlines_are_where_rays_touch_the_ball(stage):
    vertices, quads = border_of_label(ball((0.2, -0.3, 0.4), True))
    camera = camera_of(stage)
    for shift in (np.zeros(3), SHIFT):
        line, = outlines(vertices + shift, quads, camera, SIZE)
        truth = true_outline(MIDDLE + shift, stage)
        error, missed = distances(line, truth), distances(truth, line)
        print(f'outline: mean {error.mean():.2f} px, largest {error.max():.2f} px; a voxel has {STEP * 3847.7 / 0.3:.0f} px')
        assert error.mean() < 1.2 and error.max() < 4 and missed.max() < 4
        assert np.abs(line.mean(0) - truth.mean(0)).max() < 1.0


def test_the_picture_shows_both_in_their_colours(stage):
    vertices, quads = border_of_label(ball((0, 0, 0), True))
    shown = overlay([Structure('tumour', vertices, vertices + SHIFT, np.full(len(vertices), 0.001), quads)], stage)
    for middle, colour in ((MIDDLE, WAS), (MIDDLE + SHIFT, NOW)):
        rows, columns = np.nonzero((shown[:700].astype(int) == colour).all(-1))
        found, truth = np.stack([columns, rows], -1), true_outline(middle, stage)
        assert len(found) > 300 and np.percentile(distances(found, truth), 95) < 3
        covered = distances(truth, found) < 6
        assert covered.mean() > (0.9 if colour == NOW else 0.75)   # the later one is drawn over the earlier one


def test_what_was_resected_is_drawn_as_it_was_alone(stage):
    vertices, quads = border_of_label(ball((0, 0, 0), True))
    nothing = np.zeros((0, 3))
    shown = overlay([Structure('tumour', nothing, nothing, np.zeros(0), np.zeros((0, 4), int), (vertices, quads))], stage)[:700]
    assert (shown == WAS).all(-1).sum() > 300 and not (shown == NOW).all(-1).any()


def test_an_error_of_tracking_that_was_taken_out_moves_the_camera(stage):
    """A point that the field has at its true place is in the picture where the camera, tracked wrongly, saw it."""
    true_pose = stage.T_pmr_left
    said_now = np.eye(4)
    said_now[:3, :3], said_now[:3, 3] = Rotation.from_rotvec([0.01, -0.004, 0.006]).as_matrix(), [0.001, -0.0008, 0.0005]
    stage.T_pmr_left = said_now @ true_pose
    vertices, quads = border_of_label(ball((0, 0, 0), True))
    line, = outlines(vertices, quads, camera_of(stage, said_now), SIZE)
    assert distances(line, true_outline(MIDDLE, stage, true_pose)).mean() < 1.5
    line, = outlines(vertices, quads, camera_of(stage), SIZE)
    assert distances(line, true_outline(MIDDLE, stage, true_pose)).mean() > 5


def test_what_is_partly_outside_is_not_closed_along_the_border(stage):
    vertices, quads = border_of_label(ball((0, 0, 0), True))
    stage.left_info.P[2] -= 560   # half of it leaves to the left
    line, = outlines(vertices, quads, camera_of(stage), SIZE)
    inside = line[(line[:, 0] >= 0)]
    assert line[:, 0].min() == -MARGIN and 100 < len(inside) and distances(inside, true_outline(MIDDLE, stage)).max() < 5


@pytest.mark.parametrize('change, why', [
    ({'T_pmr_left': None}, 'stage "after" holds no pose or calibration of the left camera'),
    ({'left_info': None}, 'stage "after" holds no pose or calibration of the left camera'),
    ({'colour': np.zeros((100, 200, 3), np.uint8)}, 'its picture of 200 x 100 pixels is not that of its calibration, 1024 x 768')])
def test_a_stage_that_cannot_be_drawn_on_is_refused(stage, change, why):
    stage.__dict__.update(change)
    structure = Structure('tumour', np.zeros((4, 3)), np.zeros((4, 3)), np.zeros(4), np.arange(4)[None])
    with pytest.raises(ModelError, match=why):
        overlay([structure], stage)


def test_nothing_to_draw_and_behind_the_camera(stage):
    vertices, quads = border_of_label(ball((0, 0, 0), True))
    with pytest.raises(ModelError, match='follows no structure; give prepare_model --label tumour=VOLUME'):
        overlay([Structure('falx', vertices, vertices, np.zeros(len(vertices)), quads)], stage)
    behind = vertices + 0.5 * (stage.T_pmr_left[:3, 3] - MIDDLE) / 0.15
    with pytest.raises(ModelError, match='behind the camera; check the patient registration'):
        overlay([Structure('tumour', vertices, behind, np.zeros(len(vertices)), quads)], stage)
