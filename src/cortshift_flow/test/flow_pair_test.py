"""flow_pair as a user runs it: files in, files out, exit codes."""
import os
import struct
import subprocess

import cv2
import numpy as np
import pytest

FLOW_PAIR = os.environ["FLOW_PAIR"]


def run(*words):
    return subprocess.run([FLOW_PAIR, *map(str, words)], capture_output=True, text=True, check=False)


def read_flo(path):
    data = path.read_bytes()
    magic, width, height = struct.unpack("<4sii", data[:12])
    assert magic == b"PIEH"
    return np.frombuffer(data[12:], "<f4").reshape(height, width, 2)


@pytest.fixture
def pair(tmp_path):
    """A random smooth texture and itself moved by (3, -2) px."""
    random = np.random.default_rng(4)
    texture = cv2.GaussianBlur(random.uniform(0, 255, (160, 200, 3)), (0, 0), 1.5)
    texture = np.clip(128 + 4 * (texture - texture.mean()), 0, 255).astype(np.uint8)
    first, second = tmp_path / "first.png", tmp_path / "second.png"
    cv2.imwrite(str(first), texture[20:140, 20:180])
    cv2.imwrite(str(second), texture[22:142, 17:177])
    return first, second


def test_writes_flow_and_confidence_and_prints_the_time(pair, tmp_path):
    out, confidence = tmp_path / "out.flo", tmp_path / "confidence.png"
    done = run(*pair, out, "--confidence", confidence, "--threads", 1)
    assert done.returncode == 0, done.stderr
    name, seconds = done.stdout.strip().split(": ")
    assert name == "flow_seconds" and float(seconds) > 0
    flow = read_flo(out)
    assert flow.shape == (120, 160, 2)
    inner = flow[20:-20, 20:-20]
    assert np.abs(np.median(inner[..., 0]) - 3) < 0.02
    assert np.abs(np.median(inner[..., 1]) + 2) < 0.02
    assert cv2.imread(str(confidence), cv2.IMREAD_UNCHANGED).shape == (120, 160)


def test_threads_do_not_change_the_file(pair, tmp_path):
    for threads in (1, 2):
        assert run(*pair, tmp_path / f"{threads}.flo", "--threads", threads).returncode == 0
    assert (tmp_path / "1.flo").read_bytes() == (tmp_path / "2.flo").read_bytes()


def test_mask_has_no_confidence(pair, tmp_path):
    mask = np.full((120, 160), 255, np.uint8)
    mask[40:60, 50:90] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    confidence = tmp_path / "confidence.png"
    done = run(*pair, tmp_path / "out.flo", "--mask", tmp_path / "mask.png", "--confidence", confidence)
    assert done.returncode == 0, done.stderr
    assert not cv2.imread(str(confidence), 0)[mask == 0].any()


def test_settings_are_read_and_refused(pair, tmp_path):
    settings = tmp_path / "settings.yaml"
    settings.write_text("preset: fast\n")
    assert run(*pair, tmp_path / "out.flo", "--settings", settings).returncode == 0
    settings.write_text("presett: fast\n")
    done = run(*pair, tmp_path / "out.flo", "--settings", settings)
    assert done.returncode == 1 and "presett" in done.stderr


def test_exit_codes(pair, tmp_path):
    assert run("--help").returncode == 0
    assert run().returncode == 2
    assert run(*pair).returncode == 2
    assert run(*pair, tmp_path / "o.flo", "--wrong").returncode == 2
    assert run(*pair, tmp_path / "o.flo", "--threads", "many").returncode == 2
    missing = run(tmp_path / "missing.png", pair[1], tmp_path / "o.flo")
    assert missing.returncode == 1 and "missing.png" in missing.stderr
    assert run(*pair, tmp_path / "no folder" / "o.flo").returncode == 1
