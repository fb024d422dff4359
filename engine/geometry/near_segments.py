"""Which segments of many come near each other: a hash of the cells that pieces of them pass.

Long thin segments fill their boxes badly, so they are cut into pieces about as long as a cell. A segment looks through the cells
of its pieces for later ones, and notes each once.
"""

import numpy as np
from numba import njit, prange

from engine.arrays import Floats, Ints

FINENESS = 3.0  # pieces of a segment of mean length
WIDE = 1.5  # of the widest segment and its motion, at least, that a cell is wide
MOST_PIECES = 64  # of one segment
PARTS = 16  # of the search; what it finds does not depend on them
ROOM = 16  # pairs of a segment that there is room for at first
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
    room = ROOM * len(segment) // PARTS + 1
    while True:
        found, count = np.empty((PARTS, room, 2), np.int64), np.empty(PARTS, np.int64)
        first = np.searchsorted(owner, np.arange(len(segment) + 1))
        _pairs(start, entry, corner, last, low, high, owner, first, found, count)
        if count.max() <= room:
            return np.concatenate([part[:number] for part, number in zip(found, count, strict=True)])
        room = int(count.max())


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


@njit(cache=True, parallel=True)
def _pairs(start, entry, corner, last, low, high, owner, first, found, count):
    """Write the pairs of segments with pieces whose boxes meet, in parts by their first segments, `found` [parts, room, 2].

    `count` [parts] is how many there are, of which those are written that have room. The pieces of segment s are first[s] ...
    first[s+1]-1.
    """
    table, segments = len(start) - 1, len(first) - 1
    for part in prange(len(found)):
        seen, near = np.full(segments, -1, np.int64), np.empty(segments, np.int64)
        count[part] = 0
        for s in range(part * segments // len(found), (part + 1) * segments // len(found)):
            number = 0
            for p in range(first[s], first[s + 1]):
                for i in range(corner[p, 0], last[p, 0] + 1):
                    for j in range(corner[p, 1], last[p, 1] + 1):
                        for k in range(corner[p, 2], last[p, 2] + 1):
                            b = _bucket(i, j, k, table)
                            for e in range(start[b + 1] - 1, start[b] - 1, -1):  # the last pieces of a bucket come last
                                q = entry[e]
                                other = owner[q]
                                if other <= s:
                                    break
                                if max(corner[p, 0], corner[q, 0]) != i or max(corner[p, 1], corner[q, 1]) != j:
                                    continue  # they are looked at in the first cell that both touch
                                if seen[other] != s and _meet(low[p], high[p], low[q], high[q]):
                                    seen[other] = s
                                    near[number] = other
                                    number += 1
            near[:number].sort()
            for n in range(number):
                if count[part] < found.shape[1]:
                    found[part, count[part], 0], found[part, count[part], 1] = s, near[n]
                count[part] += 1


@njit(cache=True)
def _meet(low, high, other_low, other_high):
    for k in range(3):
        if low[k] > other_high[k] or other_low[k] > high[k]:
            return False
    return True
