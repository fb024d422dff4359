"""Multigrid for seven-point systems: conjugate gradients preconditioned by one V-cycle, the same to the bit on any threads.

A coarse cell is made of up to 2 x 2 x 2 cells that have couplings; p is constant in it, so that the coarse matrix again has
seven points, and sums of conductances as its couplings. These are twice those of a grid of double spacing, where four faces
conduct over twice the distance; halved, they make coarse corrections of the right size (Braess 1995).

Iterations to 1e-8 on the domains of `liq-projection` at 32^3, 64^3, 128^3: 9, 9, 9 with two sweeps before and after; with one
sweep 16, 16, 18, and 13, 13, 14 in a W-cycle; with two sweeps and sums that are not halved 17, 24, 33. With one sweep a solution
takes a quarter longer, and the W-cycle saves nothing.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numba
import numpy as np
from numba import njit, prange

from engine.arrays import Floats, Ints
from engine.linalg.cell_blocks import EDGE_BITS, Blocks, blocks_of, key_of
from engine.linalg.conjugate_gradient import advance, dot, largest, turn
from engine.linalg.sealed import Sealed, sealed_components
from engine.linalg.seven_point import ROUND_OFF, Indices, SevenPoint, coupled, flow_in

SWEEPS = 2
HALF = 0.5
BOTTOM = 96  # cells of which the inverse is kept: found in less than a millisecond
RIDGE = 1e-9  # of the diagonal is added there: it is singular where a component is sealed
FEW = 8000  # cells for which threads take longer to start than to work


class Level(NamedTuple):
    """A system, and how its cells make those of the next level."""

    system: SevenPoint
    blocks: Blocks
    parent: Indices  # coarse cell of each cell, -1 for cells without couplings: a sweep solves these, shape [n]
    load: Floats  # room for those of the next level
    p: Floats


class Multigrid(NamedTuple):
    """The levels of a system, from itself down, and the inverse of the last one's matrix."""

    system: SevenPoint
    levels: list[Level]
    inverse: Floats
    sealed: Sealed


class Solved(NamedTuple):
    """What became of a solution."""

    iterations: int
    residual: float  # largest component, over that of the load


def multigrid(system: SevenPoint, period: Ints) -> Multigrid:
    """Return the levels of a system whose space repeats after `period` [3] cells, 0 where it does not."""
    levels, coarse = [], system
    while len(coarse.place) > BOTTOM:
        fine, blocks = coarse, blocks_of(coarse.place, period)
        coarse, parent = _coarser(fine, blocks)
        levels.append(Level(fine, blocks, parent, np.empty(len(coarse.place)), np.empty(len(coarse.place))))
        period = (period + 1) // 2
    return Multigrid(system, levels, _inverse(coarse), sealed_components(system))


def solve(m: Multigrid, load: Floats, p: Floats, tolerance: float, most: int) -> Solved:
    """Solve for `load` [n] from the guess in `p` [n], which is overwritten, until the relative residual is `tolerance`.

    It is measured by its largest component. The load loses its mean in every sealed component, and so does p. Ends without
    success after `most` iterations, which the residual tells.
    """
    with _threads(len(p)):
        r = load.copy()
        m.sealed.remove_mean(r)
        scale = largest(r[:, None]) if len(r) else 0.0
        if scale == 0.0:
            p[:] = 0.0
            return Solved(0, 0.0)
        q, z = np.empty_like(r), np.empty_like(r)
        m.system.multiply(p, q)
        r -= q
        iterations, residual = 0, largest(r[:, None]) / scale
        d, rho = np.zeros_like(r), np.inf
        while residual > tolerance and iterations < most:
            iterations += 1
            _cycle(m, 0, r, z)
            m.sealed.remove_mean(z)  # the bottom, singular but for a ridge, makes much of round-off there
            before, rho = rho, dot(r[:, None], z[:, None])
            turn(rho / before, z[:, None], d[:, None])
            m.system.multiply(d, q)
            advance(rho / dot(d[:, None], q[:, None]), d[:, None], q[:, None], p[:, None], r[:, None])
            residual = largest(r[:, None]) / scale
        m.sealed.remove_mean(p)
    return Solved(iterations, residual)


def _cycle(m: Multigrid, depth: int, load: Floats, p: Floats) -> None:
    """Write an approximate solution into p: a symmetric function of the load, as conjugate gradients need it."""
    if depth == len(m.levels):
        _apply(m.inverse, load, p)
        return
    system, blocks, parent, coarse_load, coarse_p = m.levels[depth]
    order, start, colour = blocks
    colours = [(colour[c], colour[c + 1]) for c in range(len(colour) - 1)]
    matrix = system.beside, system.coupling, system.diagonal
    with _threads(len(p)):
        p[:] = 0.0
        for first, last in SWEEPS * colours:
            _relax(order, start, first, last, *matrix, load, p)
        _restrict(order, start, *matrix, parent, load, p, coarse_load)
        _cycle(m, depth + 1, coarse_load, coarse_p)
        _prolong(parent, coarse_p, p)
        for first, last in SWEEPS * colours[::-1]:
            _relax_backward(order, start, first, last, *matrix, load, p)


@contextmanager
def _threads(cells: int) -> Iterator[None]:
    """Let kernels run on one thread inside where there are few cells."""
    before = numba.get_num_threads()
    numba.set_num_threads(1 if cells < FEW else before)
    try:
        yield
    finally:
        numba.set_num_threads(before)


def _coarser(system: SevenPoint, blocks: Blocks) -> tuple[SevenPoint, Indices]:
    """Return the system of the coarse cells, and the coarse cell of each cell.

    Eight blocks make a coarse one: taken in that order, coarse cells of a block stand together as well.
    """
    order, start, _ = blocks
    block = system.place[order[start[:-1]]].astype(np.int64) >> EDGE_BITS
    parent, place = _parents(*system, order, start, np.argsort(key_of(block)))
    beside = np.full((len(place), 6), -1, np.int32)
    coupling, diagonal = np.zeros((len(place), 3)), np.zeros(len(place))
    _sum_up(order, start, system.beside, system.coupling, system.diagonal, parent, beside, coupling, diagonal)
    return SevenPoint(place, beside, coupling, diagonal), parent


def _inverse(system: SevenPoint) -> Floats:
    rows = np.arange(len(system.place))
    matrix = np.diag(np.where(system.diagonal > 0.0, (1.0 + RIDGE) * system.diagonal, 1.0))
    for a in range(3):
        i = rows[system.beside[:, 2 * a + 1] >= 0]
        j = system.beside[i, 2 * a + 1]
        np.subtract.at(matrix, (i, j), system.coupling[i, a])  # space of two cells has two faces between them
        np.subtract.at(matrix, (j, i), system.coupling[i, a])
    inverse = np.linalg.inv(matrix)
    return 0.5 * (inverse + inverse.T)


@njit(cache=True)
def _parents(place, beside, coupling, diagonal, order, start, sequence):
    """Number the coarse cells block by block; cells of one of them are in the same block."""
    parent = np.full(len(place), -1, np.int32)
    coarse = np.empty_like(place)
    number = np.empty(8, np.int32)
    end = 0
    for b in sequence:
        number[:] = -1
        for i in order[start[b] : start[b + 1]]:
            if coupled(i, beside, coupling) > 0.0:
                octant = (place[i, 0] >> 1 & 1) | (place[i, 1] >> 1 & 1) << 1 | (place[i, 2] >> 1 & 1) << 2
                if number[octant] < 0:
                    number[octant] = end
                    coarse[end] = place[i] >> 1
                    end += 1
                parent[i] = number[octant]
    return parent, coarse[:end].copy()


@njit(cache=True, parallel=True)
def _sum_up(order, start, beside, coupling, diagonal, parent, coarse_beside, coarse_coupling, coarse_diagonal):
    for b in prange(len(start) - 1):
        for i in order[start[b] : start[b + 1]]:
            c = parent[i]
            if c < 0:
                continue
            for d in range(6):
                j, a = beside[i, d], d // 2
                if j < 0 or parent[j] == c:
                    continue
                conductance = coupling[i, a] if d % 2 == 1 else coupling[j, a]
                if conductance > 0.0:
                    coarse_beside[c, d] = parent[j]
                    coarse_diagonal[c] += HALF * conductance
                    if d % 2 == 1:
                        coarse_coupling[c, a] += HALF * conductance
            excess = diagonal[i] - coupled(i, beside, coupling)
            if excess > ROUND_OFF * diagonal[i]:  # or else sealed components would seem not to be
                coarse_diagonal[c] += HALF * excess


@njit(cache=True, parallel=True)
def _relax(order, start, first, last, beside, coupling, diagonal, load, p):
    """Solve the rows of blocks of one colour one after the other."""
    for b in prange(first, last):
        for k in range(start[b], start[b + 1]):
            i = order[k]
            if diagonal[i] > 0.0:
                p[i] = (load[i] + flow_in(i, beside, coupling, p)) / diagonal[i]


@njit(cache=True, parallel=True)
def _relax_backward(order, start, first, last, beside, coupling, diagonal, load, p):
    for b in prange(first, last):
        for k in range(start[b + 1] - 1, start[b] - 1, -1):
            i = order[k]
            if diagonal[i] > 0.0:
                p[i] = (load[i] + flow_in(i, beside, coupling, p)) / diagonal[i]


@njit(cache=True, parallel=True)
def _restrict(order, start, beside, coupling, diagonal, parent, load, p, coarse_load):
    """Sum up the residuals of the cells of each coarse cell."""
    for b in prange(len(start) - 1):
        for i in order[start[b] : start[b + 1]]:
            if parent[i] >= 0:
                coarse_load[parent[i]] = 0.0
        for i in order[start[b] : start[b + 1]]:
            if parent[i] >= 0:
                coarse_load[parent[i]] += load[i] - diagonal[i] * p[i] + flow_in(i, beside, coupling, p)


@njit(cache=True, parallel=True)
def _prolong(parent, coarse_p, p):
    for i in prange(len(p)):
        if parent[i] >= 0:
            p[i] += coarse_p[parent[i]]


@njit(cache=True)
def _apply(matrix, x, out):
    for i in range(len(x)):
        total = 0.0
        for j in range(len(x)):
            total += matrix[i, j] * x[j]
        out[i] = total
