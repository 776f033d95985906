#!/usr/bin/python3
"""Writes the known flow of pairs of photographs as .flo and prints benchmark_flow's arguments for them.

usage: photographs.py FOLDER

aloe comes with opencv-doc, motorcycle with python3-skimage; a pair that is not installed is named on stderr and left
out. Both are rectified stereo pairs: the flow is the left image's disparity, to the left. The flow's settings were looked
at on these two. On the others nothing was chosen: an ellipse of one photograph moves over another one, each turned, scaled
and shifted, with noise of 1/255. Their flow is known where the second image shows the same.
"""
import importlib.util
import pathlib
import sys

import cv2
import numpy as np

OPENCV = pathlib.Path('/usr/share/doc/opencv-doc/examples/data')
UNKNOWN = 1e10  # Middlebury's convention: above 1e9
LAYERS = {'home': ('home.jpg', 'fruits.jpg'), 'coffee': ('coffee.png', 'astronaut.png'), 'retina': ('retina.jpg', 'chelsea.png'),
          'wall': ('graf1.png', 'baboon.jpg')}   # the resting photograph and the one that moves over it
WIDTH, HEIGHT = 480, 360
CENTRE, RADII = (WIDTH / 2, HEIGHT / 2), (110, 80)   # of the ellipse [px]


def write_disparity(path, disparity, known):
    write_flow(path, np.stack([-disparity, np.zeros_like(disparity)], axis=-1), known)


def write_flow(path, flow, known):
    flow = np.where(known[..., None], flow, UNKNOWN)
    with open(path, 'wb') as out:
        out.write(b'PIEH')
        out.write(np.array(known.shape[::-1], '<i4').tobytes())
        out.write(flow.astype('<f4').tobytes())


class Layer:
    """A photograph larger than the view by 15 %, and how it moves there: turned [degrees] and scaled about the centre, shifted [px]."""

    def __init__(self, path, angle, scale, shift):
        photograph = cv2.imread(str(path)).astype(np.float32)
        factor = 1.15 * max(WIDTH / photograph.shape[1], HEIGHT / photograph.shape[0])
        self._photograph = cv2.resize(photograph, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
        self._margin = [(self._photograph.shape[1] - WIDTH) // 2, (self._photograph.shape[0] - HEIGHT) // 2]
        self._moves = cv2.getRotationMatrix2D(CENTRE, angle, scale)
        self._moves[:, 2] += shift

    def moved(self, points):
        return points @ self._moves[:, :2].T + self._moves[:, 2]

    def before(self, points):
        back = cv2.invertAffineTransform(self._moves)
        return points @ back[:, :2].T + back[:, 2]

    def seen(self, points):
        """Its colours at points (H, W, 2) of the first image."""
        return cv2.remap(self._photograph, (points + self._margin).astype(np.float32), None, cv2.INTER_CUBIC,
                         borderMode=cv2.BORDER_REFLECT)


def in_ellipse(points):
    return (((points - CENTRE) / RADII) ** 2).sum(-1) < 1


def write_layers(folder, name, behind_path, front_path):
    """Two images and their flow. Returns benchmark_flow's argument."""
    behind, front = Layer(behind_path, 0.8, 1.01, (-3.3, 1.7)), Layer(front_path, -1.5, 1.02, (11.4, -6.2))
    grid = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).astype(float)
    covered = in_ellipse(grid)
    random = np.random.default_rng(8)
    for number, (at_front, at_behind) in enumerate(((grid, grid), (front.before(grid), behind.before(grid))), 1):
        image = np.where(in_ellipse(at_front)[..., None], front.seen(at_front), behind.seen(at_behind))
        image = np.clip(np.rint(image + random.normal(0, 1, image.shape)), 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / f'{name}{number}.png'), image)
    end = np.where(covered[..., None], front.moved(grid), behind.moved(grid))
    hidden = ~covered & in_ellipse(front.before(end))
    inside = ((end >= 0) & (end <= [WIDTH - 1, HEIGHT - 1])).all(-1)
    write_flow(folder / f'{name}.flo', end - grid, inside & ~hidden)
    return f"{name}={folder / f'{name}1.png'},{folder / f'{name}2.png'},{folder / f'{name}.flo'}"


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[1])
    if (OPENCV / 'aloeGT.png').exists():
        disparity = cv2.imread(str(OPENCV / 'aloeGT.png'), cv2.IMREAD_UNCHANGED).astype(np.float32)
        write_disparity(folder / 'aloe.flo', disparity, disparity > 0)
        print(f"aloe={OPENCV / 'aloeL.jpg'},{OPENCV / 'aloeR.jpg'},{folder / 'aloe.flo'}")
    else:
        print('photographs.py: no aloe: opencv-doc is not installed', file=sys.stderr)
    skimage = importlib.util.find_spec('skimage')
    data = pathlib.Path(skimage.origin).parent / 'data' if skimage else None
    if data and (data / 'motorcycle_disp.npz').exists():
        disparity = np.load(data / 'motorcycle_disp.npz')['arr_0']
        write_disparity(folder / 'motorcycle.flo', disparity, np.isfinite(disparity) & (disparity > 0))
        print(f"motorcycle={data / 'motorcycle_left.png'},{data / 'motorcycle_right.png'},{folder / 'motorcycle.flo'}")
    else:
        print('photographs.py: no motorcycle: python3-skimage is not installed', file=sys.stderr)
    for name, files in LAYERS.items():
        paths = [next((place / file for place in (OPENCV, data) if place and (place / file).exists()), None) for file in files]
        if None in paths:
            print(f'photographs.py: no {name}: opencv-doc or python3-skimage is not installed', file=sys.stderr)
        else:
            print(write_layers(folder, name, *paths))


if __name__ == '__main__':
    main()
