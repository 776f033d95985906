"""Files that are whole or not there, even if the power goes."""
import os
import tempfile


def write_durably(path, data):
    """Write `data` (bytes or str) to `path`: temporary file, fsync, rename, fsync of the folder.

    Raises OSError, with the old file untouched, where the disk is full or the folder cannot be written.
    """
    folder = os.path.dirname(os.path.abspath(path))
    handle, temporary = tempfile.mkstemp(prefix='.' + os.path.basename(path) + '.', suffix='.part', dir=folder)
    try:
        with os.fdopen(handle, 'wb') as file:
            file.write(data.encode() if isinstance(data, str) else data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
    directory = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)
