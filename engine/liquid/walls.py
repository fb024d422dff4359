"""Solids on the grid: what of faces is open, how walls move, and faces behind walls as mirror images of those before them.

Open shares of faces are those that a plane leaves (Batty 2007's cut cells); where solids curve, the error is of second order in
the spacing. A face behind a wall has the velocity with which a particle between both meets the wall's: the mirror image of the
velocity at as much before the wall, turned about where liquid sticks, and only its part along the normal where it slips. So
velocities between faces take their value at the wall where the wall is, not at the next face.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from engine.arrays import Flags, Floats
from engine.geometry.solids import Solids, distance_to
from engine.liquid.grid import CELLS, SIDE, Grid, Indices
from engine.liquid.surface import seen

ON = 1e-6  # spacings within which a face is on a wall
REACH = 4.0  # spacings before a wall, up to which distances are told apart
DIAGONAL = 1.0  # more than the spacings from a cell's centre to its corner
LEAST_ROOM = 0.25  # of a cell: what has less is hardly before any wall
MOST = 2.0  # times, that a velocity before a wall is that behind
IMAGES = 3  # walls that meet in a corner, each of which mirrors, and pushes out


class Walls(NamedTuple):
    """Solids as a grid of B blocks sees them, with G faces behind walls that particles reach."""

    near: Flags  # whether a block comes near a solid, shape [B]
    distance: Floats  # of cell centres to solids [spacings], at most REACH, shape [B, 64]
    room: Floats  # what a cell's spline sees of the space before walls, with what is mirrored into it, shape [B, 64]
    open: Floats  # shares of faces, shape [3, B, 64]
    speed: Floats  # of walls along the normals of faces that are not quite open [m/s], shape [3, B, 64]
    mirror: "Mirror"
    cell_mirror: "CellMirror"


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
    mirror = _mirrored(grid, begin, end, h, np.flatnonzero(behind).astype(np.int32), no_slip, mass)
    cell_mirror = _mirrored_cells(grid, end, found.distance)
    _fold(cell_mirror, found.room)
    np.maximum(found.room, LEAST_ROOM, out=found.room)
    return found._replace(mirror=mirror, cell_mirror=cell_mirror)


def fold(walls: Walls, filled: Floats) -> None:
    """Make of what particles fill of cells [B, 64] the share of what walls leave of them; cells behind walls are mirror images.

    What splines carry through a wall comes back on the other side, and what is there is taken relative to what would be if all
    before the wall were full.
    """
    _fold(walls.cell_mirror, filled)
    filled /= walls.room
    _unfold(walls.cell_mirror, filled)


@njit(cache=True)
def _fold(mirror, filled):
    """Give what cells behind walls have to those before."""
    flat = filled.reshape(-1)
    for g in range(len(mirror.cell)):
        for m in range(8):
            flat[mirror.parent[g, m]] += mirror.weight[g, m] * flat[mirror.cell[g]]


@njit(cache=True)
def _unfold(mirror, filled):
    """Let cells behind walls be mirror images of those before."""
    flat = filled.reshape(-1)
    for g in range(len(mirror.cell)):
        value = 0.0
        for m in range(8):
            value += mirror.weight[g, m] * flat[mirror.parent[g, m]]
        flat[mirror.cell[g]] = value


@njit(cache=True)
def reflect(mirror, u):
    """Set the faces behind walls of u [3, B, 64]."""
    flat = u.reshape(-1)
    for g in range(len(mirror.face)):
        value = mirror.given[g]
        for m in range(24):
            if mirror.weight[g, m] != 0.0:
                value += mirror.weight[g, m] * flat[mirror.parent[g, m]]
        flat[mirror.face[g]] = value


@njit(cache=True)
def reflect_change(mirror, u):
    """Set the faces behind walls of a change u [3, B, 64], to which walls add nothing."""
    flat = u.reshape(-1)
    for g in range(len(mirror.face)):
        value = 0.0
        for m in range(24):
            if mirror.weight[g, m] != 0.0:
                value += mirror.weight[g, m] * flat[mirror.parent[g, m]]
        flat[mirror.face[g]] = value


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
def _centre(grid, b, c, axis, x):
    """Write the centre of a cell, or of its lower face across `axis`."""
    x[0] = grid.origin[0] + grid.spacing * (SIDE * grid.place[b, 0] + c // 16 + 0.5)
    x[1] = grid.origin[1] + grid.spacing * (SIDE * grid.place[b, 1] + c // 4 % 4 + 0.5)
    x[2] = grid.origin[2] + grid.spacing * (SIDE * grid.place[b, 2] + c % 4 + 0.5)
    if axis < 3:
        x[axis] -= 0.5 * grid.spacing


@njit(cache=True)
def _cell_of(grid, b, x):
    """Number of the cell of a block that x is in, or is nearest to."""
    cell = 0
    for k in range(3):
        at = int(np.floor((x[k] - grid.origin[k]) / grid.spacing)) - SIDE * grid.place[b, k]
        cell = SIDE * cell + min(max(at, 0), SIDE - 1)
    return cell


@njit(cache=True)
def _unit(normal):
    length = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if length > 0.0:
        normal[0] /= length
        normal[1] /= length
        normal[2] /= length


@njit(cache=True)
def nearest(solids, x, normal):
    """Return the distance of x [3] to the nearest solid [m] and which it is, and write the unit normal [3]."""
    best, least = 0, np.inf
    for o in range(len(solids.kind)):
        distance = distance_to(solids, o, x, normal)
        if distance < least:
            best, least = o, distance
    distance_to(solids, best, x, normal)
    _unit(normal)
    return least, best


@njit(cache=True)
def velocity_of(begin, end, o, x, h, velocity):
    """Write with what velocity [3] [m/s] the place x [3] on solid o went along in a step of h [s]."""
    for k in range(3):
        velocity[k] = x[k] - begin.centre[o, k]
    for m in range(3):
        along = 0.0
        for k in range(3):
            along += end.rotation[o, k, m] * (x[k] - end.centre[o, k])
        for k in range(3):
            velocity[k] -= begin.rotation[o, k, m] * along
    for k in range(3):
        velocity[k] /= h


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
            _centre(grid, b, c, 3, x)
            for o in close[:count]:
                distance = distance_to(end, o, x, normal) / grid.spacing
                cell_distance[b, c] = min(distance, cell_distance[b, c])
                room[b, c] *= seen(distance)
            if cell_distance[b, c] > 1.5:
                continue
            for axis in range(3):
                _centre(grid, b, c, axis, x)
                least, facing = np.inf, 0.0
                for o in close[:count]:
                    distance = distance_to(end, o, x, normal)
                    if distance > grid.spacing:
                        continue
                    _unit(normal)
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


def _mirrored(
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
        _centre(grid, b, c, axis, x)
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
            total, moment = _parents(grid, b, x, m, normal, away, before, parent[g, mine], weight[g, mine])
            if total == 0.0:
                continue
            # what turns about falls evenly to the wall: so it does where only some of the faces around the image are there
            share = even[m] / total + odd[m] * min(away / max(moment, 1e-12 * grid.spacing), MOST / total)
            for n in range(8 * m, 8 * m + 8):
                weight[g, n] *= share
                given[g] -= weight[g, n] * velocity[m]


def _mirrored_cells(grid: Grid, end: Solids, distance: Floats) -> CellMirror:
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
        _centre(grid, b, c, 3, x)
        for _ in range(IMAGES):
            distance, _ = nearest(end, x, normal)
            for m in range(3):
                x[m] -= 2.0 * distance * normal[m]
            if nearest(end, x, normal)[0] >= 0.0:
                break
        total, _ = _parents(grid, b, x, 3, normal, 0.0, before, parent[g], weight[g])
        for m in range(8):
            weight[g, m] = weight[g, m] / total if total > 0.0 else 0.0


@njit(cache=True)
def _parents(grid, b, x, axis, normal, away, before, parent, weight):
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
