"""The threads that kernels run on."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numba

FEW_NODES = 5000  # below it one thread is faster: of 754 nodes one takes 0.1 ms a linear iteration, two take 0.6 ms

_config: Any = numba.config  # its settings are made at run time, where type checkers do not see them


def available_threads() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def set_threads(count: int | None = None) -> int:
    """Let kernels called from this thread run on `count` threads (None: all available) and return the count.

    OpenMP comes first, since it may be called from several Python threads at once; numba's own workqueue, which may
    not, is there for systems without OpenMP. A process must not be forked after either was used. Raises ValueError
    when `count` is not between 1 and what numba was started with.
    """
    most: int = _config.NUMBA_NUM_THREADS
    if count is None:
        count = min(available_threads(), most)
    if not 1 <= count <= most:
        raise ValueError(f"threads must be between 1 and {most}, not {count}")
    _config.THREADING_LAYER_PRIORITY = ["omp", "workqueue", "tbb"]
    numba.set_num_threads(count)
    return count


@contextmanager
def threads_for(nodes: int) -> Iterator[int]:
    """Let kernels run on one thread inside where a system of `nodes` nodes is small, else on as many as before; yields which."""
    before = numba.get_num_threads()
    count = 1 if nodes < FEW_NODES else before
    numba.set_num_threads(count)
    try:
        yield count
    finally:
        numba.set_num_threads(before)
