"""Files that are whole or absent: written aside, flushed to the disk, then renamed.

HDF5 files are built in memory first. So a full disk shows up as an ordinary OSError of an ordinary write, never as a
torn file inside the HDF5 library, and a process killed at any moment leaves the earlier file as it was.
"""

import io
import os
from collections.abc import Callable
from pathlib import Path

import h5py

ASIDE = ".aside"  # suffix of a file in the making; one that is left over was never finished


def hdf5_image(fill: Callable[[h5py.File], None], base: Path | None = None) -> memoryview:
    """Return the bytes of an HDF5 file that `fill` writes, on top of the content of `base` where that is given."""
    buffer = io.BytesIO(b"" if base is None else base.read_bytes())
    with h5py.File(buffer, "w" if base is None else "r+") as file:
        fill(file)
    return buffer.getbuffer()


def write_whole(path: Path, content: bytes | memoryview) -> None:
    """Put `content` at `path` so that readers, also after a crash, see the old file or the new one, both whole.

    Raises OSError where it cannot be written, for instance on a full disk; the old file is then untouched.
    """
    aside = path.with_name(path.name + ASIDE)
    try:
        with open(aside, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(aside, path)
    except OSError as error:
        aside.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from error
    _flush_directory(path.parent)


def _flush_directory(directory: Path) -> None:
    """Make a rename in `directory` survive a loss of power."""
    if os.name != "posix":
        return
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
