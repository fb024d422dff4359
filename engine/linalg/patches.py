"""Patches of rows that stand near each other in space, and the functions on them that coarse unknowns stand for."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints

MODES = 3  # scalar modes of a patch: constant, and linear along its two longest directions
WIDER = 1.1  # times the edge where patches are too many


@dataclass
class Patches:
    """The patches of rows that belong to one body each, or on a seam of two to two.

    A member is a number 2 row + slot; those of patch p are members[start[p]] ... members[start[p+1]-1]. Patches that share a
    block of the rows' matrix are neighbours: those of patch p are column[first[p]] ... column[first[p+1]-1], ascending.
    """

    of: Ints  # patches of every row, -1 for none, shape [n, 2]
    members: Ints  # by patches
    start: Ints  # shape [p+1]
    mode: Floats  # values of the scalar modes at every row, shape [n, 2, 3]
    first: Ints  # shape [p+1]
    column: Ints

    @property
    def count(self) -> int:
        """Number of patches."""
        return len(self.start) - 1


def form_patches(place: Floats, bodies: Ints, edge: float, most: int, start: Ints, column: Ints) -> Patches:
    """Return the patches of rows at `place` [n, 3] in cubes of `edge` [m], or larger ones where these would be more than `most`.

    `bodies` [n, 2] are numbers from 0, -1 for none; (start, column) is the pattern of the rows' matrix.
    """
    members = np.flatnonzero(bodies.ravel() >= 0)
    at, body = place[members // 2], bodies.ravel()[members]
    of_member = _cubes(at, body, edge)
    while of_member.max(initial=0) >= most and most > body.max():
        edge *= WIDER
        of_member = _cubes(at, body, edge)
    order = np.argsort(of_member, kind="stable")
    patch_start = np.searchsorted(of_member[order], np.arange(of_member[order[-1]] + 2)).astype(np.int64)
    of, by_patch = np.full(bodies.shape, -1, np.int64), members[order]
    of.reshape(-1)[members] = of_member
    mode = np.ones((bodies.size, MODES))
    mode[members, 1:] = _linear_modes(at, of_member, edge)
    return Patches(of, by_patch, patch_start, mode.reshape(-1, 2, MODES), *_neighbours(start, column, of, by_patch, patch_start))


def _linear_modes(place: Floats, patch: Ints, edge: float) -> Floats:
    """Coordinates of places about the middle of their patch, along its two longest directions, in edges, shape [n, 2]."""
    away = (place - _sums(patch, place)[patch] / np.bincount(patch)[patch, None]) / edge
    spread = _sums(patch, (away[:, :, None] * away[:, None, :]).reshape(-1, 9)).reshape(-1, 3, 3)
    _, directions = np.linalg.eigh(spread)
    return np.einsum("nck,nc->nk", directions[patch][:, :, :0:-1], away)


def _cubes(place: Floats, body: Ints, edge: float) -> Ints:
    """Number of the cube of each place among those of its body that are not empty, shape [n]."""
    cube = np.floor((place - place.min(axis=0)) / edge).astype(np.int64)
    sides = cube.max(axis=0) + 1
    key = ((body * sides[0] + cube[:, 0]) * sides[1] + cube[:, 1]) * sides[2] + cube[:, 2]
    return np.unique(key, return_inverse=True)[1].astype(np.int64)


def _sums(patch: Ints, value: Floats) -> Floats:
    return np.column_stack([np.bincount(patch, column) for column in value.T])


@njit(cache=True)
def _neighbours(start, column, of, members, patch_start):
    """Patches that the rows of each patch are coupled to, ascending, in compressed rows."""
    count = len(patch_start) - 1
    seen = np.full(count, -1, np.int64)
    first = np.zeros(count + 1, np.int64)
    neighbour = np.empty(64 * count + 64, np.int64)
    end = 0
    for p in range(count):
        for a in range(patch_start[p], patch_start[p + 1]):
            i = members[a] // 2
            for k in range(start[i], start[i + 1]):
                for q in of[column[k]]:
                    if q >= 0 and seen[q] != p:
                        seen[q] = p
                        if end == len(neighbour):
                            grown = np.empty(2 * end, np.int64)
                            grown[:end] = neighbour
                            neighbour = grown
                        neighbour[end] = q
                        end += 1
        neighbour[first[p]:end].sort()
        first[p + 1] = end
    return first, neighbour[:end].copy()
