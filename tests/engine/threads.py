"""The same computation on several numbers of threads."""

from collections.abc import Callable
from typing import TypeVar

import numba
import pytest

Found = TypeVar("Found")


def on_one_and_two_threads(compute: Callable[[], Found]) -> tuple[Found, Found]:
    """Return what is computed on one thread and on two; skips the test where there is no second one."""
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("no second thread")
    now, found = numba.get_num_threads(), []
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            found.append(compute())
    finally:
        numba.set_num_threads(now)
    return found[0], found[1]
