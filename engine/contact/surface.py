"""Closed triangle surfaces, and their signed distance sampled on grids."""

from dataclasses import dataclass

from engine.arrays import Floats, Ints


@dataclass(frozen=True)
class Surface:
    """A closed surface, its triangles counter-clockwise seen from outside."""

    vertices: Floats  # [m], shape [V, 3]
    faces: Ints  # shape [F, 3]


@dataclass(frozen=True)
class Surfaces:
    """What K obstacles have of meshes."""

    surface: tuple[Surface | None, ...]  # of each obstacle in its own frame, None where it is no mesh, length K
    lattice: Ints  # first sample, and samples along each axis, as `sampled_distance` takes them, shape [K, 4]
    samples: Floats  # [m], shape [sum of samples]
