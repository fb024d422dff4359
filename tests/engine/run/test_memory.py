"""What memory is the program's: what it held at the beginning, and what kernels took."""

import sys

import numpy as np
import pytest
from numba import njit
from numba.core import event

from engine.run.memory import LARGE, ProgramMemory, give_back_large_arrays, memory_peak


@pytest.fixture
def held(monkeypatch):
    """The memory that the process is said to hold; set its only item."""
    held = [100]
    monkeypatch.setattr(ProgramMemory, "_held", lambda self: held[0])
    return held


def test_only_what_comes_while_the_compiler_is_locked_is_the_programs(held):
    program = ProgramMemory()
    with event.install_listener(ProgramMemory.EVENT, program):
        held[0] = 500  # arrays of the scene
        with event.trigger_event(ProgramMemory.EVENT):
            held[0] = 510
            with event.trigger_event(ProgramMemory.EVENT):  # a kernel that calls another
                held[0] = 530
        held[0] = 900
    assert program.bytes == 100 + 30


def test_numba_tells_of_every_kernel(held):
    @njit
    def doubled(values):
        held_now()
        return 2 * values

    @njit
    def held_now():
        return 0

    program = ProgramMemory()
    begun = []
    program.on_start = lambda _: begun.append(1)
    program.on_end = lambda _: None
    with event.install_listener(ProgramMemory.EVENT, program):
        doubled(np.ones(3))
        compiled = len(begun)
        doubled(np.ones(3))
    assert compiled > 0 and len(begun) == compiled


def test_a_process_holds_no_more_than_its_peak():
    assert 0 < ProgramMemory().bytes <= 1.05 * memory_peak()  # two counters of the system, each exact to some pages a thread


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="another allocator")
def test_large_arrays_go_back_to_the_system_even_among_others():
    give_back_large_arrays()
    freed = np.ones(3 * LARGE)  # by itself the allocator keeps what is smaller from now on
    del freed
    arrays = [np.ones(LARGE) for _ in range(8)]  # 8 LARGE bytes each
    before = ProgramMemory().bytes
    del arrays[::2]
    assert ProgramMemory().bytes <= before - 4 * 8 * LARGE * 0.9
