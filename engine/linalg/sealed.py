"""Sealed components: connected cells of a seven-point system without any excess, where p is known up to a constant only."""

from typing import NamedTuple

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints
from engine.linalg.seven_point import ROUND_OFF, Indices, SevenPoint, coupled


class Sealed(NamedTuple):
    """Component c has the cells cell[start[c]] ... cell[start[c+1]-1]."""

    cell: Indices
    start: Ints

    def remove_mean(self, x: Floats) -> None:
        """Subtract its mean in every component from x [n]."""
        _remove_mean(self.cell, self.start, x)


def sealed_components(system: SevenPoint) -> Sealed:
    """Return the components of a system that have no excess."""
    root = _roots(system.beside, system.coupling)
    closed = _closed(root, system.beside, system.coupling, system.diagonal)
    cell = np.flatnonzero(closed[root]).astype(np.int32)
    cell = cell[np.argsort(root[cell], kind="stable")]
    begins = np.flatnonzero(np.diff(root[cell], prepend=-1))
    return Sealed(cell, np.append(begins, len(cell)))


@njit(cache=True)
def _roots(beside, coupling):
    """First cell of each cell's component."""
    root = np.arange(len(beside)).astype(np.int32)
    for i in range(len(beside)):
        for a in range(3):
            j = beside[i, 2 * a]
            if j >= 0 and coupling[j, a] > 0.0:
                first, second = _root_of(root, i), _root_of(root, j)
                root[max(first, second)] = min(first, second)
    for i in range(len(beside)):
        root[i] = root[root[i]]  # roots come before what they are the root of
    return root


@njit(cache=True)
def _root_of(root, i):
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return i


@njit(cache=True)
def _closed(root, beside, coupling, diagonal):
    """Whether a root's component has no excess."""
    closed = np.ones(len(root), np.bool_)
    for i in range(len(root)):
        if diagonal[i] - coupled(i, beside, coupling) > ROUND_OFF * diagonal[i]:
            closed[root[i]] = False
    return closed


@njit(cache=True)
def _remove_mean(cell, start, x):
    for c in range(len(start) - 1):
        total = 0.0
        for i in cell[start[c] : start[c + 1]]:
            total += x[i]
        for i in cell[start[c] : start[c + 1]]:
            x[i] -= total / (start[c + 1] - start[c])
