"""Real photographs with known truth, reconstructed by reconstruct_pair and by OpenCV's semi-global matching.

aloe (Debian: opencv-doc) has its truth in whole pixels; motorcycle (python3-skimage) in fractions, from structured
light. Missing data are an error: they are among the packages that script/install lists.
"""
import os
import subprocess

import cv2
import numpy as np

OPENCV = "/usr/share/doc/opencv-doc/examples/data"
SKIMAGE = "/usr/lib/python3/dist-packages/skimage/data"
BLOCK = 5


def tool():
    return subprocess.run(["catkin_find", "--first-only", "--libexec", "cortshift_stereo", "reconstruct_pair"],
                          check=True, capture_output=True, text=True).stdout.strip()


def run(*arguments):
    return subprocess.run([tool(), *map(str, arguments)], capture_output=True, text=True)


def data(folder, name):
    path = os.path.join(folder, name)
    assert os.path.exists(path), f"{path} is missing; script/install installs it"
    return path


def write_info(path, size, focal, cx, p3):
    """camera_info of an ideal camera; focal and cx in pixels, p3 in pixels times metres."""
    width, height = size
    cy = height / 2
    path.write_text(f"""image_width: {width}
image_height: {height}
camera_name: ideal
camera_matrix: {{rows: 3, cols: 3, data: [{focal}, 0, {cx}, 0, {focal}, {cy}, 0, 0, 1]}}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}}
rectification_matrix: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}
projection_matrix: {{rows: 3, cols: 4, data: [{focal}, 0, {cx}, {p3}, 0, {focal}, {cy}, 0, 0, 0, 1, 0]}}
""")
    return path


class Scene:
    """A photographed pair. truth: disparity of the left image [px], NaN where unknown."""

    def __init__(self, left, right, truth, focal, baseline, cx_difference):
        self.left, self.right, self.truth = left, right, truth
        self.focal, self.baseline, self.cx_difference = focal, baseline, cx_difference  # px, m, px

    def reconstruct(self, folder):
        height, width = self.truth.shape
        arguments = ["--left-info", write_info(folder / "left.yaml", (width, height), self.focal, width / 2, 0),
                     "--right-info", write_info(folder / "right.yaml", (width, height), self.focal,
                                                width / 2 + self.cx_difference, -self.focal * self.baseline)]
        near, far = (self.focal * self.baseline / (d + self.cx_difference)
                     for d in (np.nanmax(self.truth) + 5, np.nanmin(self.truth) - 5))
        done = run(self.left, self.right, *arguments, "--output", folder / "cloud.ply",
                   "--disparity", folder / "disparity.pfm",
                   "--min-working-distance", near, "--max-working-distance", far)
        assert done.returncode == 0, done.stderr
        assert "reconstruct_seconds: " in done.stdout
        return cv2.imread(str(folder / "disparity.pfm"), cv2.IMREAD_UNCHANGED)

    def semi_global(self):
        low = int(np.nanmin(self.truth) - 5)
        count = int(np.ceil((np.nanmax(self.truth) + 5 - low) / 16)) * 16
        matcher = cv2.StereoSGBM_create(low, count, BLOCK, 8 * BLOCK ** 2, 32 * BLOCK ** 2, 1, 31, 5, 200, 2,
                                        cv2.StereoSGBM_MODE_SGBM_3WAY)
        grey = [cv2.imread(path, cv2.IMREAD_GRAYSCALE) for path in (self.left, self.right)]
        disparity = matcher.compute(*grey).astype(np.float32) / 16
        disparity[disparity < low] = np.nan
        return disparity

    def judged(self):
        """Pixels with truth that the right image sees too and that OpenCV's matcher can reach."""
        mask = np.zeros(self.truth.shape, bool)
        columns = np.arange(self.truth.shape[1])
        for row, disparity in zip(mask, self.truth):
            known = np.isfinite(disparity)
            partner = np.full(disparity.shape, -1)
            partner[known] = np.round(columns[known] - disparity[known]).astype(int)
            known &= (partner >= 0) & (partner < disparity.size)
            nearest = np.full(disparity.size, -np.inf)
            np.maximum.at(nearest, partner[known], disparity[known])
            row[known] = disparity[known] >= nearest[partner[known]] - 1.5
        mask[:, : int(np.nanmax(self.truth)) + 16] = False
        return mask


def aloe():
    truth = cv2.imread(data(OPENCV, "aloeGT.png"), cv2.IMREAD_GRAYSCALE).astype(np.float32)
    truth[truth == 0] = np.nan
    return Scene(data(OPENCV, "aloeL.jpg"), data(OPENCV, "aloeR.jpg"), truth, 3740.0, 0.160, 0.0)


def motorcycle():
    with np.load(data(SKIMAGE, "motorcycle_disp.npz")) as stored:
        truth = stored[stored.files[0]].astype(np.float32)
    truth[~np.isfinite(truth)] = np.nan
    return Scene(data(SKIMAGE, "motorcycle_left.png"), data(SKIMAGE, "motorcycle_right.png"), truth, 994.978, 0.193001,
                 31.086)


def between_whole_pixels(truth):
    """Smooth truth of smooth parts: the mean of 25 x 25 whole numbers where they differ by at most 4; NaN elsewhere."""
    kernel = np.ones((25, 25))
    known = np.nan_to_num(truth, nan=-1000.0)
    spread = cv2.dilate(known, kernel) - cv2.erode(known, kernel)
    smooth = cv2.blur(known, (25, 25))
    smooth[spread > 4] = np.nan
    return smooth


def figures(disparities, scene, fine_truth):
    """Share of pixels off by more than 2 px, and median error, of each disparity where all have one.

    What the truth itself is off by, the same everywhere, counts for no one: it is the mean of what each disparity has.
    For aloe, whose truth was rounded down, that is a quarter of a pixel; for motorcycle 0.05 px. Neither matcher is
    needed to see it: the best correlation of 15 x 15 windows, the right one interpolated by cubic splines, lies 0.27 px
    (aloe, 2912 well textured points) and 0.09 px (motorcycle, 590) beyond the truth. "raw_bad2" is the share with the
    truth as it comes.
    """
    pixels = np.logical_and.reduce([scene.judged(), *map(np.isfinite, disparities)])
    fine = pixels & np.isfinite(fine_truth)
    offset = np.mean([np.median((d - fine_truth)[fine]) for d in disparities])
    return [{"raw_bad2": (np.abs(d - scene.truth)[pixels] > 2).mean(),
             "bad2": (np.abs(d - scene.truth - offset)[pixels] > 2).mean(),
             "median": np.median(np.abs(d - fine_truth - offset)[fine])} for d in disparities]
