"""Labelled structures in the left camera's image: the outline of each as it was in the MR and as it is now."""
import cv2
import numpy as np

from cortshift_tracking.model.brain import ModelError

WAS, NOW = (60, 60, 255), (60, 220, 60)              # blue green red; earlier and later, as in the overlays of stages
NOT_SHOWN = ('ventricles', 'falx', 'tentorium')      # of the model's materials, what is everywhere below the craniotomy
BITS = 4                                             # of fractions of a pixel, for OpenCV
MARGIN = 4                                           # px around the image, so that outlines are not closed along its border


def camera_of(stage, correction=None):
    """(3, 4) matrix from points in pmr [m] to pixels of the stage's rectified left image.

    correction: of the field that ends at the stage, T_said_now (4, 4): where tracking had a point from where it is; or None.
    Raises ModelError.
    """
    info = stage.left_info
    if stage.T_pmr_left is None or info is None:
        raise ModelError(f'stage "{stage.key}" holds no pose or calibration of the left camera')
    if (info.height, info.width) != stage.colour.shape[:2]:
        raise ModelError(f'stage "{stage.key}": its picture of {stage.colour.shape[1]} x {stage.colour.shape[0]} pixels is not that of its '
                         f'calibration, {info.width} x {info.height}')
    T_pmr_left = stage.T_pmr_left if correction is None else np.linalg.inv(correction) @ stage.T_pmr_left
    T_rectified_left = np.eye(4)
    T_rectified_left[:3, :3] = np.reshape(info.R, (3, 3))
    return np.reshape(info.P, (3, 4)) @ T_rectified_left @ np.linalg.inv(T_pmr_left)


def outlines(points, quads, camera, size):
    """Closed outlines, each (N, 2) [px], of a surface as the camera sees it through the tissue. size: rows, columns of the image."""
    seen = points @ camera[:, :3].T + camera[:, 3]
    if not (seen[:, 2] > 0).all():
        raise ModelError('a labelled structure lies behind the camera; check the patient registration')
    pixels = seen[:, :2] / seen[:, 2:] + MARGIN
    filled = np.zeros(np.array(size) + 2 * MARGIN, np.uint8)
    corners = np.round(np.clip(pixels, -10000, 10000) * 2 ** BITS).astype(np.int32)
    for quad in quads:
        for triangle in (quad[:3], quad[[0, 2, 3]]):
            cv2.fillConvexPoly(filled, corners[triangle], 255, cv2.LINE_8, BITS)
    return [found.reshape(-1, 2) - MARGIN for found in cv2.findContours(filled, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[-2]]


def overlay(structures, stage, correction=None):
    """Picture (H, W, 3) blue green red of the stage with the structures' outlines. Raises ModelError where nothing can be drawn."""
    shown = [structure for structure in structures if structure.name not in NOT_SHOWN]
    if not shown:
        raise ModelError('the model follows no structure; give prepare_model --label tumour=VOLUME')
    camera = camera_of(stage, correction)
    picture = np.ascontiguousarray(stage.colour[..., ::-1])
    for structure in shown:
        whole = structure.whole or (structure.was, structure.quads)
        for points, quads, colour in ((*whole, WAS), (structure.now, structure.quads, NOW)):
            lines = outlines(points, quads, camera, picture.shape[:2])
            cv2.polylines(picture, [line.astype(np.int32) for line in lines], True, (0, 0, 0), 4, cv2.LINE_AA)
            cv2.polylines(picture, [line.astype(np.int32) for line in lines], True, colour, 2, cv2.LINE_AA)
    left = [structure for structure in shown if len(structure.quads)]
    deeper = [(structure.now - structure.was).mean(0) @ camera[2, :3] * 1000 for structure in left]   # along the view nothing is seen of it
    names = ', '.join([f'{structure.name} {depth:+.1f} mm' for structure, depth in zip(left, deeper)]
                      + [f'{structure.name} resected' for structure in shown if not len(structure.quads)])
    _write(picture, [('in the MR', WAS), (' and ', (255, 255, 255)), ('now', NOW), (f'; farther from the camera: {names}', (255, 255, 255))])
    return picture


def _write(picture, words):
    size = picture.shape[1] / 1500
    at = int(20 * size)
    for text, colour in words:
        for ink, width in (((0, 0, 0), 4), (colour, 1)):
            cv2.putText(picture, text, (at, picture.shape[0] - int(24 * size)), cv2.FONT_HERSHEY_SIMPLEX, size, ink, width, cv2.LINE_AA)
        at += cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)[0][0]
