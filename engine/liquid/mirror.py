"""Faces and cells behind walls as mirror images of those before them: linear maps, and their transposes.

A face behind a wall has the velocity with which a particle between both meets the wall's: the mirror image of the velocity at as
much before the wall, turned about where liquid sticks, and only its part along the normal where it slips. So velocities between
faces take their value at the wall where the wall is, not at the next face; and what the solve for shear varies vanishes there,
without which stress would leak into the wall.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from engine.arrays import Floats
from engine.geometry.solids import Solids, nearest, velocity_of
from engine.liquid.grid import CELLS, SIDE, Grid, Indices, centre_of

ON = 1e-6  # spacings within which a face is on a wall
MOST = 2.0  # times, that a velocity before a wall is that behind
IMAGES = 3  # walls that meet in a corner, each of which mirrors, and pushes out


class Mirror(NamedTuple):
    """A linear map: u of a face behind a wall is sum of weight u[parent] + given."""

    face: Indices  # shape [G]
    parent: Indices  # of all three components, shape [G, 24]
    weight: Floats  # shape [G, 24]
    given: Floats  # [m/s], shape [G]


class CellMirror(NamedTuple):
    """Cells whose centres are behind walls, and those around their mirror images."""

    cell: Indices  # shape [G]
    parent: Indices  # shape [G, 8]
    weight: Floats  # shape [G, 8]


@njit(cache=True)
def _image(mirror, g, u):
    """Return what the faces before walls give to face number g behind them."""
    value = 0.0
    for m in range(24):
        if mirror.weight[g, m] != 0.0:
            value += mirror.weight[g, m] * u[mirror.parent[g, m]]
    return value


@njit(cache=True)
def reflect(mirror, u):
    """Set the faces behind walls of u [3, B, 64]."""
    flat = u.reshape(-1)
    for g in range(len(mirror.face)):
        flat[mirror.face[g]] = mirror.given[g] + _image(mirror, g, flat)


@njit(cache=True)
def reflect_change(mirror, u):
    """Set the faces behind walls of a change u [3, B, 64], to which walls add nothing."""
    flat = u.reshape(-1)
    for g in range(len(mirror.face)):
        flat[mirror.face[g]] = _image(mirror, g, flat)


@njit(cache=True)
def collect(mirror, force):
    """Let the faces before walls have the force on those behind: the transpose of `reflect_change`."""
    flat = force.reshape(-1)
    for g in range(len(mirror.face)):
        for m in range(24):
            if mirror.weight[g, m] != 0.0:
                flat[mirror.parent[g, m]] += mirror.weight[g, m] * flat[mirror.face[g]]
        flat[mirror.face[g]] = 0.0


@njit(cache=True)
def collect_momentum(mirror, mass, momentum):
    """Let the faces before walls have the momentum on those behind, whose `mass` [3, B, 64] that is, relative to the walls.

    With `collect_mass` it projects what particles bring onto velocities that are mirror images: energy never grows by that. Were
    it left out, what a shear flow has behind the wall would be missing from what it has before, and thin layers gain speed. Not
    for particles that see velocities go on behind walls: of those, what is before the wall is whole by itself.
    """
    flat, heavy = momentum.reshape(-1), mass.reshape(-1)
    for g in range(len(mirror.face)):
        flat[mirror.face[g]] -= heavy[mirror.face[g]] * mirror.given[g]
    collect(mirror, momentum)


@njit(cache=True)
def collect_mass(mirror, mass):
    """Let the faces before walls have the mass on those behind."""
    flat = mass.reshape(-1)
    for g in range(len(mirror.face)):
        axis = mirror.face[g] // (mass.shape[1] * CELLS)
        total = 0.0
        for m in range(8 * axis, 8 * axis + 8):
            total += abs(mirror.weight[g, m])
        for m in range(8 * axis, 8 * axis + 8):
            if total > 0.0:
                flat[mirror.parent[g, m]] += abs(mirror.weight[g, m]) / total * flat[mirror.face[g]]


@njit(cache=True)
def fold_back(mirror, filled):
    """Give what cells behind walls have to those before."""
    flat = filled.reshape(-1)
    for g in range(len(mirror.cell)):
        for m in range(8):
            flat[mirror.parent[g, m]] += mirror.weight[g, m] * flat[mirror.cell[g]]


@njit(cache=True)
def unfold(mirror, filled):
    """Let cells behind walls be mirror images of those before."""
    flat = filled.reshape(-1)
    for g in range(len(mirror.cell)):
        value = 0.0
        for m in range(8):
            value += mirror.weight[g, m] * flat[mirror.parent[g, m]]
        flat[mirror.cell[g]] = value


def mirrored(
    grid: Grid, begin: Solids, end: Solids, h: float, behind: Indices, no_slip: bool, mass: Floats
) -> Mirror:
    """The map for the faces `behind` walls."""
    before = mass.reshape(-1) > 0.0
    before[behind] = False
    parent, weight = np.zeros((len(behind), 24), np.int32), np.zeros((len(behind), 24))
    given = np.zeros(len(behind))
    _write_mirror(grid, begin, end, h, behind, no_slip, before, parent, weight, given)
    return Mirror(behind, parent, weight, given)


@njit(cache=True, parallel=True)
def _write_mirror(grid, begin, end, h, behind, no_slip, before, parent, weight, given):
    blocks = len(grid.place)
    for g in prange(len(behind)):
        axis, b, c = behind[g] // (CELLS * blocks), behind[g] // CELLS % blocks, behind[g] % CELLS
        x, normal, velocity, row = np.empty(3), np.empty(3), np.empty(3), np.zeros(3)
        even, odd = np.zeros(3), np.zeros(3)  # parts of the velocity that are the same behind the wall, and that turn about
        centre_of(grid, b, c, axis, x)
        row[axis] = 1.0
        away = 0.0
        for image in range(IMAGES):
            distance, o = nearest(end, x, normal)
            if image == 0:
                velocity_of(begin, end, o, x, h, velocity)
            away = -distance
            across = row[0] * normal[0] + row[1] * normal[1] + row[2] * normal[2]
            for m in range(3):
                even[m] = 0.0 if no_slip else row[m] - across * normal[m]
                odd[m] = -row[m] if no_slip else -across * normal[m]
                row[m] = even[m] + odd[m]
                x[m] += 2.0 * away * normal[m]
            if nearest(end, x, normal)[0] >= 0.0:
                break
        given[g] = velocity[axis]
        for m in range(3):
            mine = slice(8 * m, 8 * m + 8)
            total, moment = parents(grid, b, x, m, normal, away, before, parent[g, mine], weight[g, mine])
            if total == 0.0:
                continue
            # what turns about falls evenly to the wall: so it does where only some of the faces around the image are there
            share = even[m] / total + odd[m] * min(away / max(moment, 1e-12 * grid.spacing), MOST / total)
            for n in range(8 * m, 8 * m + 8):
                weight[g, n] *= share
                given[g] -= weight[g, n] * velocity[m]


def mirrored_cells(grid: Grid, end: Solids, distance: Floats) -> CellMirror:
    """The map for the cells behind walls, as far as splines reach."""
    before = (distance >= 0.0).reshape(-1)
    behind = np.flatnonzero((distance < 0.0) & (distance > -2.0)).astype(np.int32)
    parent, weight = np.zeros((len(behind), 8), np.int32), np.zeros((len(behind), 8))
    _write_cell_mirror(grid, end, behind, before, parent, weight)
    return CellMirror(behind, parent, weight)


@njit(cache=True, parallel=True)
def _write_cell_mirror(grid, end, behind, before, parent, weight):
    for g in prange(len(behind)):
        b, c = behind[g] // CELLS, behind[g] % CELLS
        x, normal = np.empty(3), np.empty(3)
        centre_of(grid, b, c, 3, x)
        for _ in range(IMAGES):
            distance, _ = nearest(end, x, normal)
            for m in range(3):
                x[m] -= 2.0 * distance * normal[m]
            if nearest(end, x, normal)[0] >= 0.0:
                break
        total, _ = parents(grid, b, x, 3, normal, 0.0, before, parent[g], weight[g])
        for m in range(8):
            weight[g, m] = weight[g, m] / total if total > 0.0 else 0.0


@njit(cache=True)
def parents(grid, b, x, axis, normal, away, before, parent, weight):
    """Write the 8 faces of a component (3: cells) around x and their linear weights, 0 for those not before a wall.

    Returns the sum of weights, and that of weights times distances from a plane `away` [m] below x along `normal` [3].
    """
    total = moment = 0.0
    low, part = np.empty(3, np.int64), np.empty(3)
    for k in range(3):
        at = (x[k] - grid.origin[k]) / grid.spacing - SIDE * grid.place[b, k] - (0.0 if k == axis else 0.5)
        low[k] = np.int64(np.floor(at + 1e-9))
        part[k] = max(at - low[k], 0.0)
    for n in range(8):
        w, block, cell, within, distance = 1.0, 13, 0, True, away
        for k in range(3):
            up = n >> (2 - k) & 1
            at = low[k] + up
            w *= part[k] if up else 1.0 - part[k]
            distance += grid.spacing * normal[k] * (up - part[k])
            apart, stride = (9, 16) if k == 0 else (3, 4) if k == 1 else (1, 1)
            within = within and -SIDE <= at < 2 * SIDE
            block += apart * (at // SIDE)
            cell += stride * (at % SIDE)
        if w < 1e-9 or not within or grid.near[b, block] < 0:
            continue
        node = ((axis % 3) * len(grid.place) + grid.near[b, block]) * CELLS + cell
        if before[node]:
            parent[n], weight[n] = node, w
            total += w
            moment += w * max(distance, 0.0)
    return total, moment
