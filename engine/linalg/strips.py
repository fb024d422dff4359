"""Strips: an order of the rows of a sparse symmetric matrix in which much can be done at once, on any number of threads.

The levels of a breadth-first search over the graph of the matrix touch only the level before and the one behind them. Runs
of successive levels are strips; every other strip is red, the others are black, and strips of one colour do not touch. With
all red rows numbered before all black ones, elimination can work on all red strips at the same time and then on all black
ones, and does exactly what it would do row after row. A strip has two levels at least: then no row touches both of its
neighbours, and what a strip of one colour writes to the other colour's rows is written by it alone.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit, prange

from engine.arrays import Ints

MOST = 16  # strips; half of them are the threads that can be of use
FEWEST_ROWS = 64  # in a strip


@dataclass(frozen=True)
class Strips:
    """Strip s has the rows start[s] ... start[s+1]-1; the first `reds` strips are red."""

    start: Ints  # shape [S+1]
    reds: int


def strips_of(start: Ints, column: Ints) -> tuple[Ints, Strips]:
    """Return the order of the rows of a pattern in strips, shape [n], and the strips in that order."""
    rows = len(start) - 1
    visited, level_start = _levels(start, column)
    levels = len(level_start) - 1
    count = max(min(MOST, levels // 2, rows // FEWEST_ROWS), 1)
    # each strip ends at the level that is nearest to its share of the rows and leaves two levels to every other strip
    ends = [0]
    for strip in range(1, count + 1):
        at = int(np.searchsorted(level_start, rows * strip / count))
        ends.append(min(max(at, ends[-1] + 2), levels - 2 * (count - strip)) if strip < count else levels)
    pieces = [visited[level_start[a]:level_start[b]] for a, b in pairwise(ends)]
    coloured = pieces[::2] + pieces[1::2]
    sizes = [len(piece) for piece in coloured]
    return np.concatenate(coloured), Strips(np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64), (count + 1) // 2)


@njit(cache=True)
def _levels(start, column):
    """Rows level after level, and where the levels start; what is not connected to row 0 follows on new levels."""
    rows = len(start) - 1
    visited = np.empty(rows, np.int64)
    seen = np.zeros(rows, np.bool_)
    level_start = np.empty(rows + 1, np.int64)
    levels = end = root = 0
    while end < rows:
        while seen[root]:
            root += 1
        first = end
        visited[end] = root
        seen[root] = True
        end += 1
        while first < end:
            level_start[levels] = first
            levels += 1
            last = end
            for a in range(first, last):
                for k in range(start[visited[a]], start[visited[a] + 1]):
                    j = column[k]
                    if not seen[j]:
                        seen[j] = True
                        visited[end] = j
                        end += 1
            first = last
    level_start[levels] = rows
    return visited, level_start[: levels + 1].copy()


@njit(cache=True, parallel=True)
def permuted(start, column, order, number):
    """Return start, column and diagonal of a pattern whose row order[i] becomes row i = number[order[i]]."""
    rows = len(order)
    new_start = np.zeros(rows + 1, np.int64)
    for i in range(rows):
        new_start[i + 1] = new_start[i] + start[order[i] + 1] - start[order[i]]
    new_column = np.empty_like(column)
    diagonal = np.empty(rows, np.int64)
    for i in prange(rows):
        first = new_start[i]
        end = first
        for k in range(start[order[i]], start[order[i] + 1]):
            value = number[column[k]]
            at = end
            while at > first and new_column[at - 1] > value:
                new_column[at] = new_column[at - 1]
                at -= 1
            new_column[at] = value
            end += 1
        for k in range(first, end):
            if new_column[k] == i:
                diagonal[i] = k
    return new_start, new_column, diagonal
