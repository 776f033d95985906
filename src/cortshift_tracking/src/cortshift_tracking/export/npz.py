"""NumPy archive. Metres, radians, seconds; every array is described in the array `documentation`."""
import io

import numpy as np

from cortshift_tracking.durable import write_durably

DOCUMENTATION = {
    'start': '(H, W, 3) float32: x y z on the earlier surface, pMR space [m]; NaN where no displacement is trusted',
    'displacement': '(H, W, 3) float32: dx dy dz to the later surface [m]; NaN in the same places',
    'confidence': '(H, W) float32: 0-1; NaN in the same places',
    'colour': '(H, W, 3) uint8: red green blue of the earlier surface; meaningless where not valid',
    'valid': '(H, W) bool: whether the displacement is trusted',
    'uncertainty': '(H, W) float32: root mean square length expected of the error [m]; NaN in the same places; only where known',
    'strain_major': '(H, W) float32: larger principal strain, only where it was computed',
    'strain_minor': '(H, W) float32: smaller principal strain, only where it was computed',
    'T_pmr_projection': '(4, 4) float64: pose of the projection frame in pMR space [m]; grid point (row, column) projects '
                        'from (column, row, 0) * resolution; z is the average normal of the earlier surface',
    'resolution': '() float64: distance of neighbouring grid points [m]',
    'from_key': '() str: the earlier stage', 'to_key': '() str: the later stage',
    'from_stamp': '() float64: exposure of the earlier stage [s since 1970, UTC]',
    'to_stamp': '() float64: exposure of the later stage [s since 1970, UTC]',
    'space': '() str: what the axes of pMR space point to: RAS or LPS',
    'software': '() str: version of cortshift that made the field; only where known',
    'configuration': '() str: SHA-256 of the effective parameters; only where known',
    'calibration': '() str: SHA-256 of both camera_infos, the stereo and the hand-eye edge; only where known',
    'warnings': '() str: what a person should know before believing the field, divided by " | "; only where there is something',
    'documentation': '(N, 2) str: name and meaning of every array',
}


def arrays_of(field, axes):
    arrays = {
        'start': field.start.astype(np.float32), 'displacement': field.displacement.astype(np.float32),
        'confidence': np.where(field.valid, field.confidence, np.nan).astype(np.float32),
        'colour': np.asarray(field.colour, np.uint8), 'valid': field.valid, 'T_pmr_projection': field.T_pmr_projection,
        'resolution': np.float64(field.resolution), 'from_key': field.from_key, 'to_key': field.to_key,
        'from_stamp': np.float64(field.from_stamp), 'to_stamp': np.float64(field.to_stamp), 'space': axes, **field.remarks}
    for name in ('uncertainty', 'strain_major', 'strain_minor'):
        if getattr(field, name) is not None:
            arrays[name] = np.asarray(getattr(field, name), np.float32)
    arrays['documentation'] = np.array([(name, DOCUMENTATION[name]) for name in (*arrays, 'documentation')])
    return arrays


def write(path, field, axes):
    data = io.BytesIO()
    np.savez_compressed(data, **arrays_of(field, axes))
    write_durably(path, data.getvalue())
