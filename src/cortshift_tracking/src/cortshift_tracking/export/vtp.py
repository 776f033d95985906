"""VTK XML PolyData for ParaView and Slicer: millimetres, a surface with the vector array `displacement`.

The field data's array SPACE (RAS or LPS) is what Slicer looks for. Arrays are inline
binary (base64 of a 32-bit byte count and the values).
"""
import base64
from xml.sax.saxutils import quoteattr

import numpy as np

from cortshift_tracking.durable import write_durably
from cortshift_tracking.export.grid_mesh import mesh_of

TYPES = {'f4': 'Float32', 'i4': 'Int32', 'u1': 'UInt8'}


def _array(name, values):
    values = np.ascontiguousarray(values)
    data = np.uint32(values.nbytes).tobytes() + values.tobytes()
    components = values.shape[1] if values.ndim == 2 else 1
    return (f'<DataArray type="{TYPES[values.dtype.str[1:]]}" Name={quoteattr(name)} NumberOfComponents="{components}" '
            f'format="binary">{base64.b64encode(data).decode()}</DataArray>\n')


def _text(name, value):
    codes = ' '.join(str(code) for code in value.encode() + b'\0')
    return f'<Array type="String" Name={quoteattr(name)} NumberOfTuples="1" format="ascii">{codes}</Array>\n'


def write(path, field, axes):
    place, triangles = mesh_of(field)
    vectors = (1000 * field.displacement[place]).astype('<f4')
    page = ('<?xml version="1.0"?>\n'
            '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt32">\n<PolyData>\n<FieldData>\n'
            + _text('SPACE', axes) + _text('unit', 'mm') + _text('from_key', field.from_key) + _text('to_key', field.to_key)
            + ''.join(_text(name, value) for name, value in field.remarks.items()) + f'</FieldData>\n<Piece NumberOfPoints="{len(vectors)}" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" '
            f'NumberOfPolys="{len(triangles)}">\n<PointData Vectors="displacement" Scalars="magnitude">\n'
            + _array('displacement', vectors) + _array('magnitude', np.linalg.norm(vectors, axis=1).astype('<f4'))
            + _array('confidence', field.confidence[place].astype('<f4'))
            + ('' if field.uncertainty is None else _array('uncertainty', (1000 * field.uncertainty[place]).astype('<f4')))
            + _array('colour', np.asarray(field.colour[place], 'u1'))
            + '</PointData>\n<Points>\n' + _array('Points', (1000 * field.start[place]).astype('<f4'))
            + '</Points>\n<Polys>\n' + _array('connectivity', triangles.astype('<i4').ravel())
            + _array('offsets', np.arange(3, 3 * len(triangles) + 1, 3, dtype='<i4'))
            + '</Polys>\n</Piece>\n</PolyData>\n</VTKFile>\n')
    write_durably(path, page)
