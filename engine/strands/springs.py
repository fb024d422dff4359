"""Linear springs that hold places on strands: what contacts are to a strand while it is solved by itself.

A place y that a force f holds at its anchor a, with a stiffness K about it, has the potential -f.(y - a) + (y - a).K.(y - a) / 2.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints


class Springs(NamedTuple):
    """P springs, those of strand s from first[s] to first[s+1]-1."""

    first: Ints  # shape [S + 1]
    vertex: Ints  # first vertex of the edge, shape [P]
    share: Floats  # of the edge, shape [P]
    anchor: Floats  # [m], shape [P, 3]
    force: Floats  # [N], shape [P, 3]
    stiffness: Floats  # symmetric [N/m], shape [P, 3, 3]


def no_springs(strands: int) -> Springs:
    """Return none for so many strands."""
    return Springs(np.zeros(strands + 1, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)),
                   np.zeros((0, 3, 3)))


@njit(cache=True, error_model="numpy")
def energy(springs, s, start, x):
    """Potential [J] of the springs of strand s, whose vertices from number `start` on are at x [V, 3] [m]."""
    total, y = 0.0, np.empty(3)
    for p in range(springs.first[s], springs.first[s + 1]):
        _offset(springs, p, start, x, y)
        for k in range(3):
            pulled = -springs.force[p, k]
            for m in range(3):
                pulled += 0.5 * springs.stiffness[p, k, m] * y[m]
            total += pulled * y[k]
    return total


@njit(cache=True, error_model="numpy")
def add_gradient(springs, s, start, x, held, g):
    """Add the gradient by x [N] to g [V, 4], but for what is `held` [V, 4]; returns the largest force of a spring [N]."""
    largest, y = 0.0, np.empty(3)
    for p in range(springs.first[s], springs.first[s + 1]):
        _offset(springs, p, start, x, y)
        i, share = springs.vertex[p] - start, springs.share[p]
        for k in range(3):
            pull = -springs.force[p, k]
            for m in range(3):
                pull += springs.stiffness[p, k, m] * y[m]
            largest = max(largest, abs(pull))
            if not held[i, k]:
                g[i, k] += (1.0 - share) * pull
            if not held[i + 1, k]:
                g[i + 1, k] += share * pull
    return largest


@njit(cache=True, error_model="numpy")
def add_hessian(springs, s, start, held, band):
    """Add the Hessian to `band` [4V, 11]."""
    for p in range(springs.first[s], springs.first[s + 1]):
        i, share = springs.vertex[p] - start, springs.share[p]
        for a in range(2):
            for b in range(a + 1):
                weight = (share if a == 1 else 1.0 - share) * (share if b == 1 else 1.0 - share)
                for k in range(3):
                    for m in range(3):
                        row, column = 4 * (i + a) + k, 4 * (i + b) + m
                        if column <= row and not held[i + a, k] and not held[i + b, m]:
                            band[column, row - column] += weight * springs.stiffness[p, k, m]


@njit(cache=True, error_model="numpy")
def _offset(springs, p, start, x, y):
    i, share = springs.vertex[p] - start, springs.share[p]
    for k in range(3):
        y[k] = (1.0 - share) * x[i, k] + share * x[i + 1, k] - springs.anchor[p, k]
