"""Files that are whole or not there, even if the power goes."""
import contextlib
import os
import tempfile


def _sync(path):
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def replacing(path):
    """A temporary file beside `path`, to be written in the block, that takes its place when the block ends well: fsync, rename,
    fsync of the folder.

    Raises OSError, with the old file untouched, where the disk is full or the folder cannot be written.
    """
    folder = os.path.dirname(os.path.abspath(path))
    handle, temporary = tempfile.mkstemp(prefix='.' + os.path.basename(path) + '.', suffix='.part', dir=folder)
    os.close(handle)
    try:
        yield temporary
        _sync(temporary)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
    _sync(folder)


def write_durably(path, data):
    """Write `data` (bytes or str) to `path` as `replacing` does."""
    with replacing(path) as temporary, open(temporary, 'wb') as file:
        file.write(data.encode() if isinstance(data, str) else data)


def removed_durably(path):
    """Remove `path`, if it is there, so that it does not come back when the power goes."""
    with contextlib.suppress(FileNotFoundError):
        os.unlink(path)
        _sync(os.path.dirname(os.path.abspath(path)))
