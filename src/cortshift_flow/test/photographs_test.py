"""Photographs with known motion: no worse than the best of OpenCV's dense flows, in the median and in the mean."""
import pathlib
import subprocess
import sys

import cv2
import numpy as np
import pytest

from flow_pair_test import FLOW_PAIR, read_flo

PHOTOGRAPHS = pathlib.Path(__file__).parents[1] / "benchmark" / "photographs.py"


@pytest.fixture(scope="module", name="pairs")
def fixture_pairs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photographs")
    told = subprocess.run([sys.executable, PHOTOGRAPHS, folder], capture_output=True, text=True, check=True)
    assert not told.stderr, "the photographs come with opencv-doc and python3-skimage: " + told.stderr
    return {name: files.split(",") for name, files in (line.split("=") for line in told.stdout.split())}


def grey(path):
    return cv2.imread(path, cv2.IMREAD_GRAYSCALE)


def finest_dis():
    dis = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    dis.setFinestScale(0)
    dis.setVariationalRefinementIterations(50)
    dis.setVariationalRefinementAlpha(80)
    return dis


@pytest.mark.parametrize("name", ["aloe", "motorcycle"])
def test_no_worse_than_the_best_peer(pairs, name, tmp_path):
    first, second, truth_file = pairs[name]
    truth = read_flo(pathlib.Path(truth_file))
    known = np.abs(truth[..., 0]) < 1e9

    def median_and_mean(flow):
        error = np.hypot(*np.moveaxis(flow - truth, 2, 0))[known]
        return np.array([np.median(error), error.mean()])

    out = tmp_path / "out.flo"
    done = subprocess.run([FLOW_PAIR, first, second, out], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    peers = [cv2.optflow.createOptFlow_DeepFlow(), finest_dis()]
    best = np.min([median_and_mean(peer.calc(grey(first), grey(second), None)) for peer in peers], axis=0)
    assert (median_and_mean(read_flo(out)) <= best).all(), (median_and_mean(read_flo(out)), best)
