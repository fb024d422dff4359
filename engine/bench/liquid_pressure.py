"""Pressure of liquid: seconds to set up and solve a system with a free surface against its cells, and those of a peer."""

from collections.abc import Iterator, Sequence
from time import perf_counter

import numpy as np

from engine.arrays import Floats
from engine.bench.suite import Measurement, Note, benchmark, median_seconds
from engine.linalg.multigrid import Multigrid, Solved, multigrid, solve
from engine.linalg.seven_point import SevenPoint
from engine.validate.liquid_projection import NEVER, free_surface

TOLERANCE, MOST = 1e-6, 100
REPEATS = 3
PEER = "pyamg smoothed aggregation"


@benchmark("liquid-pressure", summary="set-up and solution of a pressure system with a free surface to 1e-6")
def liquid_pressure() -> Iterator[Measurement | Note]:
    """Boxes of 64^3, 128^3 and 192^3 cells, about half of them liquid."""
    yield from measurements((64, 128, 192))


def measurements(sizes: Sequence[int]) -> Iterator[Measurement | Note]:
    """Yield a row for every number of cells along an edge of the box."""
    try:
        import pyamg  # noqa: F401
    except ImportError:
        yield Note("without pyamg, which is not installed")
        yield from (measured(size, False) for size in sizes)
    else:
        yield from (measured(size, True) for size in sizes)


def measured(size: int, with_peer: bool) -> Measurement:
    """Return times of a box of `size`^3; the peer solves to our residual in the 2-norm, which is what it measures."""
    system = free_surface(size)
    load = np.random.default_rng(size).normal(size=len(system.place))
    p = np.empty_like(load)
    levels: list[Multigrid] = []
    found: list[Solved] = []

    def set_up() -> None:
        levels[:] = [multigrid(system, NEVER)]

    def solution() -> None:
        p[:] = 0.0
        found[:] = [solve(levels[0], load, p, TOLERANCE, MOST)]

    set_up_seconds, solve_seconds = median_seconds(set_up, REPEATS), median_seconds(solution, REPEATS)
    details = {"iterations": float(found[0].iterations), "set_up_s": set_up_seconds,
               "bytes_per_cell": held_bytes(levels[0]) / len(load)}
    peer_seconds = None
    if with_peer:
        peer_seconds, details["peer_iterations"] = of_peer(system, load, p)
    return Measurement(
        "free surface", len(load), set_up_seconds + solve_seconds, "cells", error=found[0].residual,
        peer=PEER if with_peer else None, peer_seconds=peer_seconds, details=details,
    )


def held_bytes(m: Multigrid) -> int:
    """Return the bytes of the system, of all that its levels add, and of the four vectors of an iteration."""
    vectors = 4 * m.system.diagonal.nbytes
    systems = sum(array.nbytes for system in (m.system, *(level.system for level in m.levels[1:])) for array in system)
    added = sum(array.nbytes for level in m.levels for array in (*level.blocks, level.parent, level.load, level.p))
    return vectors + systems + added + m.inverse.nbytes


def of_peer(system: SevenPoint, load: Floats, p: Floats) -> tuple[float, float]:
    """Return the seconds and iterations of the peer for the set-up and for a solution as good as p."""
    import pyamg
    from scipy.sparse import coo_array

    rows = np.arange(len(load))
    i, a = np.nonzero(system.coupling)
    j, value = system.beside[i, 2 * a + 1], -system.coupling[i, a]
    matrix = coo_array((np.concatenate([system.diagonal, value, value]),
                        (np.concatenate([rows, i, j]), np.concatenate([rows, j, i]))), dtype=np.float64).tocsr()
    residual = float(np.linalg.norm(load - matrix @ p) / np.linalg.norm(load))
    residuals: list[float] = []
    began = perf_counter()  # once: nothing of it is compiled here, and it takes minutes at the largest size
    solver = pyamg.smoothed_aggregation_solver(matrix)
    solver.solve(load, tol=residual, accel="cg", maxiter=MOST, residuals=residuals)
    return perf_counter() - began, len(residuals) - 1.0
