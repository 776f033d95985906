"""Reads the organised binary PCD files of phantom_surface."""
import numpy as np


def read_pcd(path):
    """Points (H, W, 3) [m], NaN where there is none, colour (H, W, 3) uint8 red green blue, confidence (H, W)."""
    with open(path, 'rb') as file:
        header = {}
        while 'DATA' not in header:
            key, _, value = file.readline().decode().strip().partition(' ')
            header[key] = value
        assert header['FIELDS'] == 'x y z rgb confidence' and header['DATA'] == 'binary'
        records = np.frombuffer(file.read(), np.dtype([('xyz', '<f4', 3), ('rgb', '<u4'), ('confidence', '<f4')]))
    records = records.reshape(int(header['HEIGHT']), int(header['WIDTH']))
    colour = np.stack([records['rgb'] >> shift & 255 for shift in (16, 8, 0)], -1).astype(np.uint8)
    return records['xyz'].astype(float), colour, records['confidence']
