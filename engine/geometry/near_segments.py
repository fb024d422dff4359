"""Which segments of many come near each other: a hash of the cells that pieces of them pass.

Long thin segments fill their boxes badly, so they are cut into pieces about as long as a cell. A pair of pieces is looked at in
one cell only, the first that both touch, and a pair of segments is found by each of its pieces that are near: once in the end.
"""

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints

FINENESS = 3.0  # pieces of a segment of mean length
WIDE = 1.5  # of the widest segment and its motion, at least, that a cell is wide
MOST_PIECES = 64  # of one segment
HASH_X, HASH_Y, HASH_Z = 73856093, 19349663, 83492791  # Teschner et al. 2003, sec. 4.1


def near_pairs(x: Floats, motion: Floats, segment: Ints, reach: Floats) -> Ints:
    """Return the pairs a < b of segments, by their places in `segment`, that may come nearer than both reaches, shape [n, 2].

    A segment runs from vertex segment[i] of x [V, 3] to the next one, widened by reach[i] [m], while vertices go along `motion`
    [V, 3] [m]. Pairs come in ascending order. There may be pairs that do not come near, but none is missing.
    """
    if len(segment) < 2:
        return np.zeros((0, 2), np.int64)
    length = np.linalg.norm(x[segment + 1] - x[segment], axis=1)
    moved = np.abs(motion - motion.mean(axis=0)).max(axis=1, initial=0.0)
    widest = 2.0 * reach.max() + max(moved[segment].max(), moved[segment + 1].max())
    width = max(length.mean() / FINENESS, WIDE * widest)
    pieces = np.clip(np.ceil(length / width), 1, MOST_PIECES).astype(np.int64)
    owner = np.repeat(np.arange(len(segment)), pieces)
    low, high = _boxes(x, motion - motion.mean(axis=0), segment, reach, pieces, owner)
    corner = np.floor(low / width).astype(np.int64)
    last = np.floor(high / width).astype(np.int64)
    cells = np.prod(last - corner + 1, axis=1)
    table = 1 << int(np.ceil(np.log2(max(2 * int(cells.sum()), 2))))
    start, entry = _fill(corner, last, int(cells.sum()), table)
    found = _pairs(start, entry, corner, last, low, high, owner)
    key = np.unique(found[:, 0] * len(segment) + found[:, 1])
    return np.column_stack([key // len(segment), key % len(segment)])


@njit(cache=True)
def _boxes(x, motion, segment, reach, pieces, owner):
    """Lowest and highest corner of what each piece passes, shape [P, 3] each."""
    low, high = np.empty((len(owner), 3)), np.empty((len(owner), 3))
    piece = 0
    for i in range(len(segment)):
        v = segment[i]
        for p in range(pieces[i]):
            s, t = p / pieces[i], (p + 1) / pieces[i]
            for k in range(3):
                first, second = (1 - s) * x[v, k] + s * x[v + 1, k], (1 - t) * x[v, k] + t * x[v + 1, k]
                first_end = first + (1 - s) * motion[v, k] + s * motion[v + 1, k]
                second_end = second + (1 - t) * motion[v, k] + t * motion[v + 1, k]
                low[piece, k] = min(first, second, first_end, second_end) - reach[i]
                high[piece, k] = max(first, second, first_end, second_end) + reach[i]
            piece += 1
    return low, high


@njit(cache=True)
def _bucket(i, j, k, table):
    return ((i * HASH_X) ^ (j * HASH_Y) ^ (k * HASH_Z)) & (table - 1)


@njit(cache=True)
def _fill(corner, last, entries, table):
    """Sort pieces into buckets by cell: bucket b has entry[start[b]:start[b+1]]."""
    start, entry = np.zeros(table + 1, np.int64), np.empty(entries, np.int64)
    for turn in range(2):
        for piece in range(len(corner) - 1, -1, -1):
            for i in range(corner[piece, 0], last[piece, 0] + 1):
                for j in range(corner[piece, 1], last[piece, 1] + 1):
                    for k in range(corner[piece, 2], last[piece, 2] + 1):
                        b = _bucket(i, j, k, table)
                        if turn == 0:
                            start[b + 1] += 1
                        else:
                            start[b + 1] -= 1
                            entry[start[b + 1]] = piece
        if turn == 0:
            for b in range(table):
                start[b + 1] += start[b]
    # each start has moved back to the one before it
    start[:-1] = start[1:]
    start[-1] = entries
    return start, entry


@njit(cache=True)
def _pairs(start, entry, corner, last, low, high, owner):
    """Pairs of segments with pieces whose boxes meet, shape [n, 2]; a pair comes up to as often as it has such pieces."""
    found, count = np.empty((1024, 2), np.int64), 0
    for b in range(len(start) - 1):
        for e in range(start[b], start[b + 1]):
            for f in range(e + 1, start[b + 1]):
                p, q = entry[e], entry[f]
                if owner[p] == owner[q] or not _meet(low[p], high[p], low[q], high[q]):
                    continue
                if _bucket(max(corner[p, 0], corner[q, 0]), max(corner[p, 1], corner[q, 1]), max(corner[p, 2], corner[q, 2]),
                           len(start) - 1) != b:
                    continue
                if count == len(found):
                    more = np.empty((2 * count, 2), np.int64)
                    more[:count] = found
                    found = more
                found[count, 0], found[count, 1] = min(owner[p], owner[q]), max(owner[p], owner[q])
                count += 1
    return found[:count]


@njit(cache=True)
def _meet(low, high, other_low, other_high):
    for k in range(3):
        if low[k] > other_high[k] or other_low[k] > high[k]:
            return False
    return True
