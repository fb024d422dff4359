"""Where the free surface is: signed distances from how much of the cells' surroundings is filled.

What a quadratic B-spline sees of a half space at a signed distance is a cubic of that distance; its inverse turns the filled
share of a cell into the distance of its centre from the surface, exactly so for a plane along the grid. Behind walls
cells are mirror images of those before.
"""

import numpy as np
from numba import njit, prange

from engine.arrays import Floats
from engine.liquid.grid import CELLS, Grid, beside

FAR = 1.5  # spacings beyond which the spline sees nothing
HALF = 0.5  # a cell is of the liquid where more is filled


@njit(cache=True)
def seen(distance):
    """Return the share of a quadratic B-spline on the near side of a plane at `distance` [spacings] behind its middle."""
    if distance <= -FAR:
        return 0.0
    if distance <= -0.5:
        return (distance + FAR) ** 3 / 6.0
    if distance <= 0.5:
        return 0.5 + distance * (0.75 - distance * distance / 3.0)
    if distance < FAR:
        return 1.0 - (FAR - distance) ** 3 / 6.0
    return 1.0


@njit(cache=True)
def depth_of(share):
    """Return the inverse of `seen` [spacings], between -1.5 and 1.5."""
    if share <= 0.0:
        return -FAR
    if share >= 1.0:
        return FAR
    if share < 1.0 / 6.0:
        return (6.0 * share) ** (1.0 / 3.0) - FAR
    if share > 5.0 / 6.0:
        return FAR - (6.0 * (1.0 - share)) ** (1.0 / 3.0)
    depth = (share - 0.5) / 0.72
    for _ in range(3):
        depth -= (0.5 + depth * (0.75 - depth * depth / 3.0) - share) / (0.75 - depth * depth)
    return depth


@njit(cache=True, parallel=True)
def depths(filled, depth):
    """Write the depth of cell centres [B, 64] below the surface [spacings], negative above it, from filled shares."""
    for b in prange(len(filled)):
        for c in range(CELLS):
            depth[b, c] = depth_of(filled[b, c])


@njit(cache=True, parallel=True)
def _kept(grid, inside, result):
    """Write which cells are `inside` [B, 64] together with the six beside them."""
    for b in prange(len(grid.place)):
        for c in range(CELLS):
            kept = inside[b, c]
            for axis in range(3):
                for step in (-1, 1):
                    other, cell = beside(grid.near[b], c, axis, step)
                    kept = kept and other >= 0 and inside[other, cell]
            result[b, c] = kept


def deep(grid: Grid, filled: Floats, distance: Floats) -> tuple:
    """Return which cells the liquid fills (with all six beside them, or walls) and which even lie two cells deep, [B, 64]."""
    inside = (filled > HALF) | (distance < -0.5)
    once, twice = np.empty_like(inside), np.empty_like(inside)
    _kept(grid, inside, once)
    _kept(grid, once | (distance < -0.5), twice)
    return once, twice


def volume(grid: Grid, filled: Floats, distance: Floats) -> float:
    """Return the volume that the liquid takes up [m^3]: cells inside it count as full, whatever holes particles leave."""
    within, _ = deep(grid, filled, distance)
    share = np.where(within, 1.0, np.minimum(filled, 1.0)) * np.clip(distance + 0.5, 0.0, 1.0)
    return float(share.sum(axis=1).sum() * grid.spacing**3)
