"""How the strands of a groom grow from their roots: combed, in tufts, in curls."""

from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from engine.arrays import Floats
from engine.scene.schema import Obstacle
from engine.scene.strand_groups import Curl, Groom
from engine.scene.surfaces import roots, spread

LEAST_RISE = 0.2  # of a strand's way, along the normal of the surface
APART = 1.1  # distance of strands in a tuft at least, in their thickness
PIECES = 16  # of a strand's way for each vertex, along which its length is measured
LONGEST = 1.5  # of its length that are laid out: tufts shorten the way of some strands


@lru_cache(maxsize=8)  # a job's simulation and its recorder ask for the same
def grown(groom: Groom, body: Obstacle | None, vertices: int, radius: float) -> Floats:
    """Return the vertices of all strands [m], shape [count, vertices, 3], at even distances along each; not to be changed.

    `body` is the obstacle that they grow on, None for the groom's own rectangle; `radius` is their largest [m].
    """
    random = np.random.default_rng(groom.seed)
    root, normal = roots(groom, body, random)
    way = _ways(groom, normal)
    length = groom.length * (1.0 + groom.length_spread * random.uniform(-1.0, 1.0, groom.count))
    middle, least = _tufts(groom, root, radius)
    strands = np.empty((groom.count, vertices, 3))
    for s in range(groom.count):
        along = np.linspace(0.0, LONGEST * length[s], PIECES * vertices)[:, None]
        x = root[s] + along * way[s]
        if groom.clump is not None:
            m = middle[s]
            share = np.minimum(along / length[s], 1.0) ** 2
            nearness = np.minimum(groom.clump.strength * share, 1.0 - least)
            x += nearness * (root[m] + along * way[m] - x)
        if groom.curl is not None:
            x += _helix(groom.curl, along, way[s])
        strands[s] = at_even_distances(x, vertices, length[s])
    strands.flags.writeable = False
    return strands


def at_even_distances(x: Floats, count: int, length: float | None = None) -> Floats:
    """Return `count` places at even distances along the line through `x` [n, 3], up to `length` [m] if it is as long."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))])
    place = np.linspace(0.0, arc[-1] if length is None else min(length, arc[-1]), count)
    return np.column_stack([np.interp(place, arc, x[:, k]) for k in range(3)])


def _ways(groom: Groom, normal: Floats) -> Floats:
    """Unit vectors along which strands grow from places with the normals [n, 3]: combed, but never into the surface."""
    if groom.direction is None:
        return normal
    comb = np.array(groom.direction) / np.linalg.norm(groom.direction)
    way = (1.0 - groom.lean) * normal + groom.lean * comb
    rise = np.einsum("nk,nk->n", way, normal)
    level = way - rise[:, None] * normal
    width = np.linalg.norm(level, axis=1)
    # as steep as LEAST_RISE at least
    rise = np.maximum(rise, LEAST_RISE / np.sqrt(1.0 - LEAST_RISE**2) * width)
    flat = np.hypot(rise, width) == 0.0  # combed straight against the surface
    way = level + np.where(flat, 1.0, rise)[:, None] * normal
    return way / np.linalg.norm(way, axis=1)[:, None]


def _tufts(groom: Groom, root: Floats, radius: float) -> tuple[list[int], float]:
    """The strand in the middle of each strand's tuft, and the share of their distance that strands must keep."""
    if groom.clump is None or groom.count == 1:
        return list(range(groom.count)), 1.0
    middles = spread(root, groom.clump.count)
    _, tuft = cKDTree(root[middles]).query(root)
    nearest = cKDTree(root).query(root, k=2)[0][:, 1].min()
    return middles[tuft].tolist(), float(min(1.0, 2.0 * APART * radius / nearest)) if nearest > 0.0 else 1.0


def _helix(curl: Curl, along: Floats, way: Floats) -> Floats:
    """How far curls take a strand off its straight `way` [3] at the distances `along` it [n, 1], shape [n, 3] [m]."""
    up = np.array([0.0, 0.0, 1.0])
    if way @ up < -1.0 + 1e-9:
        first = np.array([1.0, 0.0, 0.0])
    else:  # x, turned as the vertical turns to the way: much the same for neighbours
        first = np.array([1.0, 0.0, 0.0]) - way[0] / (1.0 + way @ up) * (up + way)
    second = np.cross(way, first)
    angle = 2.0 * np.pi * along / curl.pitch
    begun = np.minimum(along / curl.pitch, 1.0)
    return curl.radius * begun**2 * (3.0 - 2.0 * begun) * (np.cos(angle) * first + np.sin(angle) * second)
