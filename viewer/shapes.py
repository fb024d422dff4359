"""Triangle meshes of obstacles and of the surface of liquids, and the unit shapes that yarns and nodes are instances of."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from engine.contact.obstacles import ObstacleKind, Obstacles, posed
from engine.geometry.handles import Handles
from engine.run.frames import LiquidFrame
from viewer import layers
from viewer.layers import Bytes, Floats, Points, Segments

Faces = NDArray[np.uint32]
Shape = tuple[Floats, Faces]

OBSTACLE_COLOUR = (206, 200, 192)
PLANE_REACH = 6.0  # half side of the square that stands for a plane, in scene sizes
PLANE_COLOUR = (246, 245, 242)


@dataclass(frozen=True)
class Mesh:
    """Triangles, counter-clockwise seen from outside, of one colour; smooth where they share vertices."""

    vertices: Floats  # [m], shape [V, 3]
    faces: Faces  # shape [F, 3]
    colour: tuple[int, int, int]


@dataclass(frozen=True)
class Move:
    """A rigid motion: turned about the origin, then shifted."""

    position: NDArray[np.float64]  # [m], shape [3]
    wxyz: NDArray[np.float64]  # unit quaternion, shape [4]


@dataclass(frozen=True)
class Instances:
    """Copies of a unit shape: scaled along its own axes, turned, then moved."""

    positions: Floats  # shape [N, 3]
    wxyzs: Floats  # unit quaternions, shape [N, 4]
    scales: Floats  # shape [N, 3]


def cylinder(sides: int) -> Shape:
    """Return a cylinder of radius 1 about z, from z = -1/2 to 1/2: vertices and faces.

    Caps have vertices of their own, so that smooth shading keeps the rim sharp.
    """
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    half = np.array((0, 0, 0.5))
    low, high = ring - half, ring + half
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    fan = np.arange(1, sides - 1)
    hub = np.zeros_like(fan)
    faces = [
        np.stack([i, j, j + sides], 1),
        np.stack([i, j + sides, i + sides], 1),
        2 * sides + np.stack([hub, fan + 1, fan], 1),
        3 * sides + np.stack([hub, fan, fan + 1], 1),
    ]
    return np.concatenate([low, high, low, high]).astype(np.float32), np.concatenate(faces).astype(np.uint32)


def pipe(sides: int) -> Shape:
    """Return that cylinder without its ends: vertices and faces."""
    vertices, faces = cylinder(sides)
    return vertices[: 2 * sides], faces[: 2 * sides]


def sphere(rings: int) -> Shape:
    """Return a sphere of radius 1 of `rings` rings with twice as many sides: vertices and faces."""
    sides = 2 * rings
    polar = np.pi * np.arange(rings + 1)[:, None] / rings
    around = 2 * np.pi * np.arange(sides)[None] / sides
    x, y = np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around)
    grid = np.stack([x, y, np.broadcast_to(np.cos(polar), x.shape)], axis=-1)
    ring, side = (a.ravel() for a in np.meshgrid(np.arange(rings), np.arange(sides), indexing="ij"))
    a, b = ring * sides + side, ring * sides + (side + 1) % sides
    faces = np.concatenate([np.stack([a, a + sides, b + sides], 1), np.stack([a, b + sides, b], 1)])
    return grid.reshape(-1, 3).astype(np.float32), faces.astype(np.uint32)


def box() -> Shape:
    """Return the box from -1 to 1 on every axis, four vertices to a side: vertices and faces."""
    vertices: list[NDArray[np.float64]] = []
    faces: list[list[int]] = []
    square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], float)
    for axis in range(3):
        for sign in (1, -1):
            corner = np.full((4, 3), float(sign))
            corner[:, [(axis + 1) % 3, (axis + 2) % 3]] = square[::sign]
            faces += [[len(vertices) * 4 + k for k in t] for t in ((0, 1, 2), (0, 2, 3))]
            vertices.append(corner)
    return np.concatenate(vertices).astype(np.float32), np.array(faces, np.uint32)


def obstacle_mesh(
    obstacles: Obstacles, index: int, low: NDArray[np.float64], high: NDArray[np.float64]
) -> Mesh:
    """Return obstacle `index`, as it is before it moves, of a scene that extends from `low` to `high` [m].

    A plane is a large square around the scene.
    """
    kind, size = ObstacleKind(obstacles.kind[index]), obstacles.size[index]
    rotation, centre = obstacles.rotation[index], obstacles.centre[index]
    if kind is ObstacleKind.PLANE:
        local = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32)
        local *= PLANE_REACH * np.linalg.norm(high - low)
        local[:, :2] += (((low + high) / 2 - centre) @ rotation)[:2]
        faces = np.array([(0, 1, 2), (0, 2, 3)], np.uint32)
    elif kind is ObstacleKind.BOX:
        local, faces = box()
        local = local * size
    elif kind is ObstacleKind.SPHERE:
        local, faces = sphere(24)
        local = local * size[0]
    elif kind is ObstacleKind.MESH and obstacles.surfaces is not None:
        surface = obstacles.surfaces.surface[index]
        assert surface is not None
        local, faces = surface.vertices.astype(np.float32), surface.faces.astype(np.uint32)
    else:
        local, faces = cylinder(64)
        local = local * (size[0], size[0], 2 * size[1])
    vertices = (local @ rotation.T + centre).astype(np.float32)
    return Mesh(vertices, faces, PLANE_COLOUR if kind is ObstacleKind.PLANE else OBSTACLE_COLOUR)


def surface(liquid: LiquidFrame) -> Mesh:
    """Return the surface of a liquid."""
    return Mesh(liquid.surface_vertices, liquid.surface_faces.astype(np.uint32), layers.LIQUID_COLOUR)


def light(colours: Bytes) -> Bytes:
    """Return sRGB colours as shares of light, which is what viser takes the colours of instances for."""
    share = colours / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return (255 * linear).round().astype(np.uint8)


def changed_vertices(obstacles: Obstacles, time: float) -> dict[int, Floats]:
    """Return by index the vertices that obstacles which change their shape have at `time` [s], were they not moved [m]."""
    if obstacles.surfaces is None:
        return {}
    return {o: (obstacles.surfaces.vertices(o, time) @ obstacles.rotation[o].T + obstacles.centre[o]).astype(np.float32)
            for o, shapes in enumerate(obstacles.surfaces.shapes) if shapes is not None}


def moves(obstacles: Obstacles, handles: Handles, time: float) -> dict[int, Move]:
    """Return by index how obstacles that handles carry have moved up to `time` [s]."""
    if obstacles.handle is None:
        return {}
    now, found = posed(obstacles, handles, time), {}
    for o in np.flatnonzero(obstacles.handle >= 0):
        turn = now.rotation[o] @ obstacles.rotation[o].T
        xyzw = Rotation.from_matrix(turn).as_quat()
        found[int(o)] = Move(now.centre[o] - turn @ obstacles.centre[o], np.roll(xyzw, 1))
    return found


MANY = 5_000  # tubes or balls above which they are drawn with fewer sides, and open ends, which are too small to be seen
UNIT_TUBE, UNIT_PIPE = cylinder(12), pipe(6)
UNIT_BALL, UNIT_BEAD = sphere(6), sphere(3)
REACH = 0.6  # radii by which a tube reaches past its end at most


def tube(copies: int) -> Shape:
    """Return the unit tube for so many copies."""
    return UNIT_TUBE if copies <= MANY else UNIT_PIPE


def ball(copies: int) -> Shape:
    """Return the unit ball for so many copies."""
    return UNIT_BALL if copies <= MANY else UNIT_BEAD


def tubes(segments: Segments) -> Instances:
    """Return the copies of a unit tube that draw round segments.

    Where one segment goes on from the last, both reach past their common end until their outer sides meet.
    """
    start, end = segments.points[:, 0].astype(np.float64), segments.points[:, 1].astype(np.float64)
    along = end - start
    length = np.linalg.norm(along, axis=1)
    axis = np.divide(along, length[:, None], out=np.tile((0.0, 0.0, 1.0), (len(length), 1)), where=length[:, None] > 0)
    cosine = np.clip(np.einsum("ij,ij->i", axis[:-1], axis[1:]), -0.999, 1.0)
    reach = segments.radii[1:] * np.minimum(np.sqrt((1 - cosine) / (1 + cosine)), REACH)  # r tan(bend / 2)
    reach[(end[:-1] != start[1:]).any(axis=1)] = 0.0
    start[1:] -= reach[:, None] * axis[1:]
    end[:-1] += reach[:, None] * axis[:-1]
    length[1:] += reach
    length[:-1] += reach
    # the shortest rotation from z to the axis has quaternion (1 + z.a, z x a) up to length; opposite to z, turn about x
    wxyz = np.stack([1 + axis[:, 2], -axis[:, 1], axis[:, 0], np.zeros(len(axis))], axis=1)
    wxyz[axis[:, 2] < -1 + 1e-12] = (0, 1, 0, 0)
    wxyz /= np.linalg.norm(wxyz, axis=1, keepdims=True)
    scales = np.stack([segments.radii, segments.radii, length], axis=1)
    return Instances(*(a.astype(np.float32) for a in ((start + end) / 2, wxyz, scales)))


def balls(points: Points) -> Instances:
    """Return the copies of a unit ball that draw points."""
    wxyz = np.tile(np.array((1, 0, 0, 0), np.float32), (len(points.points), 1))
    return Instances(points.points, wxyz, np.repeat(points.radii[:, None], 3, axis=1))
