"""Roots of strands on bodies that change their shape: each goes with the triangle that it grows on.

A root keeps its barycentric coordinates. What is held behind it turns by the rotation that is nearest to how its triangle has
deformed since the start, its polar decomposition: no edge is stretched, and which corner comes first makes no difference.
"""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Floats, Ints
from engine.contact.obstacles import Obstacles, poses
from engine.contact.surface import Surface
from engine.geometry.handles import Handles
from engine.strands.handles import turns_of_edges
from engine.strands.model import StrandModel, StrandState


@dataclass(frozen=True)
class SurfaceRoots:
    """The n vertices that one body holds, of the strands that grow on it."""

    obstacle: int  # the body
    vertex: Ints  # shape [n]
    corner: Ints  # corners of the triangle that its strand grows on, as vertices of the surface, shape [n, 3]
    weight: Floats  # barycentric coordinates of the root, shape [n, 3]
    offset: Floats  # from the root at the start, in the body's own frame [m], shape [n, 3]

    def at(self, obstacles: Obstacles, handles: Handles, time: float) -> tuple[Floats, Floats]:
        """Return the places [n, 3] [m] at `time` [s], and the rotations [n, 3, 3] from the body's own frame at the start."""
        assert obstacles.surfaces is not None
        start, now = (obstacles.surfaces.vertices(self.obstacle, t)[self.corner] for t in (0.0, time))
        centre, rotation = poses(obstacles, handles, time)
        turned = rotation[self.obstacle] @ _nearest_rotations(start, now)
        root = np.einsum("nc,nck->nk", self.weight, now) @ rotation[self.obstacle].T + centre[self.obstacle]
        return root + np.einsum("nij,nj->ni", turned, self.offset), turned


def rooted(obstacles: Obstacles, obstacle: int, x: Floats, root: Ints, vertex: Ints) -> SurfaceRoots:
    """Return how a body holds the vertices [n], whose strands have their `root` [n] on its surface, all at x [V, 3] [m]."""
    assert obstacles.surfaces is not None
    surface = obstacles.surfaces.surface[obstacle]
    assert surface is not None
    local = (x - obstacles.centre[obstacle]) @ obstacles.rotation[obstacle]
    corner, weight = _triangles_at(local[root], surface)
    return SurfaceRoots(obstacle, vertex, corner, weight, local[vertex] - local[root])


def follow(
    held: SurfaceRoots, model: StrandModel, state: StrandState, obstacles: Obstacles, handles: Handles, time: float, h: float,
    x: Floats, turn: Floats,
) -> None:
    """Write to x [V, 3] [m] and `turn` [V] [rad], as `given` returns them, where the body takes what it holds in a step."""
    _, before = held.at(obstacles, handles, time)
    x[held.vertex], after = held.at(obstacles, handles, time + h)
    edges = model.held[held.vertex, 3]
    turned = held.vertex[edges]
    turn[turned] = turns_of_edges(state.x, turned, (after @ before.transpose(0, 2, 1))[edges])


def _triangles_at(places: Floats, surface: Surface) -> tuple[Ints, Floats]:
    """Corners [n, 3] of the triangles that `places` [n, 3] lie on, and their barycentric coordinates there, shape [n, 3]."""
    corners = surface.vertices[surface.faces]
    margin = 1e-9 * float(surface.extent.max())
    low, high = corners.min(axis=1) - margin, corners.max(axis=1) + margin
    found, weights = np.empty(len(places), np.int64), np.empty((len(places), 3))
    for n, place in enumerate(places):
        near = np.flatnonzero(((low <= place) & (place <= high)).all(axis=1))
        weight = _barycentric(corners[near], place)
        inside = np.maximum(weight, 0.0)
        inside /= inside.sum(axis=1)[:, None]
        nearest = np.argmin(np.linalg.norm(np.einsum("fc,fck->fk", inside, corners[near]) - place, axis=1))
        found[n], weights[n] = near[nearest], inside[nearest]
    return surface.faces[found], weights


def _barycentric(corners: Floats, place: Floats) -> Floats:
    """Barycentric coordinates of `place` [3], seen along their normals, in triangles with `corners` [F, 3, 3], shape [F, 3]."""
    edge = corners[:, 1:] - corners[:, :1]
    product = np.einsum("fik,fjk->fij", edge, edge)
    share = np.linalg.solve(product, np.einsum("fik,fk->fi", edge, place - corners[:, 0])[:, :, None])[:, :, 0]
    return np.column_stack([1.0 - share.sum(axis=1), share])


def _nearest_rotations(start: Floats, now: Floats) -> Floats:
    """Rotations [n, 3, 3] nearest to what takes triangles with the corners `start` [n, 3, 3] and their normals to `now`."""
    u, _, v = np.linalg.svd(_frames(now) @ np.linalg.inv(_frames(start)))
    return u @ v


def _frames(corners: Floats) -> Floats:
    """Two edges and the unit normal of each triangle as columns, shape [n, 3, 3]."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(first, second)
    return np.stack([first, second, normal / np.linalg.norm(normal, axis=1)[:, None]], axis=2)
