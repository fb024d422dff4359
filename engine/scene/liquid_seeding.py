"""Particles on lattices: those of shapes full of liquid, and those of the openings that it flows from.

A lattice stands in the frame of its shape and is drawn together or apart a little, so that its particles, all of the volume
that lies between them, have the volume of the shape. Only that of a mesh stays as it is.
"""

from functools import lru_cache
from math import ceil, inf, pi
from typing import TYPE_CHECKING

import numpy as np

from engine.arrays import Flags, Floats
from engine.scene.liquid import Liquid, LiquidBall, LiquidBox, LiquidCylinder, LiquidMesh, LiquidShape, Nozzle, pitch
from engine.scene.meshes import surface_of
from engine.scene.placement import axes

if TYPE_CHECKING:
    from engine.geometry.triangle_distance import TriangleTree

_UPRIGHT = 0.9  # cosine to an axis above which another one says how things are turned about it


def own_pitch(liquid: Liquid, shape: LiquidShape) -> float:
    """Return the distance of particles in a shape before its lattice is fitted [m]."""
    return pitch(liquid.spacing, shape.particles_per_cell or liquid.particles_per_cell)


def expected_count(shape: LiquidShape, d: float) -> float:
    """Return how many particles a shape has at distances `d` [m], up to a few per cent where it is round."""
    if isinstance(shape, LiquidBox):
        return float(np.prod([_pieces(b - a, d) for a, b in zip(shape.low, shape.high, strict=True)]))
    if isinstance(shape, LiquidBall):
        return max(4 / 3 * pi * (shape.radius / d) ** 3, 1.0)
    if isinstance(shape, LiquidCylinder):
        return max(pi * (shape.radius / d) ** 2, 1.0) * _pieces(shape.height, d)
    surface = surface_of(shape)
    return max(float(np.linalg.det(surface.vertices[surface.faces]).sum()) / 6.0 / d**3, 1.0)


def places_in_box_around(mesh: LiquidMesh, d: float) -> float:
    """Return how many places of a lattice must be looked at to find those in a mesh."""
    return float(np.prod(np.ceil(surface_of(mesh).extent / d)))


def emitted_count(nozzle: Nozzle, d: float, until: float) -> float:
    """Return how many particles come out up to `until` [s], as `expected_count` does."""
    flowing = max(min(until, inf if nozzle.end is None else nozzle.end) - nozzle.begin, 0.0)
    if nozzle.rectangle is not None:
        of_layer = float(np.prod([_pieces(side, d) for side in nozzle.rectangle]))
    else:
        assert nozzle.radius is not None
        of_layer = max(pi * (nozzle.radius / d) ** 2, 1.0)
    return of_layer * ceil(nozzle.speed * flowing / d)


def seeded(shape: LiquidShape, d: float, jitter: float, random: np.random.Generator) -> tuple[Floats, Floats]:
    """Return places [n, 3] [m] and volumes [n] [m^3] of the particles in a shape, `d` [m] apart or nearly so.

    They lie off their places at random, by up to `jitter` halves of their distance.
    """
    if isinstance(shape, LiquidBox):
        low, high = np.array(shape.low), np.array(shape.high)
        count = [_pieces(side, d) for side in high - low]
        cell = (high - low) / count
        x = low + cell * _shaken(_grid(*(_steps(n) + 0.5 for n in count)), jitter, random)
        return _under_wave(shape, x, float(np.prod(cell)))
    if isinstance(shape, LiquidBall):
        steps = _grid(*[_around_zero(shape.radius / d)] * 3)
        steps = steps[np.linalg.norm(steps, axis=1) <= shape.radius / d]
        volume = 4 / 3 * pi * shape.radius**3 / len(steps)
        return np.array(shape.centre) + volume ** (1 / 3) * _shaken(steps, jitter, random), np.full(len(steps), volume)
    if isinstance(shape, LiquidCylinder):
        plane, area = _disc(shape.radius, d)
        layers = _pieces(shape.height, d)
        height = shape.height / layers
        steps = np.column_stack([np.repeat(plane, layers, axis=0), np.tile(_steps(layers) - 0.5 * (layers - 1), len(plane))])
        local = np.array([area**0.5, area**0.5, height]) * _shaken(steps, jitter, random)
        return np.array(shape.centre) + local @ frame(np.array(shape.axis)).T, np.full(len(local), area * height)
    return _in_mesh(shape, d, jitter, random)


def holds(shape: LiquidShape, x: Floats) -> Flags:
    """Return which places x [n, 3] [m] are in a shape, shape [n]."""
    if isinstance(shape, LiquidBox):
        top = shape.high[2] + (0.0 if shape.wave is None else _crest(shape, x))
        return (x >= shape.low).all(axis=1) & (x[:, :2] <= shape.high[:2]).all(axis=1) & (x[:, 2] <= top)
    if isinstance(shape, LiquidBall):
        return np.linalg.norm(x - shape.centre, axis=1) <= shape.radius
    if isinstance(shape, LiquidCylinder):
        local = (x - shape.centre) @ frame(np.array(shape.axis))
        return (np.hypot(local[:, 0], local[:, 1]) <= shape.radius) & (np.abs(local[:, 2]) <= 0.5 * shape.height)
    return _distances(shape, (x - shape.position) @ axes(shape.rotation)) <= 0.0


def opening(nozzle: Nozzle, d: float) -> tuple[Floats, float]:
    """Return the places [n, 3] [m] where a layer of particles `d` [m] apart comes out, and the area of each [m^2]."""
    if nozzle.rectangle is not None:
        count = [_pieces(side, d) for side in nozzle.rectangle]
        cell = np.array(nozzle.rectangle) / count
        plane, area = cell * _grid(*(_steps(n) - 0.5 * (n - 1) for n in count)), float(np.prod(cell))
    else:
        assert nozzle.radius is not None  # the validator saw to it
        plane, area = _disc(nozzle.radius, d)
        plane = area**0.5 * plane
    return np.array(nozzle.centre) + plane @ frame(np.array(nozzle.direction))[:, :2].T, area


def frame(along: Floats) -> Floats:
    """Return axes as columns [3, 3], the last along `along` [3], the first as near to x, or else to y, as it may be turned."""
    third = along / np.linalg.norm(along)
    first = np.eye(3)[0 if abs(third[0]) <= _UPRIGHT else 1]
    first = first - (first @ third) * third
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(third, first), third])


def _pieces(length: float, d: float) -> int:
    return max(round(length / d), 1)


def _grid(*along: Floats) -> Floats:
    return np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, len(along))


def _steps(count: int) -> Floats:
    return np.arange(count, dtype=np.float64)


def _around_zero(reach: float) -> Floats:
    return _steps(2 * int(reach) + 1) - int(reach)


def _shaken(steps: Floats, jitter: float, random: np.random.Generator) -> Floats:
    return steps if jitter == 0.0 else steps + 0.5 * jitter * random.uniform(-1.0, 1.0, steps.shape)


def _disc(radius: float, d: float) -> tuple[Floats, float]:
    """Steps [n, 2] of a square lattice within a disc, and the area of each [m^2]."""
    steps = _grid(*[_around_zero(radius / d)] * 2)
    steps = steps[np.linalg.norm(steps, axis=1) <= radius / d]
    return steps, pi * radius**2 / len(steps)


def _crest(box: LiquidBox, x: Floats) -> Floats:
    assert box.wave is not None
    return box.wave.amplitude * np.cos(2.0 * pi * (x[:, 0] - box.low[0]) / box.wave.wavelength)


def _under_wave(box: LiquidBox, x: Floats, volume: float) -> tuple[Floats, Floats]:
    stretch = np.ones(len(x))
    if box.wave is not None:
        stretch += _crest(box, x) / (box.high[2] - box.low[2])
        x[:, 2] = box.low[2] + stretch * (x[:, 2] - box.low[2])
    return x, volume * stretch


def _in_mesh(mesh: LiquidMesh, d: float, jitter: float, random: np.random.Generator) -> tuple[Floats, Floats]:
    surface = surface_of(mesh)
    count = np.ceil(surface.extent / d).astype(np.int64)
    low = surface.vertices.min(axis=0) - 0.5 * (count * d - surface.extent)
    x, y, z = (a + d * (_steps(n) + 0.5) for a, n in zip(low, count, strict=True))
    slabs = (_grid(x[i : i + 1], y, z) for i in range(len(x)))  # one by one: a mesh may fill little of the box around it
    local = np.concatenate([slab[_distances(mesh, slab) <= 0.0] for slab in slabs])
    local = d * _shaken(local / d, jitter, random)
    return np.array(mesh.position) + local @ axes(mesh.rotation).T, np.full(len(local), d**3)


def _distances(mesh: LiquidMesh, local: Floats) -> Floats:
    # imported here, because reading and checking a scene needs no compiled kernels
    from engine.geometry.triangle_distance import signed_distances

    return signed_distances(_tree(mesh), local, inf)


@lru_cache(maxsize=8)  # two shapes that may overlap ask for the same
def _tree(mesh: LiquidMesh) -> "TriangleTree":
    from engine.geometry.triangle_distance import triangle_tree

    surface = surface_of(mesh)
    return triangle_tree(surface.vertices, surface.faces)
