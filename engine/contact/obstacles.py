"""Rigid obstacles by signed distance, with penalty contact and anchored Coulomb friction.

A point nearer than its contact distance feels the potential k (distance - sdf)^2 / 2 of the obstacle where it is at the
end of the step. Friction holds the point to an anchor on the obstacle by a tangential spring up to mu times the normal
force of the last step, like friction between yarns; the anchor moves with the obstacle.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints
from engine.contact.surface import Surfaces
from engine.geometry.handles import Handles
from engine.geometry.solids import SAMPLED, Solids, distance_to, nearest
from engine.yarns.coulomb import follow, huber


class ObstacleKind(IntEnum):
    """Shape of an obstacle in its own frame."""

    PLANE = 0  # solid below its local z = 0
    BOX = 1  # size: half extents
    SPHERE = 2  # size[0]: radius
    CYLINDER = 3  # axis along local z; size[0]: radius, size[1]: half height
    MESH = SAMPLED  # a closed surface; size: half extents of the grid that samples its distance


@dataclass(frozen=True)
class Obstacles:
    """K obstacles as they stand before anything moves; friction is theirs, and acts on whatever touches them."""

    kind: Ints  # ObstacleKind, shape [K]
    centre: Floats  # [m], shape [K, 3]
    rotation: Floats  # columns are the local axes in the world, shape [K, 3, 3]
    size: Floats  # [m], shape [K, 3]
    friction: Floats  # Coulomb coefficient, shape [K]
    handle: Ints | None = None  # script handle that carries each, -1 for none, shape [K]; None where nothing moves
    surfaces: Surfaces | None = None  # of the meshes among them


@dataclass(frozen=True)
class ObstacleMotion:
    """Obstacles during one step."""

    begin: Solids
    end: Solids
    friction: Floats  # [K]


def poses(obstacles: Obstacles, handles: Handles, time: float) -> tuple[Floats, Floats]:
    """Return centres [K, 3] [m] and rotations [K, 3, 3] of the obstacles at `time` [s]."""
    centre, rotation = obstacles.centre, obstacles.rotation
    if obstacles.handle is not None:
        carried = obstacles.handle >= 0
        centre, rotation = centre.copy(), rotation.copy()
        handle = obstacles.handle[carried]
        centre[carried] = handles.carry(centre[carried], handle, 0.0, time)
        rotation[carried] = handles.turns(time)[handle] @ rotation[carried]
    return centre, rotation


def posed(obstacles: Obstacles, handles: Handles, time: float) -> Solids:
    """Return the obstacles where they are at `time` [s], in the shape that they have then."""
    centre, rotation = poses(obstacles, handles, time)
    if obstacles.surfaces is None:
        lattice, samples = np.zeros((len(centre), 4), np.int64), np.zeros(0)
    else:
        lattice, samples = obstacles.surfaces.lattice, obstacles.surfaces.samples(time)
    return Solids(obstacles.kind, centre, rotation, obstacles.size, lattice, samples)


def motion(obstacles: Obstacles, handles: Handles, time: float, h: float) -> ObstacleMotion:
    """Return how the obstacles move and change in the step of `h` from `time` [s]."""
    end = posed(obstacles, handles, time + h)
    changing = obstacles.surfaces is not None and any(obstacles.surfaces.shapes)
    begin = posed(obstacles, handles, time) if changing or obstacles.handle is not None else end
    return ObstacleMotion(begin, end, obstacles.friction)


@njit(cache=True)
def carry(points, begin, end, friction, last_force, x0, anchor, normal, limit):
    """Take friction to the end of a step: write the `normal` [P, 3] and `limit` [P] [N], move `anchor` [P, 3].

    The obstacle nearest to a point at the start of the step, x0, holds it: anchor and normal go along with that obstacle,
    so that the potential of the step is smooth where it reaches across an edge.
    """
    local = np.empty(3)
    for p in points:
        _, o = nearest(begin, x0[p], local)
        limit[p] = friction[o] * last_force[p]
        for k in range(3):
            normal[p, k] = local[k]
        _turn(begin.rotation[o], end.rotation[o], normal[p])
        for k in range(3):
            anchor[p, k] -= begin.centre[o, k]
        _turn(begin.rotation[o], end.rotation[o], anchor[p])
        for k in range(3):
            anchor[p, k] += end.centre[o, k]


@njit(cache=True)
def add_gradient(points, solids, distance, stiffness, anchor, normal, limit, x, gradient):
    """Add the gradient to `gradient` [P, 5] and return the energy [J].

    `points` may touch obstacles; contact `distance` [m], `stiffness` [N/m], and `anchor`, `normal`, `limit` of friction
    as `carry` leaves them are given for every point.
    """
    energy = 0.0
    outward, slip = np.empty(3), np.empty(3)
    for p in points:
        for o in range(len(solids.kind)):
            depth = distance[p] - distance_to(solids, o, x[p], outward)
            if depth > 0.0:
                energy += 0.5 * stiffness[p] * depth * depth
                for k in range(3):
                    gradient[p, k] -= stiffness[p] * depth * outward[k]
        if limit[p] > 0.0:
            length = _slip(x[p], anchor[p], normal[p], slip)
            added, force = huber(length, stiffness[p], limit[p])
            energy += added
            for k in range(3):
                gradient[p, k] += force * slip[k]
    return energy


@njit(cache=True)
def add_hessian(points, solids, distance, stiffness, anchor, normal, limit, pull, x, diagonal, block):
    """Add a positive semidefinite Hessian to the diagonal blocks: the curvature of obstacles is left out.

    `pull` [P, 3] is the friction over its limit, as Newton follows it.
    """
    outward, slip = np.empty(3), np.empty(3)
    for p in points:
        b = diagonal[p]
        for o in range(len(solids.kind)):
            depth = distance[p] - distance_to(solids, o, x[p], outward)
            if depth > 0.0:
                for r in range(3):
                    for c in range(3):
                        block[b, r, c] += stiffness[p] * outward[r] * outward[c]
        if limit[p] > 0.0:
            length = _slip(x[p], anchor[p], normal[p], slip)
            sticks = length <= limit[p] / stiffness[p]
            rigidity = stiffness[p] if sticks else limit[p] / length
            for r in range(3):
                block[b, r, r] += rigidity
                for c in range(3):
                    block[b, r, c] -= rigidity * normal[p, r] * normal[p, c]
                    if not sticks:
                        block[b, r, c] -= 0.5 * rigidity / length * (pull[p, r] * slip[c] + slip[r] * pull[p, c])


@njit(cache=True)
def update_pull(points, stiffness, anchor, normal, limit, x, dx, pull):
    """Let the `pull` [P, 3] follow an update dx [P, 3] of x; with dx = 0 it is the friction at x over its limit."""
    slip, change = np.empty(3), np.empty(3)
    for p in points:
        if limit[p] > 0.0:
            length = _slip(x[p], anchor[p], normal[p], slip)
            along = 0.0
            for k in range(3):
                along += dx[p, k] * normal[p, k]
            for k in range(3):
                change[k] = dx[p, k] - along * normal[p, k]
            follow(slip, change, length, limit[p] / stiffness[p], pull[p])


@njit(cache=True)
def settle(points, solids, distance, stiffness, limit, x, anchor, force):
    """Move friction anchors at the end of a step and write the normal forces of the next one.

    Returns the deepest penetration of a centre line into a solid [m].
    """
    normal, slip = np.empty(3), np.empty(3)
    deepest = 0.0
    for p in points:
        _, o = nearest(solids, x[p], normal)
        gap = distance_to(solids, o, x[p], normal)
        deepest = max(deepest, -gap)
        force[p] = stiffness[p] * max(distance[p] - gap, 0.0)
        reach = limit[p] / stiffness[p]
        length = _slip(x[p], anchor[p], normal, slip)
        keep = 0.0
        if force[p] > 0.0:
            keep = min(1.0, reach / length) if length > 0.0 else 1.0
        for k in range(3):
            anchor[p, k] = x[p, k] - keep * slip[k]
    return deepest


@njit(cache=True)
def _turn(before, after, v):
    """Turn v as the axes `before` turn to those `after`, in place."""
    along = np.zeros(3)
    for m in range(3):
        for k in range(3):
            along[m] += before[k, m] * v[k]
    for k in range(3):
        v[k] = after[k, 0] * along[0] + after[k, 1] * along[1] + after[k, 2] * along[2]


@njit(cache=True)
def _slip(x, anchor, normal, slip):
    """Write the tangential part of x - anchor and return its length."""
    along = 0.0
    for k in range(3):
        along += (x[k] - anchor[k]) * normal[k]
    length = 0.0
    for k in range(3):
        slip[k] = x[k] - anchor[k] - along * normal[k]
        length += slip[k] * slip[k]
    return np.sqrt(length)
