"""Closed triangle surfaces, and their signed distance sampled on grids."""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Floats, Ints


@dataclass(frozen=True)
class Surface:
    """A closed surface, its triangles counter-clockwise seen from outside."""

    vertices: Floats  # [m], shape [V, 3]
    faces: Ints  # shape [F, 3]

    @property
    def extent(self) -> Floats:
        """Lengths of the box around it [m], shape [3]."""
        return np.ptp(self.vertices, axis=0)


@dataclass(frozen=True)
class SampledSurface:
    """A surface with its signed distance on a grid whose middle is the origin."""

    surface: Surface
    middle: Floats  # of the grid before the surface was moved by its negative [m], shape [3]
    size: Floats  # half lengths of the grid [m], shape [3]
    samples: Floats  # [m], shape [samples along x, y, z]


@dataclass(frozen=True)
class Surfaces:
    """What K obstacles have of meshes."""

    surface: tuple[Surface | None, ...]  # of each obstacle in its own frame, None where it is no mesh, length K
    lattice: Ints  # first sample, and samples along each axis, as `sampled_distance` takes them, shape [K, 4]
    samples: Floats  # [m], shape [sum of samples]


def samples_along(extent: Floats, spacing: float, margin: float) -> Floats:
    """Return how many samples a grid has along each axis that reaches `margin` beyond a body of `extent` [3] [m]."""
    # two more on either side: interpolation does not reach to the border
    return np.ceil((extent + 2.0 * margin) / spacing - 1e-9) + 5.0


def sampled(surface: Surface, spacing: float, margin: float) -> SampledSurface:
    """Return the surface with its distance on a grid of `spacing` that reaches `margin` beyond it [m]."""
    # imported here, because reading and checking a scene needs no compiled kernels
    from engine.geometry.triangle_distance import signed_distances, triangle_tree

    count = samples_along(surface.extent, spacing, margin).astype(np.int64)
    size = (0.5 * spacing * (count - 1)).astype(np.float64)
    middle = 0.5 * (surface.vertices.min(axis=0) + surface.vertices.max(axis=0))
    centred = Surface(surface.vertices - middle, surface.faces)
    axes = [np.linspace(-half, half, n) for half, n in zip(size, count, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    tree = triangle_tree(centred.vertices, centred.faces)
    return SampledSurface(centred, middle, size, signed_distances(tree, points, spacing).reshape(count))


def packed(sampled_surfaces: list[SampledSurface | None]) -> Surfaces | None:
    """Return what obstacles have of meshes, given for each of them; None where none is one."""
    lattice, samples, first = np.zeros((len(sampled_surfaces), 4), np.int64), [], 0
    for o, found in enumerate(sampled_surfaces):
        if found is not None:
            lattice[o] = first, *found.samples.shape
            samples.append(found.samples.ravel())
            first += found.samples.size
    if not samples:
        return None
    surface = tuple(found.surface if found is not None else None for found in sampled_surfaces)
    return Surfaces(surface, lattice, np.concatenate(samples))
