"""Memory of liquids: what a step holds at most beyond the program, each block in a process that has seen no other."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from statistics import median

import numba
from numba.core import event

from engine.bench.liquid import STAGES, TIMED, WARM_UP, Block, bytes_of
from engine.bench.suite import Measurement, benchmark
from engine.run.memory import ProgramMemory, give_back_large_arrays, memory_peak
from engine.run.threads import set_threads

SMALL = 10_000  # particles of a block whose steps fill the cache of kernels


@benchmark("liquid-memory", summary="largest memory of steps of water and milk cream, beyond the program's, bytes a particle")
def liquid_memory() -> Iterator[Measurement]:
    """0.1 to 3 million particles, each block in a process of its own."""
    yield from measurements((100_000, 300_000, 1_000_000, 3_000_000))


def measurements(counts: Sequence[int]) -> Iterator[Measurement]:
    """Yield a row for blocks of about so many particles, of both materials."""
    for material in STAGES:
        for count in (SMALL, *counts):
            with ProcessPoolExecutor(1, get_context("spawn")) as alone:
                row = alone.submit(of_block, material, count, numba.get_num_threads()).result()
            if count != SMALL:
                yield row


def of_block(material: str, particles: int, threads: int) -> Measurement:
    """Return a block's row. To be called in a process that has done nothing yet: its peak is that of all that it did."""
    set_threads(threads)
    give_back_large_arrays()
    program = ProgramMemory()
    with event.install_listener(ProgramMemory.EVENT, program):
        block = Block(material, particles)
        block.take(WARM_UP)
        seconds = [spent for spent, _ in block.take(TIMED)]
    count = len(block.state.x)
    return Measurement(f"{material}, step", size=count, seconds=median(seconds), unit="particles", details={
        "state_bytes": bytes_of(block.state) / count,
        "grid_bytes": bytes_of((block.stepper.flow, block.stepper.wet)) / count,
        "resident_bytes": max(memory_peak() - program.bytes, 0) / count,
    })
