"""Transfers between particles and the staggered grid: affine, by quadratic B-splines (Fei 2019, eq. 9.20).

A block's particles work on a tile, a copy of the cells that they reach, of one before and two behind those of the block along
every axis. Blocks of one colour reach no cell in common, so they add what they have gathered to the grid at the same time, and
colours follow each other: sums are the same on any number of threads.
"""

import numpy as np
from numba import njit, prange

from engine.liquid.grid import COLOURS, SIDE
from engine.liquid.rheology import newtonian_stress

TILE = SIDE + 3  # cells along a tile
_PLANE = TILE * TILE
FIELD = TILE**3  # entries of a field on a tile


@njit(cache=True, inline="always")
def parabola(at):
    """Return the first of the three nodes that a particle reaches, its weights at them, and their places relative to it.

    `at` counts nodes, from 1 on: truncation is the floor.
    """
    first = np.int64(at - 0.5)
    f = at - first
    return (first, 0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2, -f)


@njit(cache=True, inline="always")
def axis_weights(x, origin, spacing, block, weight):
    """Write weights of a particle for nodes at faces (weight[0]) and at centres (weight[1]) along one axis.

    Each gets three weights, then those times places of nodes relative to the particle [cells]; returns the first nodes.
    """
    at = (x - origin) / spacing - SIDE * block + 1.0
    face, w0, w1, w2, d = parabola(at)
    weight[0, 0], weight[0, 1], weight[0, 2] = w0, w1, w2
    weight[0, 3], weight[0, 4], weight[0, 5] = w0 * d, w1 * (d + 1.0), w2 * (d + 2.0)
    centre, w0, w1, w2, d = parabola(at - 0.5)
    weight[1, 0], weight[1, 1], weight[1, 2] = w0, w1, w2
    weight[1, 3], weight[1, 4], weight[1, 5] = w0 * d, w1 * (d + 1.0), w2 * (d + 2.0)
    return face, centre


@njit(cache=True, inline="always")
def weigh(x, origin, spacing, place, weight, first):
    """Write a particle's weights [axis, face or centre, 6] and the first nodes [axis, face or centre] on its block's tile."""
    for a in range(3):
        first[a, 0], first[a, 1] = axis_weights(x[a], origin[a], spacing, place[a], weight[a])


@njit(cache=True, inline="always")
def scatter(tile, weight, first, axis, value, gx, gy, gz):
    """Add value + g . (node - particle) [cells], times weights, to the nodes that carry component `axis` (3: cells)."""
    ka, kb, kc = (0 if axis == 0 else 1), (0 if axis == 1 else 1), (0 if axis == 2 else 1)
    z0, z1, z2 = weight[2, kc, 0], weight[2, kc, 1], weight[2, kc, 2]
    d0, d1, d2 = weight[2, kc, 3], weight[2, kc, 4], weight[2, kc, 5]
    at = (first[0, ka] * TILE + first[1, kb]) * TILE + first[2, kc]
    for i in range(3):
        wi, di = weight[0, ka, i], weight[0, ka, 3 + i]
        for j in range(3):
            wj = weight[1, kb, j]
            w = wi * wj
            p = value * w + gx * di * wj + gy * wi * weight[1, kb, 3 + j]
            q = gz * w
            n = at + i * _PLANE + j * TILE
            tile[n] += p * z0 + q * d0
            tile[n + 1] += p * z1 + q * d1
            tile[n + 2] += p * z2 + q * d2


@njit(cache=True, inline="always")
def gather(tile, weight, first, axis):
    """Return the value of component `axis` (3: cells) at a particle, and its affine moments [cells] along x, y, z."""
    ka, kb, kc = (0 if axis == 0 else 1), (0 if axis == 1 else 1), (0 if axis == 2 else 1)
    z0, z1, z2 = weight[2, kc, 0], weight[2, kc, 1], weight[2, kc, 2]
    d0, d1, d2 = weight[2, kc, 3], weight[2, kc, 4], weight[2, kc, 5]
    at = (first[0, ka] * TILE + first[1, kb]) * TILE + first[2, kc]
    value = x = y = z = 0.0
    for i in range(3):
        wi, di = weight[0, ka, i], weight[0, ka, 3 + i]
        for j in range(3):
            wj = weight[1, kb, j]
            n = at + i * _PLANE + j * TILE
            s = z0 * tile[n] + z1 * tile[n + 1] + z2 * tile[n + 2]
            value += wi * wj * s
            x += di * wj * s
            y += wi * weight[1, kb, 3 + j] * s
            z += wi * wj * (d0 * tile[n] + d1 * tile[n + 1] + d2 * tile[n + 2])
    return value, x, y, z


@njit(cache=True, inline="always")
def load(near, field, tile):
    """Copy a field [B, 64] to the tile [343] of the block whose neighbours are `near` [27], all of which exist."""
    n = 0
    for i in range(-1, SIDE + 2):
        for j in range(-1, SIDE + 2):
            m = 9 * ((i + SIDE) // SIDE) + 3 * ((j + SIDE) // SIDE)
            row = 16 * (i & 3) + 4 * (j & 3)
            before, here, behind = field[near[m]], field[near[m + 1]], field[near[m + 2]]
            tile[n] = before[row + 3]
            for k in range(SIDE):
                tile[n + 1 + k] = here[row + k]
            tile[n + 5], tile[n + 6] = behind[row], behind[row + 1]
            n += TILE


@njit(cache=True, inline="always")
def add(near, tile, field):
    """Add the tile [343] of a block to a field [B, 64]."""
    n = 0
    for i in range(-1, SIDE + 2):
        for j in range(-1, SIDE + 2):
            m = 9 * ((i + SIDE) // SIDE) + 3 * ((j + SIDE) // SIDE)
            row = 16 * (i & 3) + 4 * (j & 3)
            before, here, behind = field[near[m]], field[near[m + 1]], field[near[m + 2]]
            before[row + 3] += tile[n]
            for k in range(SIDE):
                here[row + k] += tile[n + 1 + k]
            behind[row] += tile[n + 5]
            behind[row + 1] += tile[n + 6]
            n += TILE


@njit(cache=True, parallel=True)
def to_grid(grid, x, velocity, affine, volume, density, h, consistency, stress, mass, momentum, filled):
    """Add particles to the grid: mass [kg] and momentum [kg m/s] to faces [3, B, 64], volume over that of a cell to cells.

    Particles at x [P, 3] [m] have a volume [P] [m^3] at rest, a velocity [P, 3] [m/s] and its gradient `affine` [P, 3, 3] [1/s].
    With momentum comes the impulse, in a step of h [s], of the shear stress that they have before it (Fei 2019, eq. 14.7): of a
    Newtonian liquid by its `consistency` [Pa s], of others `stress` [P, 6] [Pa]. Without any these are 0 and [0, 6].
    """
    share, lever = 1.0 / grid.spacing**3, 4.0 * h / grid.spacing**2
    for colour in range(COLOURS):
        for t in prange(grid.turns[colour], grid.turns[colour + 1]):
            b = grid.turn[t]
            tiles = np.zeros((7, FIELD))
            weight, first, moment = np.empty((3, 2, 6)), np.empty((3, 2), np.int64), np.empty((3, 3))
            for p in range(grid.start[b], grid.start[b + 1]):
                weigh(x[p], grid.origin, grid.spacing, grid.place[b], weight, first)
                m = density * volume[p]
                for a in range(3):
                    for k in range(3):
                        moment[a, k] = m * affine[p, a, k]
                if len(stress):
                    _take_stress(moment, lever * volume[p], stress[p])
                elif consistency > 0.0:
                    _take_stress(moment, lever * volume[p], newtonian_stress(affine[p], consistency))
                for a in range(3):
                    scatter(tiles[a], weight, first, a, m, 0.0, 0.0, 0.0)
                    scatter(tiles[3 + a], weight, first, a, m * velocity[p, a], moment[a, 0] * grid.spacing,
                            moment[a, 1] * grid.spacing, moment[a, 2] * grid.spacing)
                scatter(tiles[6], weight, first, 3, volume[p] * share, 0.0, 0.0, 0.0)
            for a in range(3):
                add(grid.near[b], tiles[a], mass[a])
                add(grid.near[b], tiles[3 + a], momentum[a])
            add(grid.near[b], tiles[6], filled)


@njit(cache=True, inline="always")
def _take_stress(moment, factor, s):
    """Take a symmetric stress [6] times `factor` from a moment [3, 3]."""
    moment[0, 0] -= factor * s[0]
    moment[1, 1] -= factor * s[1]
    moment[2, 2] -= factor * s[2]
    moment[1, 2] -= factor * s[3]
    moment[2, 1] -= factor * s[3]
    moment[0, 2] -= factor * s[4]
    moment[2, 0] -= factor * s[4]
    moment[0, 1] -= factor * s[5]
    moment[1, 0] -= factor * s[5]


@njit(cache=True, parallel=True)
def to_particles(grid, x, u, velocity, affine):
    """Write velocity [P, 3] [m/s] and its gradient `affine` [P, 3, 3] [1/s] of particles at x [P, 3] from faces u [3, B, 64].

    The gradient is that of the affine transfer, D^-1 sum of w u (node - particle), with D = spacing^2 / 4.
    """
    scale = 4.0 / grid.spacing
    for t in prange(len(grid.turn)):
        b = grid.turn[t]
        tiles = np.empty((3, FIELD))
        weight, first = np.empty((3, 2, 6)), np.empty((3, 2), np.int64)
        for a in range(3):
            load(grid.near[b], u[a], tiles[a])
        for p in range(grid.start[b], grid.start[b + 1]):
            weigh(x[p], grid.origin, grid.spacing, grid.place[b], weight, first)
            for a in range(3):
                velocity[p, a], gx, gy, gz = gather(tiles[a], weight, first, a)
                affine[p, a, 0], affine[p, a, 1], affine[p, a, 2] = scale * gx, scale * gy, scale * gz
