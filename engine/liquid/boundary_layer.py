"""Velocities behind walls that stick, where the boundary layer may be thinner than a cell.

Mirror images say that velocities fall evenly to the wall over half a cell. That is what stress must see, but not what particles
may carry: taken back and forth between particles and grid, a thinner layer would thicken in every step, however short, and the
liquid be braked by the grid instead of its viscosity. So particles see velocities go on behind walls as they come towards them.
Where the layer is resolved, both are the same.
"""

import numpy as np
from numba import njit, prange

from engine.geometry.solids import nearest, velocity_of
from engine.liquid.grid import CELLS, centre_of
from engine.liquid.mirror import MOST, ON, parents

NEAREST = 0.5  # spacings before a wall, at which velocities are looked at first; then at every spacing on
SAMPLES = 3  # of velocities, at most: what goes on is a parabola
APART = 0.25  # spacings by which faces that stand for them must differ


@njit(cache=True)
def _sample(grid, b, x, normal, away, before, u, inertia, parent, weight, velocity, height, share):
    """Write velocity, height above a wall and share of inertia [3] of the faces around x, which is `away` [m] before the wall.

    Returns whether every component has such faces; `parent` and `weight` [8] are to work on.
    """
    for m in range(3):
        weight[:] = 0.0
        total, moment = parents(grid, b, x, m, normal, away, before, parent, weight)
        if total == 0.0:
            return False
        height[m], velocity[m], share[m] = moment / total, 0.0, 0.0
        for n in range(8):
            velocity[m] += weight[n] / total * u[parent[n]]
            share[m] += weight[n] / total * inertia[parent[n]]
    return True


@njit(cache=True)
def _at(z, u, height):
    """Return the polynomial through values u at z, at a height."""
    value = 0.0
    for m in range(len(z)):
        share = 1.0
        for n in range(len(z)):
            if n != m:
                share *= (height - z[n]) / (z[m] - z[n])
        value += share * u[m]
    return value


@njit(cache=True)
def _between(value, one, other):
    return min(max(value, min(one, other)), max(one, other))


@njit(cache=True, parallel=True)
def extend(grid, begin, end, h, behind, mass, inertia, u):
    """Let u [3, B, 64] [m/s], which is a mirror image at the faces `behind` [G] walls that stick, go on there along the walls.

    It goes on smoothly from what it is before, yet stays between what sticks and what slips, and is closer to what sticks the
    less is the share of `inertia` [3, B, 64] in what holds faces back. The part along the normal turns about at the wall. Mirror
    images stay where two walls meet, and where liquid is less than two faces thick. Walls move from `begin` to `end` in h [s];
    faces without `mass` [3, B, 64] [kg] have no velocity to look at. Flows that are even, or grow evenly from the wall, are
    exact. The papers have no such step.
    """
    flat, share_of, before = u.reshape(-1), inertia.reshape(-1), mass.reshape(-1) > 0.0
    before[behind] = False
    for g in prange(len(behind)):
        axis, b, c = behind[g] // (CELLS * len(grid.place)), behind[g] // CELLS % len(grid.place), behind[g] % CELLS
        x, normal, unused, wall, first = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        v, height, share = np.empty((SAMPLES, 3)), np.empty((SAMPLES, 3)), np.empty((SAMPLES, 3))
        parent, weight = np.zeros(8, np.int32), np.zeros(8)
        centre_of(grid, b, c, axis, x)
        distance, o = nearest(end, x, normal)
        depth = max(-distance, 0.0)
        velocity_of(begin, end, o, x, h, wall)
        for k in range(3):
            x[k] += 2.0 * depth * normal[k]
        if nearest(end, x, unused)[0] < -ON * grid.spacing:
            continue
        away, samples = max(depth, NEAREST * grid.spacing), 0
        for k in range(3):
            x[k] += (away - depth) * normal[k]
        while samples < SAMPLES and nearest(end, x, unused)[0] > 0.0:
            if not _sample(grid, b, x, normal, away + samples * grid.spacing, before, flat, share_of, parent, weight,
                           v[samples], height[samples], share[samples]):
                break
            apart = np.inf
            for m in range(3):
                apart = min(apart, height[samples, m] - (height[samples - 1, m] if samples > 0 else -np.inf))
            if apart < APART * grid.spacing:
                break
            for k in range(3):
                v[samples, k] -= wall[k]
                x[k] += grid.spacing * normal[k]
            samples += 1
        if samples < 2:
            continue
        first_across = goes_on_across = 0.0
        for m in range(3):
            z, values = height[:samples, m], v[:samples, m]
            first[m] = _between(_at(z, values, away), values[0], values[0] * min(away / z[0], MOST))
            first_across += normal[m] * first[m]
            goes_on_across += normal[m] * _at(z, values, -depth)
        slips = first[axis] - first_across * normal[axis]
        sticks = -depth / away * slips
        goes_on = _at(height[:samples, axis], v[:samples, axis], -depth) - goes_on_across * normal[axis]
        along = sticks + share[0, axis] * (_between(goes_on, sticks, slips) - sticks)
        flat[behind[g]] = wall[axis] + along - depth / away * first_across * normal[axis]
