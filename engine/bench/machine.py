"""What this machine's memory can do, the yardstick of every kernel that is bound by it."""

from functools import cache
from time import perf_counter

import numpy as np
from numba import njit, prange

from engine.arrays import Floats

ENTRIES = 8_000_000  # 64 MB per array: three of them are in no cache
REPEATS = 7


@cache
def memory_bandwidth(threads: int) -> float:
    """Return the bandwidth [bytes/s] of a triad a = b + s c on `threads` threads, the best of several passes.

    Counted are the 24 bytes per entry that the kernel names. The caller has set the threads; the argument keeps the
    measurements of different counts apart.
    """
    a, b, c = (np.full(ENTRIES, value) for value in (0.0, 1.0, 2.0))
    _triad(a, b, c, 0.5)  # compiles, and maps the pages
    best = np.inf
    for _ in range(REPEATS):
        began = perf_counter()
        _triad(a, b, c, 0.5)
        best = min(best, perf_counter() - began)
    return 24 * ENTRIES / best


@njit(cache=True, parallel=True)
def _triad(a: Floats, b: Floats, c: Floats, s: float) -> None:
    for i in prange(len(a)):
        a[i] = b[i] + s * c[i]
