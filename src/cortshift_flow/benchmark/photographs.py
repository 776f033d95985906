#!/usr/bin/python3
"""Writes the known flow of two pairs of photographs as .flo and prints benchmark_flow's arguments for them.

usage: photographs.py FOLDER

aloe comes with opencv-doc, motorcycle with python3-skimage; a pair that is not installed is named on stderr and left
out. Both are rectified stereo pairs: the flow is the left image's disparity, to the left.
"""
import importlib.util
import pathlib
import sys

import cv2
import numpy as np

ALOE = pathlib.Path('/usr/share/doc/opencv-doc/examples/data')
UNKNOWN = 1e10  # Middlebury's convention: above 1e9


def write_flow(path, disparity, known):
    flow = np.full(disparity.shape + (2,), UNKNOWN, np.float32)
    flow[known] = np.stack([-disparity[known], np.zeros(known.sum())], axis=1)
    with open(path, 'wb') as out:
        out.write(b'PIEH')
        out.write(np.array(disparity.shape[::-1], '<i4').tobytes())
        out.write(flow.astype('<f4').tobytes())


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[1])
    if (ALOE / 'aloeGT.png').exists():
        disparity = cv2.imread(str(ALOE / 'aloeGT.png'), cv2.IMREAD_UNCHANGED).astype(np.float32)
        write_flow(folder / 'aloe.flo', disparity, disparity > 0)
        print(f"aloe={ALOE / 'aloeL.jpg'},{ALOE / 'aloeR.jpg'},{folder / 'aloe.flo'}")
    else:
        print('photographs.py: no aloe: opencv-doc is not installed', file=sys.stderr)
    skimage = importlib.util.find_spec('skimage')
    data = pathlib.Path(skimage.origin).parent / 'data' if skimage else None
    if data and (data / 'motorcycle_disp.npz').exists():
        disparity = np.load(data / 'motorcycle_disp.npz')['arr_0']
        write_flow(folder / 'motorcycle.flo', disparity, np.isfinite(disparity) & (disparity > 0))
        print(f"motorcycle={data / 'motorcycle_left.png'},{data / 'motorcycle_right.png'},{folder / 'motorcycle.flo'}")
    else:
        print('photographs.py: no motorcycle: python3-skimage is not installed', file=sys.stderr)


if __name__ == '__main__':
    main()
