"""Closed triangle surfaces, and their signed distance sampled on grids."""

from collections.abc import Sequence
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
class Shapes:
    """What a surface changes to: evenly from one of K shapes to the next, at rest after the last."""

    time: Floats  # ascending from 0 [s], shape [K]
    vertices: Floats  # [m], shape [K, V, 3]
    samples: Floats  # of the distance, on one grid [m], shape [K, samples]

    def between(self, values: Floats, time: float) -> Floats:
        """Return what is at `time` [s] of `values` [K, ...] that belong to the shapes."""
        k = int(np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2))
        share = min((time - self.time[k]) / (self.time[k + 1] - self.time[k]), 1.0)
        return (1.0 - share) * values[k] + share * values[k + 1]


@dataclass(frozen=True)
class SampledSurface:
    """A surface with its signed distance on a grid whose middle is the origin."""

    surface: Surface
    middle: Floats  # of the grid before the surface was moved by its negative [m], shape [3]
    size: Floats  # half lengths of the grid [m], shape [3]
    samples: Floats  # [m], shape [samples along x, y, z]
    shapes: Shapes | None = None  # None where it keeps its own


@dataclass(frozen=True)
class Surfaces:
    """What K obstacles have of meshes."""

    surface: tuple[Surface | None, ...]  # of each obstacle in its own frame, None where it is no mesh, length K
    lattice: Ints  # first sample, and samples along each axis, as `sampled_distance` takes them, shape [K, 4]
    start_samples: Floats  # [m], shape [sum of samples]
    shapes: tuple[Shapes | None, ...]  # of each obstacle, None where it keeps its own, length K

    def vertices(self, obstacle: int, time: float) -> Floats:
        """Return the vertices of a mesh at `time` [s] in its own frame, shape [V, 3] [m]."""
        shapes, surface = self.shapes[obstacle], self.surface[obstacle]
        assert surface is not None
        return surface.vertices if shapes is None else shapes.between(shapes.vertices, time)

    def samples(self, time: float) -> Floats:
        """Return the samples of all distances at `time` [s], between shapes blended from those of both, shape [samples] [m]."""
        if not any(self.shapes):
            return self.start_samples
        samples = self.start_samples.copy()
        for shapes, (first, *along) in zip(self.shapes, self.lattice, strict=True):
            if shapes is not None:
                samples[first : first + np.prod(along)] = shapes.between(shapes.samples, time)
        return samples


def samples_along(extent: Floats, spacing: float, margin: float) -> Floats:
    """Return how many samples a grid has along each axis that reaches `margin` beyond a body of `extent` [3] [m]."""
    # two more on either side: interpolation does not reach to the border
    return np.ceil((extent + 2.0 * margin) / spacing - 1e-9) + 5.0


def sampled(
    surface: Surface, spacing: float, margin: float, later: Sequence[tuple[float, Floats]] = ()
) -> SampledSurface:
    """Return the surface with its distance on a grid of `spacing` that reaches `margin` beyond it [m].

    `later` are times after 0 [s], ascending, and the vertices [V, 3] [m] that it has then.
    """
    # imported here, because reading and checking a scene needs no compiled kernels
    from engine.geometry.triangle_distance import signed_distances, triangle_tree

    vertices = np.stack([surface.vertices, *(moved for _, moved in later)])
    low, high = vertices.min(axis=(0, 1)), vertices.max(axis=(0, 1))
    count = samples_along(high - low, spacing, margin).astype(np.int64)
    size = (0.5 * spacing * (count - 1)).astype(np.float64)
    middle = 0.5 * (low + high)
    vertices -= middle
    axes = [np.linspace(-half, half, n) for half, n in zip(size, count, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    samples = np.array([signed_distances(triangle_tree(shape, surface.faces), points, spacing) for shape in vertices])
    shapes = Shapes(np.array([0.0, *(time for time, _ in later)]), vertices, samples) if later else None
    return SampledSurface(Surface(vertices[0], surface.faces), middle, size, samples[0].reshape(count), shapes)


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
    shapes = tuple(found.shapes if found is not None else None for found in sampled_surfaces)
    return Surfaces(surface, lattice, np.concatenate(samples), shapes)
