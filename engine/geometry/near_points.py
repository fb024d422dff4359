"""Which points are near each other, in space that may repeat: a hash of the cells that they are in.

Points are put into buckets by a counting sort, those of cells next to each other along x into buckets next to each other. Each
point looks through the 27 cells about it.
"""

import numpy as np
from numba import njit, prange

from engine.arrays import Flags, Floats, Ints
from engine.geometry.frames import dot

SLACK = 1e-9  # of the reaches, that a cell is wider: what is lost in rounding to cells
ROW, LAYER = 0x9E3779B1, 0x85EBCA77  # buckets from a row of cells to the next and from a layer to the next, odd and large


def near_points(x: Floats, asked: Flags, reach: Floats, period: Floats) -> tuple[Ints, Ints]:
    """Return the other points that each meets within both their reaches: those of point i are near[start[i]:start[i+1]].

    Of x [P, 3] [m] with a `reach` [P] [m] those have any that are `asked`, shape [P]. Space repeats after `period` [3] [m],
    0 along axes where it does not. Shapes of `start`, `near`: [P+1], [n]. The order of a point's neighbours is the same on any
    number of threads. The search is quicker where points that are near each other are so in x.

    Raises ValueError where space repeats after less than three times the two largest reaches.
    """
    if not len(x):
        return np.zeros(1, np.int64), np.zeros(0, np.int64)
    widest = (1.0 + SLACK) * 2.0 * reach.max()
    if ((period > 0.0) & (period < 3.0 * widest)).any():
        raise ValueError(f"space repeats after less than three times the {widest:g} m that points reach")
    width = np.full(3, widest)
    cells = np.floor(period / width).astype(np.int64)
    width = np.where(cells > 0, period / np.maximum(cells, 1), width)
    table = 1 << int(np.ceil(np.log2(max(2 * len(x), 2))))
    cell = _cells(x, width, cells)
    first, point = _sort(cell, table)
    place, cell, reach = x[point], cell[point], reach[point]
    start = np.zeros(len(x) + 1, np.int64)
    count = _search(place, cell, cells, first, point, asked, reach, period, start, np.empty(0, np.int64))
    np.cumsum(count, out=start[1:])
    near = np.empty(start[-1], np.int64)
    _search(place, cell, cells, first, point, count > 0, reach, period, start, near)
    return start, near


@njit(cache=True)
def apart(x, i, j, period):
    """The shortest way [m] from point j of x [P, 3] to point i, as three numbers, where space repeats after `period` [3] [m]."""
    return (
        _shortest(x[i, 0] - x[j, 0], period[0]), _shortest(x[i, 1] - x[j, 1], period[1]), _shortest(x[i, 2] - x[j, 2], period[2]),
    )


@njit(cache=True)
def _shortest(difference, period):
    return difference - period * np.rint(difference / period) if period > 0.0 else difference


@njit(cache=True, parallel=True)
def _cells(x, width, cells):
    """The cell of each point, counted round where space repeats, shape [P, 3]."""
    cell = np.empty(x.shape, np.int64)
    for i in prange(len(x)):
        for k in range(3):
            number = np.int64(np.floor(x[i, k] / width[k]))
            cell[i, k] = number % cells[k] if cells[k] > 0 else number
    return cell


@njit(cache=True)
def _bucket(i, j, k, table):
    return (i + ROW * j + LAYER * k) & (table - 1)


@njit(cache=True)
def _sort(cell, table):
    """Sort points into buckets by cell: bucket b has point[first[b]:first[b+1]], in ascending order."""
    first, point = np.zeros(table + 1, np.int64), np.empty(len(cell), np.int64)
    for p in range(len(cell)):
        first[_bucket(cell[p, 0], cell[p, 1], cell[p, 2], table)] += 1
    for b in range(table):
        first[b + 1] += first[b]
    for p in range(len(cell) - 1, -1, -1):
        b = _bucket(cell[p, 0], cell[p, 1], cell[p, 2], table)
        first[b] -= 1
        point[first[b]] = p
    return first, point


@njit(cache=True, parallel=True)
def _search(place, cell, cells, first, point, asked, reach, period, start, near):
    """Count the neighbours of each point, shape [P], and write them where `near` has room, those of point i from start[i] on.

    Places [P, 3], cells [P, 3] and reaches [P] are in the order of `point`, by buckets.
    """
    count = np.zeros(len(point), np.int64)
    for e in prange(len(point)):
        if asked[point[e]]:
            count[point[e]] = _about(e, place, cell, cells, first, point, reach, period, start[point[e]], near)
    return count


@njit(cache=True)
def _about(e, place, cell, cells, first, point, reach, period, start, near):
    """Count the neighbours of the e-th point of the buckets, and write them."""
    count = 0
    for dk in range(-1, 2):
        k = _around(cell[e, 2] + dk, cells[2])
        for dj in range(-1, 2):
            j = _around(cell[e, 1] + dj, cells[1])
            for di in range(-1, 2):
                i = _around(cell[e, 0] + di, cells[0])
                b = _bucket(i, j, k, len(first) - 1)
                for f in range(first[b], first[b + 1]):  # others of the bucket are looked at in their own cells
                    r = apart(place, e, f, period)
                    here = cell[f, 0] == i and cell[f, 1] == j and cell[f, 2] == k
                    if dot(r, r) <= (reach[e] + reach[f]) ** 2 and here and f != e:
                        if len(near) > 0:
                            near[start + count] = point[f]
                        count += 1
    return count


@njit(cache=True)
def _around(number, cells):
    return number % cells if cells > 0 else number
