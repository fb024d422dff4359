"""Places spread evenly over the surfaces that strands grow on."""

from collections.abc import Callable
from functools import partial
from math import cos, radians

import numpy as np
from scipy.spatial import cKDTree

from engine.arrays import Floats, Ints
from engine.scene.meshes import surface_of
from engine.scene.placement import axes
from engine.scene.schema import Box, Cylinder, Mesh, Obstacle, Sphere
from engine.scene.strand_groups import Groom

CANDIDATES = 5  # places at random for each one that is kept
EVERYWHERE = -2.0  # less than any cosine
ROUND_OFF = 1e-9  # of cosines: sides of a box at right angles to a way do not face it

Draw = Callable[[np.random.Generator, int], tuple[Floats, Floats]]  # places and unit normals, each of shape [n, 3]


def roots(groom: Groom, body: Obstacle | None, random: np.random.Generator) -> tuple[Floats, Floats]:
    """Return where the strands of a groom begin [m] and unit normals of the surface there, each of shape [count, 3]."""
    draw = ground(groom, body)
    assert draw is not None  # the scene was refused otherwise
    places, normals = draw(random, CANDIDATES * groom.count)
    kept = spread(places, groom.count)
    return places[kept], normals[kept]


def spread(places: Floats, count: int) -> Ints:
    """Return which `count` of the places [n, 3] are left when those nearest to each other are thinned out, ascending.

    In turn, of the pairs that are nearest to each other, the closer half lose the one that has the less room otherwise.
    """
    kept = np.arange(len(places))
    while len(kept) > count:
        distance, neighbour = cKDTree(places[kept]).query(places[kept], k=[2, 3])
        nearest, room, own = neighbour[:, 0], distance[:, 1], np.arange(len(kept))
        narrower = (room < room[nearest]) | ((room == room[nearest]) & (own > nearest))
        losing = np.flatnonzero((nearest[nearest] == own) & narrower)
        if not len(losing):  # places that coincide
            return kept[:count]
        closest = losing[np.argsort(distance[losing, 0], kind="stable")]
        kept = np.delete(kept, closest[: min(len(kept) - count, (len(closest) + 1) // 2)])
    return kept


def ground(groom: Groom, body: Obstacle | None) -> Draw | None:
    """Return what draws places at random, evenly by area, where a groom grows; None where its surface nowhere faces so.

    `body` is the obstacle that it grows on, None for its own rectangle.
    """
    facing, least = np.array([0.0, 0.0, 1.0]), EVERYWHERE
    if groom.facing is not None:
        facing = np.array(groom.facing) / np.linalg.norm(groom.facing)
        least = cos(radians(groom.within)) if groom.within < 180.0 else EVERYWHERE
    if isinstance(body, Sphere):
        return partial(_on_cap, body, facing, max(least, -1.0))
    if isinstance(body, Cylinder):
        return _on_side(body, facing, least)
    if isinstance(body, Mesh):
        surface = surface_of(body)
        corners = surface.vertices[surface.faces]
    elif isinstance(body, Box):
        corners = _box(np.array(body.size) / 2)
    else:
        assert groom.rectangle is not None  # grooms on planes are refused
        corners = _quadrangle(np.zeros(3), *np.diag([*groom.rectangle, 0.0])[:2] / 2)
    place = groom if body is None else body
    corners = corners @ axes(place.rotation).T + np.array(place.position)
    return _on_triangles(corners, facing, least)


def _on_cap(ball: Sphere, facing: Floats, least: float, random: np.random.Generator, count: int) -> tuple[Floats, Floats]:
    """Draw places whose normals have a cosine of `least` or more to `facing`."""
    along, angle = 1.0 - (1.0 - least) * random.random(count), 2.0 * np.pi * random.random(count)
    radius = np.sqrt(np.maximum(1.0 - along * along, 0.0))
    first = np.cross(facing, np.eye(3)[np.argmin(np.abs(facing))])
    first /= np.linalg.norm(first)
    frame = np.array([first, np.cross(facing, first), facing])
    normal = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), along]) @ frame
    return np.array(ball.position) + ball.radius * normal, normal


def _on_side(cylinder: Cylinder, facing: Floats, least: float) -> Draw | None:
    frame = axes(cylinder.rotation)
    x, y, _ = facing @ frame
    across = np.hypot(x, y)  # the largest cosine that a normal of the side has
    if least >= across - ROUND_OFF and least > EVERYWHERE:
        return None
    middle = np.arctan2(y, x)
    reach = np.pi if least <= -across else np.arccos(least / across)

    def draw(random: np.random.Generator, count: int) -> tuple[Floats, Floats]:
        angle = middle + reach * (2.0 * random.random(count) - 1.0)
        height = cylinder.height * (random.random(count) - 0.5)
        normal = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
        local = cylinder.radius * normal + height[:, None] * np.array([0.0, 0.0, 1.0])
        return np.array(cylinder.position) + local @ frame.T, normal @ frame.T

    return draw


def _on_triangles(corners: Floats, facing: Floats, least: float) -> Draw | None:
    """Draw from triangles with `corners` [F, 3, 3], counter-clockwise seen from outside."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)  # twice of it
    normal /= area[:, None]
    there = normal @ facing > least + ROUND_OFF
    if not there.any():
        return None
    corners, normal, reached = corners[there], normal[there], np.cumsum(area[there])

    def draw(random: np.random.Generator, count: int) -> tuple[Floats, Floats]:
        which = np.minimum(np.searchsorted(reached, reached[-1] * random.random(count)), len(reached) - 1)
        far, share = np.sqrt(random.random(count)), random.random(count)
        weight = np.column_stack([1.0 - far, far * (1.0 - share), far * share])
        return np.einsum("nc,nck->nk", weight, corners[which]), normal[which]

    return draw


def _box(half: Floats) -> Floats:
    """Triangles of a box with half extents `half` [3], shape [12, 3, 3]."""
    along, sides = np.diag(half), []
    for k in range(3):
        out, first, second = along[k], along[(k + 1) % 3], along[(k + 2) % 3]
        sides += [_quadrangle(out, first, second), _quadrangle(-out, second, first)]
    return np.concatenate(sides)


def _quadrangle(middle: Floats, first: Floats, second: Floats) -> Floats:
    """Two triangles that make a parallelogram with half sides `first` and `second` [3], shape [2, 3, 3]."""
    a, b, c, d = (middle + s * first + t * second for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    return np.array([[a, b, c], [a, c, d]])
