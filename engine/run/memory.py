"""What memory a run takes, and how much of it is the scene's rather than the program's."""

import ctypes
import resource
import sys
from pathlib import Path

import psutil
from numba.core import event

MMAP_THRESHOLD, LARGE = -3, 1 << 20  # M_MMAP_THRESHOLD of mallopt(3), and what it is set to [bytes]


def give_back_large_arrays() -> None:
    """Have what is as large as LARGE go back to the system when it is freed, where the allocator is that of glibc.

    By itself it raises that size up to 32 MB as such arrays are freed, and keeps them in a heap with holes: `shirt-tag-buckle`
    then holds 6.1 kB a point after 50 steps, not 6.0.
    """
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is not None:
        set_option(MMAP_THRESHOLD, LARGE)


def memory_peak() -> int:
    """Return the largest memory [bytes] that this process has held.

    Linux tells it of the program that runs now; what getrusage(2) knows begins with the process that started it.
    """
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return 1024 * int(line.split()[1])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak  # Linux counts kilobytes


class ProgramMemory(event.Listener):
    """Memory [bytes] of interpreter, libraries and kernels: what is held when this is made, and each kernel's.

    It listens to numba's compiler lock, which a kernel takes once, to be compiled or read from the cache: arrays of the
    scene are not made meanwhile. Listen from before the scene is built.
    """

    EVENT = "numba:compiler_lock"

    def __init__(self) -> None:
        self._process = psutil.Process()
        self._locks = self._before = 0  # held at present, inside one another; memory at the outermost
        self.bytes = self._held()

    def on_start(self, event: event.Event) -> None:
        """Take note of the memory before a kernel."""
        if self._locks == 0:
            self._before = self._held()
        self._locks += 1

    def on_end(self, event: event.Event) -> None:
        """Count what the kernel added."""
        self._locks -= 1
        if self._locks == 0:
            self.bytes += self._held() - self._before

    def _held(self) -> int:
        return int(self._process.memory_info().rss)
