"""The two ends of an OpenIGTLink connection for tests: a client, and a server for one client."""
import contextlib
import socket
import threading

from igtl_messages import HEADER, Transform, unpack

BUFFER = 65536


def receive(connection, size):
    """Exactly so many bytes. Raises OSError where the connection ends."""
    data = b''
    while len(data) < size:
        part = connection.recv(min(BUFFER, size - len(data)))
        if not part:
            raise ConnectionError('the other end has closed')
        data += part
    return data


class Client:
    """Connects at once. Keeps the newest message of each device that nobody has taken."""

    def __init__(self, host, port):
        self._connection = socket.create_connection((host, port), timeout=20)
        self._connection.settimeout(None)
        self._newest, self._fault = {}, None
        self._arrived, self._sending = threading.Condition(), threading.Lock()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self):
        try:
            while True:
                header = receive(self._connection, HEADER.size)
                message = unpack(header, receive(self._connection, HEADER.unpack(header)[4]))
                with self._arrived:
                    self._newest[message.device] = message
                    self._arrived.notify_all()
        except (OSError, AssertionError) as fault:
            with self._arrived:
                self._fault = fault
                self._arrived.notify_all()

    def is_connected(self):
        return self._thread.is_alive()

    def forget(self):
        """What has arrived and was not taken."""
        with self._arrived:
            self._newest.clear()

    def take(self, device, seconds, since=0.0):
        """The newest message of a device with a time stamp of at least `since` [s]; None if none comes."""
        def there():
            return device in self._newest and self._newest[device].stamp >= since - 1e-5
        with self._arrived:
            self._arrived.wait_for(lambda: there() or self._fault, seconds)
            return self._newest.pop(device) if there() else None

    def expect(self, device, seconds=20, since=0.0):
        """As take(); raises AssertionError if none comes."""
        message = self.take(device, seconds, since)
        assert message is not None, f'no message {device} within {seconds} s; connection: {self._fault or "open"}'
        return message

    def send(self, message):
        with self._sending:
            self._connection.sendall(message.pack())

    def transform(self, device, matrix_mm, stamp, **metadata):
        self.send(Transform(device, stamp, matrix=matrix_mm, metadata=metadata))

    def stop(self):
        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._connection.close()


class Port:
    """A port of this machine that is ours but not open: who connects is refused until listen()."""

    def __init__(self):
        self._holder = self._socket()
        self._holder.bind(('127.0.0.1', 0))
        self.number = self._holder.getsockname()[1]

    @staticmethod
    def _socket():
        made = socket.socket()
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)  # it is bound once more to listen
        return made

    @contextlib.contextmanager
    def listen(self):
        """For `with`: the connection of the first client that comes. Nobody is let in afterwards."""
        with self._socket() as server:
            server.bind(('127.0.0.1', self.number))
            server.listen(1)
            server.settimeout(20)
            connection, _ = server.accept()
            with connection:
                yield connection

    def close(self):
        self._holder.close()
