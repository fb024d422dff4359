"""Solids in the pose that they have at one time, packed for kernels."""

from typing import NamedTuple

import numpy as np
from numba import njit

from engine.arrays import Flags, Floats, Ints
from engine.geometry.sampled_distance import sampled_distance
from engine.geometry.signed_distance import signed_distance

SAMPLED = 4  # kind of a solid given by samples of its distance; those before it are those of `signed_distance`
SEARCHES = 3  # for the place at a distance; what is left falls by the bend of the surface over each


class Solids(NamedTuple):
    """K solids; `lattice` and `samples` are those of `sampled_distance`, of length 0 where nothing is sampled."""

    kind: Ints  # [K]
    centre: Floats  # [m], shape [K, 3]
    rotation: Floats  # columns are the local axes in the world, shape [K, 3, 3]
    size: Floats  # as `signed_distance` and `sampled_distance` take it [m], shape [K, 3]
    lattice: Ints  # shape [K, 4]
    samples: Floats  # [m], shape [sum of samples]


@njit(cache=True)
def distance_to(solids, o, x, normal):
    """Return the distance of x [3] to solid o [m], negative inside, and write its gradient to `normal` [3]."""
    if solids.kind[o] == SAMPLED:
        return sampled_distance(solids.lattice[o], solids.samples, solids.centre[o], solids.rotation[o], solids.size[o], x,
                                normal)
    return signed_distance(solids.kind[o], solids.centre[o], solids.rotation[o], solids.size[o], x, normal)


def inside(solids: Solids, x: Floats) -> Flags:
    """Return which places x [n, 3] [m] are in one of the solids, shape [n]."""
    return ~clear_of(solids, x, 0.0)


def clear_of(solids: Solids, x: Floats, reach: float) -> Flags:
    """Return which places x [n, 3] [m] are no nearer than `reach` [m] to any of the solids, shape [n]."""
    clear = np.ones(len(x), np.bool_)
    _mark_near(solids, x, reach, clear)
    return clear


@njit(cache=True)
def _mark_near(solids, x, reach, clear):
    normal = np.empty(3)
    for p in range(len(x)):
        for o in range(len(solids.kind)):
            clear[p] &= distance_to(solids, o, x[p], normal) >= reach


def moved_along(begin: Solids, end: Solids, o: int, x: Floats) -> Floats:
    """Return where places x [n, 3] [m] on solid o, as it is in `begin`, are when it is as in `end`, shape [n, 3].

    They move rigidly with it and, where it changes its shape, along its normals as well, so that they keep their distance.
    """
    there = x
    if not (np.array_equal(begin.centre[o], end.centre[o]) and np.array_equal(begin.rotation[o], end.rotation[o])):
        turn = end.rotation[o] @ begin.rotation[o].T
        there = end.centre[o] + (x - begin.centre[o]) @ turn.T
    if begin.kind[o] == SAMPLED and begin.samples is not end.samples:
        there = there.copy()
        _keep_distances(begin, end, o, x, there)
    return there


@njit(cache=True)
def _keep_distances(begin, end, o, x, there):
    """Move places `there` [n, 3] along the gradient of their distance until it is that which x [n, 3] had before."""
    normal = np.empty(3)
    for v in range(len(x)):
        distance = distance_to(begin, o, x[v], normal)
        for _ in range(SEARCHES):
            left = distance - distance_to(end, o, there[v], normal)
            for k in range(3):
                there[v, k] += left * normal[k]


@njit(cache=True)
def to_unit(normal):
    """Scale a vector [3] to a length of 1, if it has any: samples may have no slope in the middle of a body."""
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
    to_unit(normal)
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
