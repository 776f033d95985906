"""A small DICOM series, slice by slice."""
import os

import numpy as np
import pydicom

TEMPLATE = os.path.join(os.path.dirname(pydicom.__file__), 'data', 'test_files', 'MR_small.dcm')
SLICES, SIZE, SPACING = 8, 16, 3.0


def voxels():
    return (np.arange(SIZE * SIZE * SLICES).reshape(SLICES, SIZE, SIZE) % 900).astype('<i2')  # slice, row, column


def series(folder, change=None):
    """Eight slices; change(dataset, n) alters the n-th before it is written."""
    os.makedirs(folder)
    for n in range(SLICES):
        slice_ = pydicom.dcmread(TEMPLATE)
        slice_.SOPInstanceUID += f'.{n}'
        slice_.Rows = slice_.Columns = SIZE
        slice_.PixelData = voxels()[n].tobytes()
        slice_.PixelSpacing, slice_.ImageOrientationPatient = [SPACING, SPACING], [1, 0, 0, 0, 1, 0]
        slice_.ImagePositionPatient = [0, 0, SPACING * n]
        if change:
            change(slice_, n)
        slice_.save_as(os.path.join(folder, f'{n:02d}.dcm'))
    return str(folder)
