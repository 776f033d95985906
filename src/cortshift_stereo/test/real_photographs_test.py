#!/usr/bin/python3
"""reconstruct_pair on real photographs with known truth, beside OpenCV's semi-global matching, and its command line."""
import os
import struct
import sys

import cv2
import numpy as np
import pytest
import yaml

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "support"))
from photographs import aloe, between_whole_pixels, figures, motorcycle, run  # noqa: E402


@pytest.mark.parametrize("scene, fine", [(aloe, between_whole_pixels), (motorcycle, lambda truth: truth)])
def test_no_worse_than_semi_global_matching_and_finer(scene, fine, tmp_path):
    scene = scene()
    ours, plain = scene.reconstruct(tmp_path), scene.semi_global()
    judged = scene.judged()
    assert (judged & np.isfinite(ours)).sum() >= 0.85 * judged.sum()
    our_figures, plain_figures = figures([ours, plain], scene, fine(scene.truth))
    print(our_figures, plain_figures)
    assert our_figures["raw_bad2"] <= plain_figures["raw_bad2"]
    assert our_figures["bad2"] <= plain_figures["bad2"]
    assert our_figures["median"] < plain_figures["median"]


def test_the_cloud_holds_the_points_of_the_disparity(tmp_path):
    scene = motorcycle()
    disparity = scene.reconstruct(tmp_path)
    head, body = (tmp_path / "cloud.ply").read_bytes().split(b"end_header\n", 1)
    assert f"element vertex {np.isfinite(disparity).sum()}\n".encode() in head
    points = np.frombuffer(body, np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3), ("confidence", "<f4")]))
    rows, columns = np.nonzero(np.isfinite(disparity))
    z = scene.focal * scene.baseline / (disparity[rows, columns] + scene.cx_difference)
    x = (columns - disparity.shape[1] / 2) / scene.focal * z
    assert np.allclose(points["xyz"][:, 2], z, rtol=1e-5)
    assert np.allclose(points["xyz"][:, 0], x, rtol=1e-5, atol=1e-6)
    assert ((points["confidence"] > 0) & (points["confidence"] <= 1)).all()
    left = cv2.imread(scene.left)[rows, columns, ::-1]
    inside = (rows > 1) & (rows < disparity.shape[0] - 3) & (columns > 1) & (columns < disparity.shape[1] - 3)
    assert np.abs(points["rgb"][inside].astype(int) - left[inside]).max() <= 1


def test_command_line(tmp_path):
    assert run("--help").returncode == 0
    assert "--left-info" in run("--help").stdout
    assert run().returncode == 2
    assert run("left.png", "right.png").returncode == 2
    assert run("left.png", "right.png", "--nonsense", "1").returncode == 2
    scene = motorcycle()
    scene.reconstruct(tmp_path)
    infos = ["--left-info", tmp_path / "left.yaml", "--right-info", tmp_path / "right.yaml", "--output",
             tmp_path / "again.ply"]
    assert run(scene.left, scene.right, *infos, "--threads", "-1").returncode == 2
    missing = run(tmp_path / "none.png", scene.right, *infos)
    assert missing.returncode == 1 and "none.png" in missing.stderr
    blank = tmp_path / "blank.png"
    cv2.imwrite(str(blank), np.full_like(cv2.imread(scene.left), 40))
    refused = run(scene.left, blank, *infos)
    assert refused.returncode == 1 and "right image is blank" in refused.stderr
    assert not (tmp_path / "again.ply").exists()


def test_every_limit_of_the_node_is_an_option(tmp_path):
    config = os.path.join(os.path.dirname(__file__), "../../../config/surface_reconstruction.yaml")
    with open(config) as file:
        node = yaml.safe_load(file)
    text = run("--help").stdout
    limits = [key for key in node if key.startswith(("min_", "max_")) and key != "max_pose_gap"] + ["relief"]
    assert len(limits) == 11
    for key in limits:
        assert f"--{key.replace('_', '-')} X " in text
        assert f"(default {node[key]:g}, allowed" in text.split(f"--{key.replace('_', '-')} X ")[1].split("\n")[0]
    scene = motorcycle()
    scene.reconstruct(tmp_path)
    infos = ["--left-info", tmp_path / "left.yaml", "--right-info", tmp_path / "right.yaml", "--output",
             tmp_path / "again.ply"]
    distances = ["--min-working-distance", 1, "--max-working-distance", 20]
    wrong = run(scene.left, scene.right, *infos, "--min-coverage", 1.5)
    assert wrong.returncode == 2 and "--min-coverage 1.5 is not allowed; allowed is 0 ... 1" in wrong.stderr
    assert run(scene.left, scene.right, *infos, "--min-coverge", 0.5).returncode == 2
    strict = run(scene.left, scene.right, *infos, *distances, "--min-contrast", 128)
    assert strict.returncode == 1 and "image is blank" in strict.stderr
    tall = run(scene.left, scene.right, *infos, *distances, "--min-coverage", 1)
    assert tall.returncode == 1 and "at least 100 % is needed" in tall.stderr


def test_files_of_twelve_bits_give_the_disparity_of_eight(tmp_path):
    scene = motorcycle()
    eight = scene.reconstruct(tmp_path)
    for side in ("left", "right"):
        deep = np.round(cv2.imread(getattr(scene, side)).astype(float) / 255 * 4095).astype(np.uint16)
        path = str(tmp_path / f"{side}.png")
        cv2.imwrite(path, deep)
        setattr(scene, side, path)
    twelve = scene.reconstruct(tmp_path)
    assert np.array_equal(np.isfinite(eight), np.isfinite(twelve))
    assert np.nanmax(np.abs(eight - twelve)) == 0
    refused = run(scene.left, scene.right, "--left-info", tmp_path / "left.yaml", "--right-info", tmp_path / "right.yaml",
                  "--output", tmp_path / "again.ply", "--image-bits", 10)
    assert refused.returncode == 1 and "image_bits is 10, but the largest value" in refused.stderr


def test_a_photograph_that_asks_for_rotation_is_refused(tmp_path):
    scene = motorcycle()
    scene.reconstruct(tmp_path)
    _, jpeg = cv2.imencode(".jpg", cv2.imread(scene.left))
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    (tmp_path / "turned.jpg").write_bytes(
        jpeg.tobytes()[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + jpeg.tobytes()[2:])
    refused = run(tmp_path / "turned.jpg", scene.right, "--left-info", tmp_path / "left.yaml", "--right-info",
                  tmp_path / "right.yaml", "--output", tmp_path / "again.ply")
    assert refused.returncode == 1 and "turned.jpg carries EXIF orientation 6" in refused.stderr
