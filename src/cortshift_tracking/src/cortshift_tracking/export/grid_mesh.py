"""The valid points of a field as a list, and the triangles between neighbours on its grid."""
import numpy as np


def mesh_of(field):
    """(rows, columns) of the valid points (N,), and triangles (M, 3) of indices into them, seen from outside the head
    anti-clockwise."""
    valid = field.valid
    rows, columns = np.nonzero(valid)
    index = np.full(valid.shape, -1)
    index[rows, columns] = np.arange(len(rows))
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    triangles = np.concatenate([np.stack(corners, -1)[(np.stack(corners) >= 0).all(0)]
                                for corners in ((a, b, c), (b, d, c))])
    return (rows, columns), triangles.astype(np.int32)
