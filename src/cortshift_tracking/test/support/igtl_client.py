"""An independent OpenIGTLink client for the tests: pyigtl for the connection, the header and the checksum, and the
message types that it lacks, written after the protocol's description."""
import glob
import os
import site
import socket
import struct
import time

import igtl_environment


def use_environment():
    """Import from the virtual environment with pyigtl beside what this Python has. Raises RuntimeError without it."""
    folder = os.path.join(os.environ['CMAKE_PREFIX_PATH'].split(':')[0], 'share', 'cortshift_tracking', 'igtl_venv')
    igtl_environment.make(folder)
    for path in glob.glob(os.path.join(folder, 'lib', 'python3*', 'site-packages')):
        site.addsitedir(path)


use_environment()
import numpy as np  # noqa: E402
import pyigtl  # noqa: E402
from pyigtl.messages import MessageBase, message_type_to_class_constructor  # noqa: E402


def message_type(name):
    def register(cls):
        def construct(self, device_name=None, timestamp=None, **values):
            MessageBase.__init__(self, timestamp=timestamp, device_name=device_name)
            self._message_type, self._valid_message = name, True
            self.__dict__.update(values)
        cls.__init__ = construct
        message_type_to_class_constructor[name] = cls
        return cls
    return register


@message_type('POLYDATA')
class PolyData(MessageBase):
    """points (N, 3), polygons (M, 4) and attributes {name: (N, components)} after reading."""

    def _unpack_content(self, content):
        counts = struct.unpack('> 10I', content[:40])
        at = 40
        self.points = np.frombuffer(content, '>f4', 3 * counts[0], at).reshape(-1, 3).astype(float)
        at += 12 * counts[0]
        cells = []
        for number, size in zip(counts[1:9:2], counts[2:9:2]):
            cells.append(np.frombuffer(content, '>u4', size // 4, at).reshape(number, -1) if number else np.zeros((0, 5)))
            at += size
        self.polygons = cells[2][:, 1:].astype(int)
        heads = [struct.unpack('> B B I', content[at + 6 * i:at + 6 * i + 6]) for i in range(counts[9])]
        at += 6 * counts[9]
        names = []
        names_start = at
        for _ in heads:
            end = content.index(b'\0', at)
            names.append(content[at:end].decode())
            at = end + 1
        at += (at - names_start) % 2  # padded to an even number of bytes
        self.attributes = {}
        for name, (_, components, number) in zip(names, heads):
            values = np.frombuffer(content, '>f4', components * number, at)
            self.attributes[name] = values.reshape(number, components).astype(float)
            at += values.nbytes
        assert at == len(content), f'{len(content) - at} bytes are left over'


@message_type('NDARRAY')
class NDArray(MessageBase):
    def _unpack_content(self, content):
        kind, dimensions = content[:2]
        assert (kind, dimensions) == (11, 1)
        size, = struct.unpack('> H', content[2:4])
        self.values = np.frombuffer(content, '>f8', size, 4).astype(float)
        assert len(content) == 4 + 8 * size


@message_type('POSITION')
class Position(MessageBase):
    """position (3,) [mm], quaternion (4,) x y z w"""

    def _pack_content(self):
        return struct.pack('> 7f', *self.position, *self.quaternion)


@message_type('TDATA')
class TrackingData(MessageBase):
    """tools {name: 4 x 4}"""

    def _pack_content(self):
        return b''.join(struct.pack('> 20s B B 12f', name.encode(), 2, 0, *np.asarray(matrix)[:3].T.ravel())
                        for name, matrix in self.tools.items())


@message_type('STATUS')
class Status(MessageBase):
    code = 1

    def _pack_content(self):
        return struct.pack('> H q 20s', self.code, 0, b'')

    def _unpack_content(self, content):
        self.code, = struct.unpack('> H', content[:2])


@message_type('RAW')
class Raw(MessageBase):
    """content: any bytes"""

    def _pack_content(self):
        return self.content


@message_type('GET_STATUS')
class GetStatus(MessageBase):
    pass


@message_type('COMMAND')
class Command(MessageBase):
    """number, name, text"""

    def _pack_content(self):
        return struct.pack('> I 128s H I', self.number, self.name.encode(), 3, len(self.text)) + self.text.encode()

    def _unpack_content(self, content):
        self.number, name, _, size = struct.unpack('> I 128s H I', content[:138])
        self.name, self.text = name.rstrip(b'\0').decode(), content[138:138 + size].decode()


message_type_to_class_constructor['RTS_COMMAND'] = Command


class Client(pyigtl.OpenIGTLinkClient):
    """pyigtl's client, but never giving up half a header that has arrived."""

    def _receive_message_from_socket(self, ssocket):
        try:
            if len(ssocket.recv(MessageBase.IGTL_HEADER_SIZE, socket.MSG_PEEK)) < MessageBase.IGTL_HEADER_SIZE:
                return False
        except socket.timeout:
            return False
        return super()._receive_message_from_socket(ssocket)

    def expect(self, device, seconds=20, since=0.0):
        """The next message of this device with a time stamp of at least `since` [s], older ones being of an earlier request.

        Raises AssertionError if none comes.
        """
        end = time.monotonic() + seconds
        while True:
            message = self.wait_for_message(device, timeout=max(0.0, end - time.monotonic()))
            assert message is not None, f'no message {device} within {seconds} s'
            if message.timestamp >= since - 1e-5:
                return message

    def transform(self, device, matrix_mm, stamp, **metadata):
        message = pyigtl.TransformMessage(matrix_mm, timestamp=stamp, device_name=device)
        if metadata:
            message.header_version, message.metadata = 2, metadata
        self.send_message(message)
