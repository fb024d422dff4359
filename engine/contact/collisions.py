"""Yarns that keep apart where no contact point joins them: stiff penalties between spheres along them.

V = k (rest - d)^2 / 2 for every pair of spheres that are nearer than rest, d the distance of their centres
(Sánchez-Banderas 2020, sec. 5). A sphere stays at its share of a segment within a step, so that the energy depends on x
only: without friction, what pushes across a yarn does no work on material that slides along it.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints
from engine.linalg.block_matrix import locate


@dataclass(frozen=True)
class CollisionPairs:
    """C pairs of spheres that may touch within a step; centre_a - centre_b = sum of weight * x over four points."""

    point: Ints  # ends of the first sphere's segment, then of the second's, shape [C, 4]
    weight: Floats  # shape [C, 4]
    rest: Floats  # distance below which they push [m], shape [C]
    stiffness: Floats  # k [N/m], shape [C]

    def coupled(self, point_count: int) -> Ints:
        """Return the pairs of different points whose unknowns the energy couples, each once, shape [m, 2]."""
        a, b = np.triu_indices(4, 1)
        low = np.minimum(self.point[:, a], self.point[:, b]).ravel()
        high = np.maximum(self.point[:, a], self.point[:, b]).ravel()
        key = np.unique((low * point_count + high)[low != high])
        return np.column_stack([key // point_count, key % point_count])


@njit(cache=True)
def add_gradient(point, weight, rest, stiffness, x, gradient):
    """Add the gradient to `gradient` [P, 5] and return the energy [J]."""
    energy = 0.0
    offset = np.empty(3)
    for c in range(len(rest)):
        distance = _offset(point[c], weight[c], x, offset)
        if 0.0 < distance < rest[c]:
            depth = rest[c] - distance
            energy += 0.5 * stiffness[c] * depth * depth
            for a in range(4):
                push = stiffness[c] * depth * weight[c, a] / distance
                for k in range(3):
                    gradient[point[c, a], k] -= push * offset[k]
    return energy


@njit(cache=True)
def add_hessian(point, weight, rest, stiffness, x, convex, row, start, column, block):
    """Add the Hessian; where `convex` [P], without what turning the line between both centres takes from it.

    `row` [P] are the points' rows.
    """
    offset = np.empty(3)
    for c in range(len(rest)):
        distance = _offset(point[c], weight[c], x, offset)
        if 0.0 < distance < rest[c]:
            positive = convex[point[c, 0]] or convex[point[c, 1]] or convex[point[c, 2]] or convex[point[c, 3]]
            across = 0.0 if positive else -stiffness[c] * (rest[c] - distance) / distance
            along = (stiffness[c] - across) / (distance * distance)
            for a in range(4):
                for b in range(4):
                    w = weight[c, a] * weight[c, b]
                    if w != 0.0:
                        at = locate(start, column, row[point[c, a]], row[point[c, b]])
                        for r in range(3):
                            block[at, r, r] += w * across
                            for s in range(3):
                                block[at, r, s] += w * along * offset[r] * offset[s]


@njit(cache=True)
def pressing(point, weight, rest, x0, x):
    """Return how many pairs touch at x, and whether any passed through each other on the way from x0 there."""
    count, passed = 0, False
    before, offset = np.empty(3), np.empty(3)
    for c in range(len(rest)):
        _offset(point[c], weight[c], x0, before)
        if _offset(point[c], weight[c], x, offset) < rest[c]:
            count += 1
        if before[0] * offset[0] + before[1] * offset[1] + before[2] * offset[2] < 0.0:
            passed = True
    return count, passed


@njit(cache=True)
def _offset(point, weight, x, offset):
    square = 0.0
    for k in range(3):
        offset[k] = 0.0
        for a in range(4):
            offset[k] += weight[a] * x[point[a], k]
        square += offset[k] * offset[k]
    return np.sqrt(square)
