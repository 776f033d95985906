"""OpenIGTLink messages as bytes, after the protocol's description (header and message types of version 3) and nothing of
ours: what the tests of the bridge hold against it."""
import struct
import time

import crcmod
import numpy as np

HEADER = struct.Struct('> H 12s 20s Q Q Q')   # version, type, device, time stamp, size of the body, its CRC
EXTENDED_HEADER = struct.Struct('> H H I I')  # its own size, sizes of the metadata's index and text, message number
checksum = crcmod.mkCrcFun(0x142f0e1eba9ea3693, initCrc=0, rev=False, xorOut=0)  # CRC-64, ECMA-182
ASCII = 3  # MIB number
READERS = {}


def text(raw):
    return raw.split(b'\0', 1)[0].decode()


class Message:
    """One message. stamp: UTC [s]; version 2 carries metadata {name: value}. Further values are those of its type."""
    kind = ''

    def __init__(self, device='', stamp=None, version=1, metadata=None, kind=None, **values):
        self.device, self.stamp = device, time.time() if stamp is None else stamp
        self.version, self.metadata = max(version, 2 if metadata else 1), metadata or {}
        self.kind = kind or self.kind
        self.__dict__.update(values)

    def __init_subclass__(cls):
        if cls.kind:
            READERS[cls.kind] = cls

    def content(self):
        return b''

    def read(self, content):
        """Set the type's values from the content of the body."""

    def pack(self):
        body = self.content()
        if self.version >= 2:
            pairs = [(name.encode(), value.encode()) for name, value in self.metadata.items()]
            index = struct.pack('> H', len(pairs)) + b''.join(struct.pack('> H H I', len(n), ASCII, len(v)) for n, v in pairs)
            texts = b''.join(n + v for n, v in pairs)
            body = EXTENDED_HEADER.pack(EXTENDED_HEADER.size, len(index), len(texts), 0) + body + index + texts
        return HEADER.pack(self.version, self.kind.encode(), self.device.encode(), int(self.stamp * 2 ** 32), len(body),
                           checksum(body)) + body


def read_metadata(index, texts):
    count, = struct.unpack_from('> H', index)
    metadata, at = {}, 0
    for n in range(count):
        name, _, value = struct.unpack_from('> H H I', index, 2 + 8 * n)
        metadata[texts[at:at + name].decode()] = texts[at + name:at + name + value].decode()
        at += name + value
    return metadata


def unpack(header, body):
    """The message of a header and its body. Raises AssertionError where they contradict the protocol."""
    version, kind, device, stamp, size, crc = HEADER.unpack(header)
    assert size == len(body) and crc == checksum(body), f'{text(kind)} {text(device)}: size or checksum is wrong'
    metadata = {}
    if version >= 2:
        own, index, texts, _ = EXTENDED_HEADER.unpack_from(body)
        end = len(body) - index - texts
        metadata = read_metadata(body[end:end + index], body[end + index:])
        body = body[own:end]
    message = READERS.get(text(kind), Raw)(text(device), stamp / 2 ** 32, version, metadata, kind=text(kind))
    message.read(body)
    return message


class Raw(Message):
    """bytes: any content, of the kind that is given."""
    bytes = b''

    def content(self):
        return self.bytes

    def read(self, content):
        self.bytes = content


class Transform(Message):
    """matrix: 4 x 4 [mm]"""
    kind = 'TRANSFORM'

    def content(self):
        return struct.pack('> 12f', *np.asarray(self.matrix)[:3].T.ravel())


class Position(Message):
    """position: (3,) [mm]; quaternion: x y z w"""
    kind = 'POSITION'

    def content(self):
        return struct.pack('> 7f', *self.position, *self.quaternion)


class TrackingData(Message):
    """tools: {name: 4 x 4 [mm]}"""
    kind = 'TDATA'

    def content(self):
        return b''.join(struct.pack('> 20s B B 12f', name.encode(), 2, 0, *np.asarray(matrix)[:3].T.ravel())
                        for name, matrix in self.tools.items())


class String(Message):
    """string: the text"""
    kind = 'STRING'

    def content(self):
        return struct.pack('> H H', ASCII, len(self.string)) + self.string.encode()

    def read(self, content):
        size, = struct.unpack_from('> H', content, 2)
        assert len(content) == 4 + size
        self.string = content[4:].decode()


class Status(Message):
    """code: 1 is OK"""
    kind = 'STATUS'
    code = 1

    def content(self):
        return struct.pack('> H q 20s', self.code, 0, b'')

    def read(self, content):
        self.code, = struct.unpack_from('> H', content)


class GetStatus(Message):
    kind = 'GET_STATUS'


class Command(Message):
    """number, name, text"""
    kind = 'COMMAND'

    def content(self):
        return struct.pack('> I 128s H I', self.number, self.name.encode(), ASCII, len(self.text)) + self.text.encode()

    def read(self, content):
        self.number, name, _, size = struct.unpack_from('> I 128s H I', content)
        self.name, self.text = text(name), content[138:138 + size].decode()


class CommandReply(Command):
    kind = 'RTS_COMMAND'


class Image(Message):
    """pixels: (slices, rows, columns, channels) uint8 or float32; axes: 'ras' or 'lps'; T_world_ijk: of pixel (column, row, slice) [mm]."""
    kind = 'IMAGE'

    def read(self, content):
        _, channels, scalars, endian, axes, *size = struct.unpack_from('> H B B B B 3H', content)
        i, j, k, centre = np.frombuffer(content, '>f4', 12, 12).reshape(4, 3).astype(float)
        assert scalars == 3 or (scalars, endian) == (10, 2), 'neither of 8 bits without a sign nor little-endian float32'
        assert struct.unpack_from('> 6H', content, 60) == (0, 0, 0, *size), 'a part of an image'
        self.axes = {1: 'ras', 2: 'lps'}[axes]
        self.pixels = np.frombuffer(content, np.uint8 if scalars == 3 else '<f4', offset=72).reshape(*size[::-1], channels)
        self.T_world_ijk = np.eye(4)
        self.T_world_ijk[:3, :3] = np.column_stack([i, j, k])
        self.T_world_ijk[:3, 3] = centre - self.T_world_ijk[:3, :3] @ ((np.array(size) - 1) / 2)


class NDArray(Message):
    """values: (N,)"""
    kind = 'NDARRAY'

    def read(self, content):
        kind, dimensions, size = struct.unpack_from('> B B H', content)
        assert (kind, dimensions, len(content)) == (11, 1, 4 + 8 * size), 'not one row of numbers of 64 bits'
        self.values = np.frombuffer(content, '>f8', size, 4).astype(float)


class PolyData(Message):
    """points: (N, 3) [mm]; polygons: (M, 4); attributes: {name: (N, components)}"""
    kind = 'POLYDATA'

    def read(self, content):
        number_of_points, *cells, number_of_attributes = struct.unpack_from('> 10I', content)
        self.points = np.frombuffer(content, '>f4', 3 * number_of_points, 40).reshape(-1, 3).astype(float)
        at = 40 + 12 * number_of_points
        for name, number, size in zip(('vertices', 'lines', 'polygons', 'strips'), cells[::2], cells[1::2]):
            if name == 'polygons':
                counted = np.frombuffer(content, '>u4', size // 4, at).reshape(number, -1) if number else np.zeros((0, 5))
                self.polygons = counted[:, 1:].astype(int)
            at += size
        heads = [struct.unpack_from('> B B I', content, at + 6 * n) for n in range(number_of_attributes)]
        at = begin = at + 6 * number_of_attributes
        names = []
        for _ in heads:
            names.append(text(content[at:]))
            at += len(names[-1]) + 1
        at += (at - begin) % 2  # the names are padded to an even number of bytes
        self.attributes = {}
        for name, (_, components, number) in zip(names, heads):
            self.attributes[name] = np.frombuffer(content, '>f4', components * number, at).reshape(number, -1).astype(float)
            at += 4 * components * number
        assert at == len(content), f'{len(content) - at} bytes are left over'
