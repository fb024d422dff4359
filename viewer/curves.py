"""Polylines as smooth curves, so that what is thin and bent does not look broken."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Floats, Ints

PIECES = 5  # into which a segment is cut


@dataclass(frozen=True)
class Curves:
    """Polylines cut finer than they were: K nodes between old ones on Y lines."""

    positions: Floats  # [m], shape [K, 3]
    offsets: Ints  # line y is positions[offsets[y]:offsets[y+1]], shape [Y+1]
    before: Ints  # old node at or before each, shape [K]
    after: Ints  # old node behind each, on the same line, shape [K]
    share: Floats  # of the way from one to the other, shape [K]

    def between(self, values: NDArray[np.floating]) -> Floats:
        """Return what is linear between the `values` at old nodes, shape [K]."""
        return (1 - self.share) * values[self.before] + self.share * values[self.after]


def smooth(positions: Floats, offsets: Ints, most: int) -> Curves:
    """Return curves through `positions` [m] of lines with `offsets`: cubic pieces, cut into up to `most` straight ones."""
    node = np.arange(len(positions))
    inner = np.ones(len(positions), bool)  # a segment starts at this node
    lines = np.diff(offsets) > 0
    inner[offsets[1:][lines] - 1] = False
    after = np.where(inner, node + 1, node)
    chord = positions[after] - positions
    length = np.linalg.norm(chord, axis=1, keepdims=True)
    slope = chord / np.maximum(length, np.finfo(float).tiny)
    # the slope of the parabola through a node and its neighbours; at ends one of the two lengths is zero
    before = np.where(np.roll(inner, 1), node - 1, node)
    total = np.maximum(length + length[before] * (before != node)[:, None], np.finfo(float).tiny)
    share_after = np.where((before != node)[:, None], length[before] / total, 1.0)
    share_after = np.where(inner[:, None], share_after, 0.0)
    tangent = share_after * slope + (1 - share_after) * slope[before]

    pieces = np.where(inner, min(max(most // max(len(node), 1), 1), PIECES), 1)
    first = np.cumsum(pieces) - pieces
    start = np.repeat(node, pieces)
    end = after[start]
    t = ((np.arange(len(start)) - first[start]) / pieces[start])[:, None]
    curved = (
        (1 + 2 * t) * (1 - t) ** 2 * positions[start] + t**2 * (3 - 2 * t) * positions[end]
        + length[start] * (t * (1 - t) ** 2 * tangent[start] - t**2 * (1 - t) * tangent[end])
    )  # fmt: skip
    return Curves(curved, np.append(first, len(start))[offsets], start, end, t[:, 0])
