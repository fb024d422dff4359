"""Rigid obstacles as packed signed distances, with penalty contact and anchored Coulomb friction.

A point nearer than its contact distance feels the potential k (distance - sdf)^2 / 2. Friction holds it to an anchor on
the obstacle by a tangential spring up to mu times the normal force of the last step, like friction between yarns.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints
from engine.geometry.signed_distance import signed_distance


class ObstacleKind(IntEnum):
    """Shape of an obstacle in its own frame."""

    PLANE = 0  # solid below its local z = 0
    BOX = 1  # size: half extents
    SPHERE = 2  # size[0]: radius
    CYLINDER = 3  # axis along local z; size[0]: radius, size[1]: half height


@dataclass(frozen=True)
class Obstacles:
    """K obstacles; friction is theirs, and acts on whatever touches them."""

    kind: Ints  # ObstacleKind, shape [K]
    centre: Floats  # [m], shape [K, 3]
    rotation: Floats  # columns are the local axes in the world, shape [K, 3, 3]
    size: Floats  # [m], shape [K, 3]
    friction: Floats  # Coulomb coefficient, shape [K]


@njit(cache=True)
def add_gradient(
    points, kind, centre, rotation, size, friction, distance, stiffness, anchor, last_force, x0, x, gradient
):
    """Add the gradient to `gradient` [P, 5] and return the energy [J].

    `points` may touch obstacles; contact `distance` [m], `stiffness` [N/m], friction `anchor` [P, 3] and `last_force`
    [N] are given for every point, x0 is x at the start of the step.
    """
    energy = 0.0
    normal, slip = np.empty(3), np.empty(3)
    for p in points:
        for o in range(len(kind)):
            depth = distance[p] - signed_distance(kind[o], centre[o], rotation[o], size[o], x[p], normal)
            if depth > 0.0:
                energy += 0.5 * stiffness[p] * depth * depth
                for k in range(3):
                    gradient[p, k] -= stiffness[p] * depth * normal[k]
        o = _nearest(kind, centre, rotation, size, x0[p], normal)
        limit = friction[o] * last_force[p]
        if limit > 0.0:
            length = _slip(x[p], anchor[p], normal, slip)
            reach = limit / stiffness[p]
            if length <= reach:
                energy += 0.5 * stiffness[p] * length * length
                pull = stiffness[p]
            else:
                energy += limit * (length - 0.5 * reach)
                pull = limit / length
            for k in range(3):
                gradient[p, k] += pull * slip[k]
    return energy


@njit(cache=True)
def add_hessian(
    points, kind, centre, rotation, size, friction, distance, stiffness, anchor, last_force, x0, x, diagonal, block
):
    """Add a positive semidefinite Hessian to the diagonal blocks: the curvature of obstacles is left out."""
    normal, slip = np.empty(3), np.empty(3)
    for p in points:
        b = diagonal[p]
        for o in range(len(kind)):
            depth = distance[p] - signed_distance(kind[o], centre[o], rotation[o], size[o], x[p], normal)
            if depth > 0.0:
                for r in range(3):
                    for c in range(3):
                        block[b, r, c] += stiffness[p] * normal[r] * normal[c]
        o = _nearest(kind, centre, rotation, size, x0[p], normal)
        limit = friction[o] * last_force[p]
        if limit > 0.0:
            length = _slip(x[p], anchor[p], normal, slip)
            sticks = length <= limit / stiffness[p]
            pull = stiffness[p] if sticks else limit / length
            for r in range(3):
                block[b, r, r] += pull
                for c in range(3):
                    block[b, r, c] -= pull * normal[r] * normal[c]
                    if not sticks:
                        block[b, r, c] -= pull * slip[r] * slip[c] / (length * length)


@njit(cache=True)
def settle(points, kind, centre, rotation, size, friction, distance, stiffness, x, anchor, force, last_force):
    """Move friction anchors at the end of a step and write the normal forces of the next one.

    Returns the deepest penetration of a centre line into a solid [m].
    """
    normal, slip = np.empty(3), np.empty(3)
    deepest = 0.0
    for p in points:
        o = _nearest(kind, centre, rotation, size, x[p], normal)
        gap = signed_distance(kind[o], centre[o], rotation[o], size[o], x[p], normal)
        deepest = max(deepest, -gap)
        force[p] = stiffness[p] * max(distance[p] - gap, 0.0)
        reach = friction[o] * last_force[p] / stiffness[p]
        length = _slip(x[p], anchor[p], normal, slip)
        if force[p] == 0.0 or reach == 0.0:
            anchor[p] = x[p]
        else:
            keep = min(1.0, reach / length) if length > 0.0 else 1.0
            for k in range(3):
                anchor[p, k] = x[p, k] - keep * slip[k]
    return deepest


@njit(cache=True)
def _nearest(kind, centre, rotation, size, x, normal):
    """Index of the obstacle nearest to x; its normal is written."""
    best, least = 0, np.inf
    for o in range(len(kind)):
        distance = signed_distance(kind[o], centre[o], rotation[o], size[o], x, normal)
        if distance < least:
            best, least = o, distance
    signed_distance(kind[best], centre[best], rotation[best], size[best], x, normal)
    return best


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
