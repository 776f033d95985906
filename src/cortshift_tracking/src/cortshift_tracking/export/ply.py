"""Binary PLY for ParaView, Slicer and MeshLab: millimetres, a surface with the displacement as dx dy dz of its vertices.

The comment SPACE=RAS (or LPS) is what Slicer looks for.
"""
import numpy as np

from cortshift_tracking.durable import write_durably
from cortshift_tracking.export.grid_mesh import mesh_of

VERTEX = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('dx', '<f4'), ('dy', '<f4'), ('dz', '<f4'),
                   ('red', 'u1'), ('green', 'u1'), ('blue', 'u1'), ('confidence', '<f4')])
FACE = np.dtype([('count', 'u1'), ('corners', '<i4', 3)])
TYPES = {'f4': 'float', 'u1': 'uchar'}


def write(path, field, axes):
    place, triangles = mesh_of(field)
    layout = VERTEX if field.uncertainty is None else np.dtype(VERTEX.descr + [('uncertainty', '<f4')])
    vertices = np.empty(len(place[0]), layout)
    if field.uncertainty is not None:
        vertices['uncertainty'] = 1000 * field.uncertainty[place]
    for n, name in enumerate('xyz'):
        vertices[name] = 1000 * field.start[place][:, n]
        vertices['d' + name] = 1000 * field.displacement[place][:, n]
    for n, name in enumerate(('red', 'green', 'blue')):
        vertices[name] = field.colour[place][:, n]
    vertices['confidence'] = field.confidence[place]
    faces = np.empty(len(triangles), FACE)
    faces['count'], faces['corners'] = 3, triangles
    properties = '\n'.join(f'property {TYPES[layout[name].str[1:]]} {name}' for name in layout.names)
    header = (f'ply\nformat binary_little_endian 1.0\ncomment SPACE={axes}\ncomment lengths in mm\n'
              f'comment displacement dx dy dz from {field.from_key} to {field.to_key}\n'
              + ''.join(f'comment {name} {text}\n' for name, text in field.remarks.items()) +
              f'element vertex {len(vertices)}\n{properties}\n'
              f'element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n')
    write_durably(path, header.encode() + vertices.tobytes() + faces.tobytes())
