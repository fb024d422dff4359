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
from engine.liquid.mirror import parents

NEAREST = 0.5  # spacings before a wall, at which velocities are looked at first; then at every spacing on
SAMPLES = 3  # of velocities, at most: what goes on is a parabola
APART = 0.25  # spacings by which faces that stand for them must differ


@njit(cache=True)
def _sample(grid, b, x, normal, away, before, u, parent, weight, velocity, height):
    """Write the velocity [3] at x, `away` [m] before a wall, and the height [3] above it of the faces that it is of.

    Returns whether every component has such faces, of which `parent` and `weight` [8] are the last component's.
    """
    for m in range(3):
        weight[:] = 0.0
        total, moment = parents(grid, b, x, m, normal, away, before, parent, weight)
        if total == 0.0:
            return False
        height[m], velocity[m] = moment / total, 0.0
        for n in range(8):
            velocity[m] += weight[n] / total * u[parent[n]]
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


@njit(cache=True, parallel=True)
def extend(grid, begin, end, h, behind, mass, inertia, u):
    """Let u [3, B, 64] [m/s], which is a mirror image at the faces `behind` [G] walls that stick, go on there.

    Along the wall it goes on smoothly from what it is before, yet stays between what sticks and what slips, and is closer to what
    sticks the less is the share of `inertia` [3, B, 64] in what holds faces back. Walls move from `begin` to `end` in h [s];
    faces without `mass` [3, B, 64] have no velocity to look at.
    """
    flat, free, before = u.reshape(-1), inertia.reshape(-1), mass.reshape(-1) > 0.0
    before[behind] = False
    for g in prange(len(behind)):
        axis, b, c = behind[g] // (CELLS * len(grid.place)), behind[g] // CELLS % len(grid.place), behind[g] % CELLS
        x, normal, image, unused, wall = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        at, height, share = np.empty((SAMPLES, 3)), np.empty((SAMPLES, 3)), np.empty(3)
        parent, weight = np.zeros(8, np.int32), np.zeros(8)
        centre_of(grid, b, c, axis, x)
        distance, o = nearest(end, x, normal)
        depth = max(-distance, 0.0)
        velocity_of(begin, end, o, x, h, wall)
        for k in range(3):
            image[k] = x[k] + 2.0 * depth * normal[k]
        if nearest(end, image, unused)[0] < 0.0:
            continue  # a corner: behind both walls it is a mirror image of a mirror image
        away, samples = max(depth, NEAREST * grid.spacing), 0
        for k in range(3):
            image[k] = x[k] + (depth + away) * normal[k]
        if not _sample(grid, b, image, normal, away, before, free, parent, weight, share, unused):
            continue
        while samples < SAMPLES and _sample(grid, b, image, normal, away + samples * grid.spacing, before, flat, parent, weight,
                                            at[samples], height[samples]):
            apart = np.inf
            for m in range(3):
                apart = min(apart, height[samples, m] - height[max(samples - 1, 0), m])
            if samples > 0 and apart < APART * grid.spacing:
                break
            for k in range(3):
                image[k] += grid.spacing * normal[k]
            samples += 1
        if samples < 2:
            continue
        into, rise = 0.0, 0.0
        for m in range(3):
            at[:samples, m] -= wall[m]
            into += normal[m] * _at(height[:samples, m], at[:samples, m], away)
            rise += normal[m] * _at(height[:samples, m], at[:samples, m], -depth)
        slips = _at(height[:samples, axis], at[:samples, axis], away) - into * normal[axis]
        on = _at(height[:samples, axis], at[:samples, axis], -depth) - rise * normal[axis]
        stuck = -depth / away * slips
        along = stuck + share[axis] * (min(max(on, min(stuck, slips)), max(stuck, slips)) - stuck)
        flat[behind[g]] = wall[axis] + along - depth / away * into * normal[axis]
