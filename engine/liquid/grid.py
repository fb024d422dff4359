"""The sparse grid: blocks of cells where there are particles, and around them, found anew from the particles in every step.

Space is cut into blocks of 4 x 4 x 4 cells. Those that hold particles and the 26 around each of them exist, in the order of
their coordinates; particles are sorted by them. So memory follows the liquid, whatever box it would take to hold it.

A cell has number 16 i + 4 j + k in its block. Fields at cells have shape [B, 64]; fields at faces [3, B, 64], where entry a is
about the faces whose normal is axis a, and every cell has the one on its lower side.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from engine.arrays import Floats, Ints
from engine.liquid.model import LiquidModel

SIDE = 4  # cells along a block
CELLS = SIDE**3
COLOURS = 8  # of blocks: the particles of two of one colour reach no cell in common
LIMIT = 1 << 20  # coordinates of blocks lie between -LIMIT and LIMIT
_EMPTY = -1

Indices = NDArray[np.int32]


class Grid(NamedTuple):
    """B blocks, of which those with particles are listed by colour."""

    spacing: float  # of cells [m]
    origin: Floats  # lower corner of the cell (0, 0, 0) [m], shape [3]
    place: Indices  # coordinates of blocks, shape [B, 3]
    near: Indices  # block at each of the offsets (-1, -1, -1), (-1, -1, 0), ... (1, 1, 1), -1 where none is, shape [B, 27]
    start: Ints  # block b has the particles start[b] ... start[b+1]-1, shape [B+1]
    turn: Ints  # blocks that have particles, colour by colour
    turns: Ints  # colour c has turn[turns[c]:turns[c+1]], shape [9]

    def faces(self) -> Floats:
        """Return zeros for all faces."""
        return np.zeros((3, len(self.place), CELLS))

    def cells(self) -> Floats:
        """Return zeros for all cells."""
        return np.zeros((len(self.place), CELLS))


def sorted_grid(model: LiquidModel, x: Floats) -> tuple[Grid, Indices]:
    """Return the grid for particles at x [P, 3] [m], and the order [P] in which they have to be taken to be sorted by blocks.

    Places lie within the period of space along the axes that have one.
    """
    period = (model.period // SIDE).astype(np.int64)
    keys, rank = _occupied(x, model.origin, model.spacing)
    place, near, slot = _with_neighbours(keys, period)
    start, order = _counted(rank, slot, len(place))
    colour = _colours(place)
    holds = np.flatnonzero(np.diff(start))
    turn = holds[np.argsort(colour[holds], kind="stable")]
    turns = np.searchsorted(colour[turn], np.arange(COLOURS + 1))
    return Grid(model.spacing, model.origin, place, near, start, turn, turns), order


@njit(cache=True)
def key_of(a, b, c):
    """Return the number of a block, ascending with its coordinates."""
    return ((a + LIMIT) << 42) | ((b + LIMIT) << 21) | (c + LIMIT)


@njit(cache=True)
def _spread(key, mask):
    """Where in a table a key is looked for first."""
    key ^= key >> 31
    key *= 7046029254386353131
    key ^= key >> 29
    return key & mask


@njit(cache=True)
def _slot_of(table, key):
    """Index of the table's entry that holds the key or could."""
    mask = len(table) - 1
    at = _spread(key, mask)
    while table[at] != _EMPTY and table[at] != key:
        at = (at + 1) & mask
    return at


@njit(cache=True)
def _enter(table, value, key, count):
    """Give the key the next number where it has none; returns the number and how many have one."""
    at = _slot_of(table, key)
    if table[at] == _EMPTY:
        table[at], value[at] = key, count
        count += 1
    return value[at], count


@njit(cache=True)
def _grown(table, value):
    """A table twice as long with the same entries."""
    longer, values = np.full(2 * len(table), _EMPTY, np.int64), np.empty(2 * len(table), np.int32)
    for at in range(len(table)):
        if table[at] != _EMPTY:
            there = _slot_of(longer, table[at])
            longer[there], values[there] = table[at], value[at]
    return longer, values


@njit(cache=True)
def _occupied(x, origin, spacing):
    """Keys of the blocks that hold particles as they are first met, and which of them each particle is in."""
    table, value = np.full(1024, _EMPTY, np.int64), np.empty(1024, np.int32)
    rank, count, last, last_rank = np.empty(len(x), np.int32), 0, -2, 0
    width = SIDE * spacing
    for p in range(len(x)):
        key = key_of(
            np.int64(np.floor((x[p, 0] - origin[0]) / width)),
            np.int64(np.floor((x[p, 1] - origin[1]) / width)),
            np.int64(np.floor((x[p, 2] - origin[2]) / width)),
        )
        if key != last:  # mostly sorted from the step before
            last = key
            last_rank, count = _enter(table, value, key, count)
            if 2 * count > len(table):
                table, value = _grown(table, value)
        rank[p] = last_rank
    keys = np.empty(count, np.int64)
    for at in range(len(table)):
        if table[at] != _EMPTY:
            keys[value[at]] = table[at]
    return keys, rank


@njit(cache=True)
def _wrapped(coordinate, period):
    return coordinate % period if period > 0 else coordinate


@njit(cache=True)
def _with_neighbours(occupied, period):
    """Coordinates and neighbours of all blocks in order, and the index of those that are occupied."""
    length = 1024
    while length < 64 * len(occupied):
        length *= 2
    table, value, count = np.full(length, _EMPTY, np.int64), np.empty(length, np.int32), 0
    for key in occupied:
        a, b, c = (key >> 42) - LIMIT, ((key >> 21) & (2 * LIMIT - 1)) - LIMIT, (key & (2 * LIMIT - 1)) - LIMIT
        for i in range(-1, 2):
            for j in range(-1, 2):
                for k in range(-1, 2):
                    beside = key_of(_wrapped(a + i, period[0]), _wrapped(b + j, period[1]), _wrapped(c + k, period[2]))
                    _, count = _enter(table, value, beside, count)
    keys = np.sort(table[table != _EMPTY])
    for n in range(count):
        value[_slot_of(table, keys[n])] = n
    place, near = np.empty((count, 3), np.int32), np.full((count, 27), -1, np.int32)
    for n in range(count):
        key = keys[n]
        place[n, 0], place[n, 1] = (key >> 42) - LIMIT, ((key >> 21) & (2 * LIMIT - 1)) - LIMIT
        place[n, 2] = (key & (2 * LIMIT - 1)) - LIMIT
        for m in range(27):
            beside = key_of(
                _wrapped(np.int64(place[n, 0] + m // 9 - 1), period[0]),
                _wrapped(np.int64(place[n, 1] + m // 3 % 3 - 1), period[1]),
                _wrapped(np.int64(place[n, 2] + m % 3 - 1), period[2]),
            )
            at = _slot_of(table, beside)
            if table[at] != _EMPTY:
                near[n, m] = value[at]
    slot = np.empty(len(occupied), np.int32)
    for n in range(len(occupied)):
        slot[n] = value[_slot_of(table, occupied[n])]
    return place, near, slot


@njit(cache=True)
def _counted(rank, slot, blocks):
    """Counting sort of particles by blocks, in which those of one block keep their order."""
    start = np.zeros(blocks + 1, np.int64)
    for p in range(len(rank)):
        start[slot[rank[p]] + 1] += 1
    for b in range(blocks):
        start[b + 1] += start[b]
    at, order = start[:-1].copy(), np.empty(len(rank), np.int32)
    for p in range(len(rank)):
        b = slot[rank[p]]
        order[at[b]] = p
        at[b] += 1
    return start, order


@njit(cache=True)
def _colours(place):
    colour = np.empty(len(place), np.int64)
    for b in range(len(place)):
        colour[b] = 4 * (place[b, 0] & 1) + 2 * (place[b, 1] & 1) + (place[b, 2] & 1)
    return colour


@njit(cache=True, parallel=True)
def taken(values, order):
    """Return rows of `values` [P, ...] in the order given [P]."""
    flat = values.reshape(len(values), -1)
    result = np.empty_like(flat)
    for p in prange(len(order)):
        for k in range(flat.shape[1]):
            result[p, k] = flat[order[p], k]
    return result.reshape(values.shape)


@njit(cache=True)
def beside(near, cell, axis, step):
    """Return block and number of the cell one before (step -1) or behind (1) along an axis; the block is -1 where none is.

    `near` [27] are the neighbours of the block that `cell` is in.
    """
    stride = 16 if axis == 0 else 4 if axis == 1 else 1
    apart = 9 if axis == 0 else 3 if axis == 1 else 1
    at = cell // stride % SIDE + step
    if at < 0:
        return near[13 - apart], cell + (SIDE - 1) * stride
    if at >= SIDE:
        return near[13 + apart], cell - (SIDE - 1) * stride
    return near[13], cell + step * stride


@njit(cache=True, parallel=True)
def face_means(grid, cells):
    """Return the means [3, B, 64] of the two cells [B, 64] beside each face, of the one that there is at the border."""
    means = np.empty((3, len(cells), CELLS))
    for b in prange(len(cells)):
        for c in range(CELLS):
            for axis in range(3):
                other, cell = beside(grid.near[b], c, axis, -1)
                means[axis, b, c] = 0.5 * (cells[b, c] + (cells[other, cell] if other >= 0 else cells[b, c]))
    return means


@njit(cache=True)
def centre_of(grid, b, c, axis, x):
    """Write the centre x [3] [m] of cell c of block b, or with an `axis` below 3 that of its lower face across it."""
    x[0] = grid.origin[0] + grid.spacing * (SIDE * grid.place[b, 0] + c // 16 + 0.5)
    x[1] = grid.origin[1] + grid.spacing * (SIDE * grid.place[b, 1] + c // 4 % 4 + 0.5)
    x[2] = grid.origin[2] + grid.spacing * (SIDE * grid.place[b, 2] + c % 4 + 0.5)
    if axis < 3:
        x[axis] -= 0.5 * grid.spacing
