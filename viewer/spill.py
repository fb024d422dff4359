"""A file behind a pipe, for a writer that cannot take a full disk.

Rerun's own file sink ends its thread at the first failed write, after which `flush` may never return, whatever its
timeout: a full disk would hang the run that is recorded. Behind a pipe it sees no failure; whoever owns the file does.
"""

import fcntl
import os
import select
import struct
import termios
import threading
from pathlib import Path

CHUNK = 1 << 20


class Spill:
    """Copies what comes through a pipe into a file; after a failure it goes on reading, and keeps nothing."""

    def __init__(self, path: Path):
        """Create the file at `path`; raises OSError where it cannot be."""
        self._file = open(path, "wb", buffering=0)  # noqa: SIM115: it stays open until `close`
        self._read_end, self._write_end = os.pipe()
        self._problem: OSError | None = None
        self._settled = 0  # size of the file when all that had been sent was in it
        self._copying = threading.Lock()  # held from taking bytes out of the pipe until they are in the file
        self._thread = threading.Thread(target=self._copy, name=f"spill into {path.name}", daemon=True)
        self._thread.start()

    @property
    def entrance(self) -> str:
        """Path under which the writer opens the pipe, once, before `seal`."""
        return f"/dev/fd/{self._write_end}"

    def seal(self) -> None:
        """Let the pipe end when its writer closes it."""
        os.close(self._write_end)

    def settle(self) -> None:
        """Return when everything that the writer has sent is in the file.

        Raises the OSError that kept it out; the file then ends where it last was settled.
        """
        while True:
            with self._copying:
                if self._problem is not None:
                    raise self._problem
                waiting = struct.unpack("i", fcntl.ioctl(self._read_end, termios.FIONREAD, bytes(4)))[0]
                if waiting == 0:
                    self._settled = self._file.tell()
                    return

    def close(self) -> None:
        """Wait for the writer to close the pipe, then close the file; raises OSError like `settle`."""
        self._thread.join()
        os.close(self._read_end)
        self._file.close()
        if self._problem is not None:
            raise self._problem

    def _copy(self) -> None:
        while True:
            select.select([self._read_end], [], [])
            with self._copying:
                content = memoryview(os.read(self._read_end, CHUNK))
                if not content:
                    return
                while content and self._problem is None:
                    try:
                        content = content[self._file.write(content) :]
                    except OSError as problem:
                        self._problem = problem
                        self._file.truncate(self._settled)
