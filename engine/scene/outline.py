"""Outlines of patches: what part of a grid of yarns lies within a polygon."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from engine.arrays import Flags, Floats, Ints

LEAST_END = 0.2  # of a spacing: what a yarn keeps beyond its last crossing, so that end and crossing stay two nodes


@dataclass(frozen=True)
class Pieces:
    """Parts of parallel lines, sorted by line and along it."""

    line: Ints  # the line of each piece, shape [n]
    low: Floats  # where the piece starts on its line [m], shape [n]
    high: Floats  # where it ends [m], shape [n]


def cut(outline: Floats, counts: tuple[int, int], spacings: tuple[float, float]) -> tuple[Flags, Pieces, Pieces]:
    """Cut a grid of warps (along y) and wefts (along x) to a polygon.

    `outline` [n, 2] is about the centre of the grid [m]; `counts` and `spacings` [m] are those of warps and wefts.
    Returns which crossings lie inside, shape [warps, wefts], and the pieces of warps and of wefts through them. A piece
    ends at the outline, but no more than half a spacing beyond its last crossing, and no less than `LEAST_END`.
    """
    corner = outline + np.multiply(counts, spacings) / 2
    warps = _Boundary(corner, counts, spacings)
    wefts = _Boundary(corner[:, ::-1], counts[::-1], spacings[::-1])
    inside = warps.before % 2 == 1
    return inside, warps.pieces(inside), wefts.pieces(inside.T)


def touching_sides(outline: Floats) -> Iterator[tuple[int, int]]:
    """Yield the pairs of sides of a polygon that meet other than at a common corner; side k starts at point k."""
    n = len(outline)
    first, second = np.triu_indices(n, 1)
    p, q = outline, np.roll(outline, -1, axis=0)
    a, b, c, d = p[first], q[first], p[second], q[second]
    apart = (np.maximum(a, b) < np.minimum(c, d)) | (np.maximum(c, d) < np.minimum(a, b))
    crossing = (_turn(a, b, c) * _turn(a, b, d) <= 0) & (_turn(c, d, a) * _turn(c, d, b) <= 0) & ~apart.any(axis=1)
    # sides with a common corner meet elsewhere only where the second one runs back along the first
    forward, backward = second - first == 1, (first == 0) & (second == n - 1)
    into, out = np.where(backward[:, None], d - c, b - a), np.where(backward[:, None], b - a, d - c)
    runs_back = (into[:, 0] * out[:, 1] == into[:, 1] * out[:, 0]) & ((into * out).sum(axis=1) < 0)
    meet = np.where(forward | backward, runs_back, crossing)
    yield from zip(first[meet].tolist(), second[meet].tolist(), strict=True)


def _turn(a: Floats, b: Floats, c: Floats) -> Floats:
    """Sign of the turn from a to b to c."""
    return np.sign((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))


class _Boundary:
    """Where lines along the second axis meet a polygon; `before` counts how often up to each crossing, [lines, n]."""

    def __init__(self, polygon: Floats, counts: tuple[int, int], spacings: tuple[float, float]):
        lines, self.crossings = counts
        across, self.spacing = spacings
        at = (np.arange(lines) + 0.5) * across
        start, end = polygon, np.roll(polygon, -1, axis=0)
        # a corner on a line belongs to one of its two sides
        side, line = np.nonzero((start[:, :1] <= at) != (end[:, :1] <= at))
        slope = (end[side, 1] - start[side, 1]) / (end[side, 0] - start[side, 0])
        place = start[side, 1] + (at[line] - start[side, 0]) * slope
        order = np.lexsort((place, line))
        self.place, self.first = place[order], np.searchsorted(line[order], np.arange(lines + 1))
        # in whole crossings, so that round-off cannot tell the counts along a line from each other
        crossing = np.clip(np.ceil(self.place / self.spacing - 0.5), 0, self.crossings).astype(np.int64)
        met = np.zeros((lines, self.crossings + 1), np.int16)
        np.add.at(met, (line[order], crossing), 1)
        self.before = np.cumsum(met, axis=1, dtype=np.int16)[:, :-1]

    def pieces(self, inside: Flags) -> Pieces:
        """Parts of the lines through the crossings `inside` [lines, n], broken wherever they meet the polygon."""
        broken = np.ones((len(inside), self.crossings + 1), np.bool_)
        broken[:, 1:-1] = (inside[:, 1:] != inside[:, :-1]) | (self.before[:, 1:] != self.before[:, :-1])
        line, first = np.nonzero(inside & broken[:, :-1])
        _, last = np.nonzero(inside & broken[:, 1:])
        return Pieces(line, low=np.minimum(np.maximum(first * self.spacing, self._met(line, first, -1)),
                                           (first + 0.5 - LEAST_END) * self.spacing),
                      high=np.maximum(np.minimum((last + 1) * self.spacing, self._met(line, last, 0)),
                                      (last + 0.5 + LEAST_END) * self.spacing))

    def _met(self, line: Ints, crossing: Ints, which: int) -> Floats:
        """Where the line meets the polygon last before (`which` -1) or first behind (0) a crossing, or not at all."""
        met = self.first[line] + self.before[line, crossing] + which
        there = (self.first[line] <= met) & (met < self.first[line + 1])
        place = np.full(len(line), np.inf if which == 0 else -np.inf)
        place[there] = self.place[met[there]]
        return place
