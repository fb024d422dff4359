"""The pressure, incompressible or not (Fei 2019, eqs. 14.31 and 14.32), with the surface and walls where they are.

Cells that are more than half filled have a pressure. Faces count by their open share; where the surface passes between two
cells, pressure falls to that of the air over the part of the way that is in the liquid. The system is divided by the step and
kept symmetric; conductances of faces can be anything, so that fractions of volume and drag come in by them.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from engine.arrays import Floats, Ints
from engine.linalg.multigrid import Multigrid, SevenPoint, Solved, multigrid, solve
from engine.liquid.grid import CELLS, Grid, Indices, beside
from engine.liquid.surface import HALF

LEAST_WAY = 0.02  # share of the way between two cells that is in the liquid, at least: keeps conductances finite


class Wet(NamedTuple):
    """The cells that have a pressure, N of them."""

    row: Indices  # of cells, -1 where there is no pressure, shape [B, 64]
    cell: Indices  # number 64 b + c of each, shape [N]
    system: SevenPoint
    levels: Multigrid


def wet_cells(
    grid: Grid, filled: Floats, depth: Floats, open_: Floats, conductance: Floats, compliance: Floats, period: Ints
) -> Wet:
    """Return the cells with a pressure and their system.

    `filled` and `depth` [B, 64] are those of the surface, `open_` [3, B, 64] shares of faces, `conductance` [3, B, 64] of whole
    faces h / (density spacing^2) [1/(Pa s)], `compliance` [B, 64] that of cells 1 / (K h) [1/(Pa s)].
    """
    row = np.full((len(grid.place), CELLS), -1, np.int32)
    wet = (filled > HALF) & _has_open_face(grid, open_)
    cell = np.flatnonzero(wet).astype(np.int32)
    row.reshape(-1)[cell] = np.arange(len(cell), dtype=np.int32)
    place, around = np.empty((len(cell), 3), np.int32), np.full((len(cell), 6), -1, np.int32)
    coupling, diagonal = np.zeros((len(cell), 3)), np.empty(len(cell))
    _rows(grid, cell, row, depth, open_, conductance, compliance, place, around, coupling, diagonal)
    system = SevenPoint(place, around, coupling, diagonal)
    return Wet(row, cell, system, multigrid(system, period))


def pressure(wet: Wet, load: Floats, tolerance: float, most: int) -> tuple[Floats, Solved]:
    """Return the pressure of wet cells [N] [Pa] for a `load` [N] [1/s], and how its solver did."""
    p = np.zeros(len(load))
    return p, solve(wet.levels, load, p, tolerance, most)


@njit(cache=True, parallel=True)
def _has_open_face(grid, open_):
    result = np.zeros((len(grid.place), CELLS), np.bool_)
    for b in prange(len(grid.place)):
        for c in range(CELLS):
            for axis in range(3):
                other, cell = beside(grid.near[b], c, axis, 1)
                if open_[axis, b, c] > 0.0 or (other >= 0 and open_[axis, other, cell] > 0.0):
                    result[b, c] = True
    return result


@njit(cache=True)
def _way(depth, beside_depth):
    """Share of the way from a wet cell to the one beside it that is in the liquid."""
    return max(depth / (depth - beside_depth), LEAST_WAY) if depth > 0.0 else LEAST_WAY


@njit(cache=True, parallel=True)
def _rows(grid, cells, row, depth, open_, conductance, compliance, place, around, coupling, diagonal):
    for n in prange(len(cells)):
        b, c = cells[n] // CELLS, cells[n] % CELLS
        place[n, 0] = 4 * grid.place[b, 0] + c // 16
        place[n, 1] = 4 * grid.place[b, 1] + c // 4 % 4
        place[n, 2] = 4 * grid.place[b, 2] + c % 4
        total = compliance[b, c]
        for axis in range(3):
            for up in range(2):
                other, cell = beside(grid.near[b], c, axis, 2 * up - 1)
                if other < 0:  # no particles within a block: air, whose face was never set
                    if up == 0:
                        total += open_[axis, b, c] * conductance[axis, b, c] / _way(depth[b, c], -1.5)
                    continue
                face, face_cell = (other, cell) if up else (b, c)
                whole = open_[axis, face, face_cell] * conductance[axis, face, face_cell]
                if whole == 0.0:
                    continue
                if row[other, cell] >= 0:
                    around[n, 2 * axis + up] = row[other, cell]
                    total += whole
                    if up:
                        coupling[n, axis] = whole
                else:
                    total += whole / _way(depth[b, c], depth[other, cell])
        diagonal[n] = total


@njit(cache=True, parallel=True)
def divergence(grid, u, open_, speed, cells, result):
    """Write the divergence [1/s] of faces u [3, B, 64] [m/s] in cells [N], where walls move at `speed` [3, B, 64] [m/s]."""
    for n in prange(len(cells)):
        b, c = cells[n] // CELLS, cells[n] % CELLS
        total = 0.0
        for axis in range(3):
            total -= open_[axis, b, c] * u[axis, b, c] + (1.0 - open_[axis, b, c]) * speed[axis, b, c]
            other, cell = beside(grid.near[b], c, axis, 1)
            share = open_[axis, other, cell]
            total += share * u[axis, other, cell] + (1.0 - share) * speed[axis, other, cell]
        result[n] = total / grid.spacing


@njit(cache=True, parallel=True)
def accelerate(grid, row, p, air, depth, open_, factor, u):
    """Take the gradient of p [N] [Pa] from u at open faces beside wet cells, times `factor`, h / density [m^3 s/kg].

    u and `factor` have shape [3, B, 64].     Where a face is at the surface the pressure beyond is `air` [N] of its wet cell. Returns which faces are beside wet cells.
    """
    solved = np.zeros(u.shape, np.bool_)
    for b in prange(len(grid.place)):
        for c in range(CELLS):
            here = row[b, c]
            for axis in range(3):
                other, cell = beside(grid.near[b], c, axis, -1)
                there = row[other, cell] if other >= 0 else -1
                if (here < 0 and there < 0) or open_[axis, b, c] == 0.0:
                    continue
                if here >= 0 and there >= 0:
                    fall = p[here] - p[there]
                elif here >= 0:
                    fall = (p[here] - air[here]) / _way(depth[b, c], depth[other, cell] if other >= 0 else -1.5)
                else:
                    fall = (air[there] - p[there]) / _way(depth[other, cell], depth[b, c])
                u[axis, b, c] -= factor[axis, b, c] * fall / grid.spacing
                solved[axis, b, c] = True
    return solved


@njit(cache=True, parallel=True)
def spread_outwards(grid, mass, solved, u):
    """Change faces that have liquid but no wet cell beside them by the mean of those next to them that pressure changed.

    `u` [3, B, 64] [m/s] is the change, not the velocity: liquid that turns goes on turning at its surface. Returns which faces
    are changed now. Others are of drops that are too small for the grid.
    """
    known = solved.copy()
    for b in prange(len(grid.place)):
        for axis in range(3):
            for c in range(CELLS):
                if solved[axis, b, c] or mass[axis, b, c] == 0.0:
                    continue
                total, count = 0.0, 0
                for along in range(3):
                    for step in (-1, 1):
                        other, cell = beside(grid.near[b], c, along, step)
                        if other >= 0 and solved[axis, other, cell]:
                            total += u[axis, other, cell]
                            count += 1
                if count:
                    u[axis, b, c] = total / count
                    known[axis, b, c] = True
    return known


def air_pressure(wet: Wet, depth: Floats, tension: float, grid: Grid) -> Floats:
    """Return the pressure beyond the surface of wet cells [N] [Pa]: that of its curvature times the surface tension [N/m]."""
    air = np.zeros(len(wet.cell))
    if tension > 0.0:
        _curved(grid, wet.cell, depth, tension, air)
    return air


@njit(cache=True, parallel=True)
def _curved(grid, cells, depth, tension, air):
    for n in prange(len(cells)):
        b, c = cells[n] // CELLS, cells[n] % CELLS
        if depth[b, c] >= 1.5:
            continue
        around = np.empty((3, 3, 3))
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    block, cell = _at(grid.near, b, c, i - 1, j - 1, k - 1)
                    around[i, j, k] = depth[block, cell] if block >= 0 else -1.5
        air[n] = tension * _curvature(around) / grid.spacing


@njit(cache=True)
def _at(near, b, c, i, j, k):
    """Block and cell at an offset of at most one cell along every axis."""
    i, j, k = c // 16 + i, c // 4 % 4 + j, c % 4 + k
    return near[b, 9 * (i // 4 + 1) + 3 * (j // 4 + 1) + k // 4 + 1], 16 * (i % 4) + 4 * (j % 4) + k % 4


@njit(cache=True)
def _curvature(depth):
    """Sum of the principal curvatures [1/spacing] of the level of depth [3, 3, 3] through its middle, positive for a drop."""
    x = 0.5 * (depth[2, 1, 1] - depth[0, 1, 1])
    y = 0.5 * (depth[1, 2, 1] - depth[1, 0, 1])
    z = 0.5 * (depth[1, 1, 2] - depth[1, 1, 0])
    xx = depth[2, 1, 1] - 2.0 * depth[1, 1, 1] + depth[0, 1, 1]
    yy = depth[1, 2, 1] - 2.0 * depth[1, 1, 1] + depth[1, 0, 1]
    zz = depth[1, 1, 2] - 2.0 * depth[1, 1, 1] + depth[1, 1, 0]
    yz = 0.25 * (depth[1, 2, 2] - depth[1, 2, 0] - depth[1, 0, 2] + depth[1, 0, 0])
    xz = 0.25 * (depth[2, 1, 2] - depth[2, 1, 0] - depth[0, 1, 2] + depth[0, 1, 0])
    xy = 0.25 * (depth[2, 2, 1] - depth[2, 0, 1] - depth[0, 2, 1] + depth[0, 0, 1])
    square = x * x + y * y + z * z
    if square < 1e-6:
        return 0.0
    bent = xx * (y * y + z * z) + yy * (x * x + z * z) + zz * (x * x + y * y) - 2.0 * (x * y * xy + x * z * xz + y * z * yz)
    return min(max(-bent / (square * np.sqrt(square)), -1.0), 1.0)
