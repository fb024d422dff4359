"""Solids on the grid: what of faces and cells they leave, how walls move, and particles that got inside.

Open shares of faces are those that a plane leaves (Batty 2007's cut cells); where solids curve, the error is of second order in
the spacing.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from engine.arrays import Flags, Floats
from engine.geometry.solids import Solids, distance_to, nearest, to_unit, velocity_of
from engine.liquid.grid import CELLS, SIDE, Grid, centre_of
from engine.liquid.mirror import IMAGES, ON, CellMirror, Mirror, fold_back, mirrored, mirrored_cells, unfold
from engine.liquid.surface import seen

REACH = 4.0  # spacings before a wall, up to which distances are told apart
DIAGONAL = 1.0  # more than the spacings from a cell's centre to its corner
LEAST_ROOM = 0.25  # of a cell: what has less is hardly before any wall


class Walls(NamedTuple):
    """Solids as a grid of B blocks sees them, with G faces behind walls that particles reach."""

    near: Flags  # whether a block comes near a solid, shape [B]
    distance: Floats  # of cell centres to solids [spacings], at most REACH, shape [B, 64]
    room: Floats  # what a cell's spline sees of the space before walls, with what is mirrored into it, shape [B, 64]
    open: Floats  # shares of faces, shape [3, B, 64]
    speed: Floats  # of walls along the normals of faces that are not quite open [m/s], shape [3, B, 64]
    mirror: Mirror
    cell_mirror: CellMirror


def open_space(grid: Grid) -> Walls:
    """Return what a grid is without solids."""
    blocks, none = len(grid.place), np.zeros(0, np.int32)
    return Walls(
        np.zeros(blocks, np.bool_), np.full((blocks, CELLS), REACH), np.ones((blocks, CELLS)),
        np.ones((3, blocks, CELLS)), grid.faces(),
        Mirror(none, np.zeros((0, 24), np.int32), np.zeros((0, 24)), np.zeros(0)),
        CellMirror(none, np.zeros((0, 8), np.int32), np.zeros((0, 8))),
    )


def walls(grid: Grid, begin: Solids, end: Solids, h: float, no_slip: bool, mass: Floats) -> Walls:
    """Return solids as they are at the `end` of a step of `h` [s], moving as they do in it; `mass` [3, B, 64] has liquid."""
    found = open_space(grid)
    if len(end.kind) == 0:
        return found
    behind = np.zeros(mass.shape, np.bool_)
    _cut(grid, begin, end, h, no_slip, mass, found.near, found.distance, found.room, found.open, found.speed, behind)
    mirror = mirrored(grid, begin, end, h, np.flatnonzero(behind).astype(np.int32), no_slip, mass)
    cell_mirror = mirrored_cells(grid, end, found.distance)
    fold_back(cell_mirror, found.room)
    np.maximum(found.room, LEAST_ROOM, out=found.room)
    return found._replace(mirror=mirror, cell_mirror=cell_mirror)


def fold(walls: Walls, filled: Floats) -> None:
    """Make of what particles fill of cells [B, 64] the share of what walls leave of them; cells behind walls are mirror images.

    What splines carry through a wall comes back on the other side, and what is there is taken relative to what would be if all
    before the wall were full.
    """
    fold_back(walls.cell_mirror, filled)
    filled /= walls.room
    unfold(walls.cell_mirror, filled)


@njit(cache=True)
def _cell_of(grid, b, x):
    """Number of the cell of a block that x is in, or is nearest to."""
    cell = 0
    for k in range(3):
        at = int(np.floor((x[k] - grid.origin[k]) / grid.spacing)) - SIDE * grid.place[b, k]
        cell = SIDE * cell + min(max(at, 0), SIDE - 1)
    return cell


@njit(cache=True)
def open_share(distance, a, b):
    """Return the share of a square of side 1 before a line, at a signed distance from its middle along a normal (a, b)."""
    low, high = min(abs(a), abs(b)), max(abs(a), abs(b), 1e-9)
    reach = distance + 0.5 * (low + high)
    if reach <= 0.0:
        return 0.0
    if reach >= low + high:
        return 1.0
    if reach < low:
        return reach * reach / (2.0 * low * high)
    if reach <= high:
        return (reach - 0.5 * low) / high
    return 1.0 - (low + high - reach) ** 2 / (2.0 * low * high)


@njit(cache=True, parallel=True)
def _cut(grid, begin, end, h, no_slip, mass, near, cell_distance, room, open_, speed, behind):
    """Write distances of cells, open shares of faces and the speed of walls at them, in the blocks near solids.

    Faces are `behind` walls, or on them where these hold them, and have mass: they will be mirror images.
    """
    across = grid.spacing * (0.5 * SIDE + 0.5) * np.sqrt(3.0) + REACH * grid.spacing
    for b in prange(len(grid.place)):
        x, normal, velocity = np.empty(3), np.empty(3), np.empty(3)
        for k in range(3):
            x[k] = grid.origin[k] + grid.spacing * SIDE * (grid.place[b, k] + 0.5)
        close, count = np.empty(len(end.kind), np.int64), 0
        for o in range(len(end.kind)):
            if distance_to(end, o, x, normal) < across:
                close[count] = o
                count += 1
        near[b] = count > 0
        if not near[b]:
            continue
        for c in range(CELLS):
            centre_of(grid, b, c, 3, x)
            for o in close[:count]:
                distance = distance_to(end, o, x, normal) / grid.spacing
                cell_distance[b, c] = min(distance, cell_distance[b, c])
                room[b, c] *= seen(distance)
            if cell_distance[b, c] > 1.5:
                continue
            for axis in range(3):
                centre_of(grid, b, c, axis, x)
                least, facing = np.inf, 0.0
                for o in close[:count]:
                    distance = distance_to(end, o, x, normal)
                    if distance > grid.spacing:
                        continue
                    to_unit(normal)
                    if distance < least:
                        least, facing = distance, abs(normal[axis])
                    one, other = normal[(axis + 1) % 3], normal[(axis + 2) % 3]
                    share = open_share(distance / grid.spacing - ON, one, other)
                    if share < open_[axis, b, c]:
                        open_[axis, b, c] = share
                        velocity_of(begin, end, o, x, h, velocity)
                        speed[axis, b, c] = velocity[axis]
                on_wall = least < ON * grid.spacing and (no_slip or facing > 0.5)
                behind[axis, b, c] = mass[axis, b, c] > 0.0 and (least < -ON * grid.spacing or on_wall)


@njit(cache=True, parallel=True)
def push_out(grid, near, cell_distance, moved, begin, end, h, x, velocity):
    """Move particles that are inside solids at the end of a step of h [s] to their surface, and let them go no deeper.

    `near` [B] flags the blocks of the grid, by which x [P, 3] [m] are sorted as of before they `moved` by so many cells at most
    along any axis; `cell_distance` [B, 64] [spacings] is that of cells to solids.
    """
    safe = DIAGONAL + np.sqrt(3.0) * moved
    for t in prange(len(grid.turn)):
        b = grid.turn[t]
        if not near[b]:
            continue
        normal, wall = np.empty(3), np.empty(3)
        for p in range(grid.start[b], grid.start[b + 1]):
            if cell_distance[b, _cell_of(grid, b, x[p])] > safe:
                continue
            for _ in range(IMAGES):
                distance, o = nearest(end, x[p], normal)
                if distance >= 0.0:
                    break
                velocity_of(begin, end, o, x[p], h, wall)
                inward = 0.0
                for k in range(3):
                    x[p, k] -= distance * normal[k]
                    inward += (velocity[p, k] - wall[k]) * normal[k]
                if inward < 0.0:
                    for k in range(3):
                        velocity[p, k] -= inward * normal[k]
