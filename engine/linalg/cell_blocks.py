"""Blocks of 4 x 4 x 4 cells of a sparse grid, coloured so that blocks of one colour do not touch.

A sweep of Gauss-Seidel takes one colour after the other, the blocks of a colour at once, and the cells of a block in order:
the even ones, then the odd ones. What stands together in memory is read once a sweep; red and black cells of the whole grid
would read it twice.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from engine.arrays import Ints
from engine.linalg.seven_point import Indices

EDGE_BITS = 2  # a block has 4 cells along an edge
PLACE_BITS = 20  # of a block's coordinate in its key


class Blocks(NamedTuple):
    """The n cells of a system, block by block."""

    order: Indices  # rows, shape [n]
    start: Ints  # block b has order[start[b]] ... order[start[b+1]-1], shape [B+1]
    colour: Ints  # colour c has the blocks colour[c] ... colour[c+1]-1, shape [C+1]


def blocks_of(place: Indices, period: Ints) -> Blocks:
    """Return the blocks of cells at `place` [n, 3] in space that repeats after `period` [3] cells, 0 where it does not.

    It is fast where the cells of a block follow each other; coordinates are below 2^21.
    """
    run = _runs(place)
    block = place[run[:-1]].astype(np.int64) >> EDGE_BITS
    around = (period + (1 << EDGE_BITS) - 1) >> EDGE_BITS
    odd = (around % 2 == 1) & (around > 1)  # two colours do not do on rings of so many blocks
    colours = 3 if odd.any() else 2
    colour = np.where(odd & (block == around - 1), 2, block & 1).sum(axis=1) % colours
    key = key_of(block)
    sequence = np.lexsort((key, colour))
    key, colour = key[sequence], colour[sequence]
    begins = np.flatnonzero(np.diff(key, prepend=-1) | np.diff(colour, prepend=-1))  # several runs may have one block
    order, start = _ordered(place, run, sequence, np.append(begins, len(sequence)))
    return Blocks(order, start, np.searchsorted(colour[begins], np.arange(colours + 1)))


def key_of(block: Ints) -> Ints:
    """Return a number for blocks at `block` [m, 3] that sorts them by cubes of two blocks an edge."""
    shifted = block + (1 << (PLACE_BITS - 1))
    cube, octant = shifted >> 1, (shifted & 1) @ np.array([1, 2, 4])
    return (((cube[:, 0] << PLACE_BITS | cube[:, 1]) << PLACE_BITS | cube[:, 2]) << 3) | octant


@njit(cache=True)
def _runs(place):
    """Where successive cells begin to be of another block, and the number of cells."""
    rows = len(place)
    first = np.empty(rows + 1, np.int64)
    runs = 0
    for i in range(rows):
        begins = i == 0
        for a in range(3):
            begins = begins or place[i, a] >> EDGE_BITS != place[i - 1, a] >> EDGE_BITS
        if begins:
            first[runs] = i
            runs += 1
    first[runs] = rows
    return first[: runs + 1].copy()


@njit(cache=True)
def _ordered(place, run, sequence, begins):
    order = np.empty(len(place), np.int32)
    start = np.zeros(len(begins), np.int64)
    end = 0
    for b in range(len(begins) - 1):
        for parity in range(2):
            for k in sequence[begins[b] : begins[b + 1]]:
                for i in range(run[k], run[k + 1]):
                    if (place[i, 0] + place[i, 1] + place[i, 2]) & 1 == parity:
                        order[end] = i
                        end += 1
        start[b + 1] = end
    return order, start
