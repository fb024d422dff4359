"""Whether centre lines of strands went through each other, or into solids, on straight ways: a judge of its own."""

import numpy as np

from engine.arrays import Floats, Ints
from engine.contact.obstacles import ObstacleKind, ObstacleMotion

SAMPLES = 65  # of a way and of an edge
END = 1e-9  # share of an edge or a way beyond its end that still counts


def crossed(x: Floats, motion: Floats, first: Ints, second: Ints) -> bool:
    """Return whether any edge of `first` goes through any of `second` while vertices go from x [V, 3] along `motion` [V, 3] [m].

    Edges are named by their first vertices. Two edges that meet are in a plane: the volume of their ends, a polynomial of
    third degree in time, is zero then.
    """
    a, b = (edges.ravel() for edges in np.meshgrid(first, second, indexing="ij"))
    low, high = np.minimum(x, x + motion), np.maximum(x, x + motion)
    near = np.ones(len(a), np.bool_)
    for one, other in ((a, b), (b, a)):
        near &= (np.minimum(low[one], low[one + 1]) <= np.maximum(high[other], high[other + 1])).all(axis=1)
    a, b = a[near], b[near]
    ends = np.column_stack([a, a + 1, b, b + 1])
    for four, roots in zip(ends, _coplanar_times(x, motion, a, b), strict=True):
        real = np.abs(roots.imag) < END
        if any(-END < time < 1.0 + END and _meet(*(x[four] + time * motion[four])) for time in roots[real].real):
            return True
    return False


def _coplanar_times(x: Floats, motion: Floats, a: Ints, b: Ints) -> Floats:
    """Complex shares of the way at which edges a [n] and b [n] lie in one plane, shape [n, 3]; nan where there are fewer."""
    u = [(y[a + 1] - y[a], y[b + 1] - y[b], y[b] - y[a]) for y in (x, motion)]
    times = np.array([0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0])
    volumes = np.array([_volume(*(p + t * q for p, q in zip(*u, strict=True))) for t in times])
    polynomials = np.linalg.solve(np.vander(times), volumes).T
    roots = np.full((len(a), 3), np.nan + 0j)
    for i, polynomial in enumerate(polynomials):
        found = np.roots(np.where(np.abs(polynomial) > 1e-14 * np.abs(polynomial).max(), polynomial, 0.0))
        roots[i, : len(found)] = found
    return roots


def _volume(p: Floats, q: Floats, r: Floats) -> Floats:
    return np.einsum("ij,ij->i", np.cross(p, q), r)


def _meet(a: Floats, b: Floats, c: Floats, d: Floats) -> bool:
    """Whether edges ab and cd in one plane have a point in common."""
    shares, *_ = np.linalg.lstsq(np.column_stack([b - a, c - d]), c - a, rcond=None)
    return bool((shares > -END).all() and (shares < 1.0 + END).all())


def depth(obstacles: ObstacleMotion, o: int, x: Floats, motion: Floats, edges: Ints) -> float:
    """Return how deep centre lines of `edges` come into convex solid o at most on their way [m], negative where they do not.

    The way is straight as seen from the solid, at which places are sampled.
    """
    kind, size = obstacles.begin.kind[o], obstacles.begin.size[o]
    begin = (x - obstacles.begin.centre[o]) @ obstacles.begin.rotation[o]
    end = (x + motion - obstacles.end.centre[o]) @ obstacles.end.rotation[o]
    shares, deepest = np.linspace(0.0, 1.0, SAMPLES)[:, None, None], -np.inf
    for time in np.linspace(0.0, 1.0, SAMPLES):
        y = begin + time * (end - begin)
        deepest = max(deepest, _depth(kind, size, ((1.0 - shares) * y[edges] + shares * y[edges + 1]).reshape(-1, 3)))
    return deepest


def _depth(kind: int, size: Floats, x: Floats) -> float:
    """Depth of the deepest of places x [n, 3] in a solid in its own frame [m]; how far places outside are has no meaning."""
    match kind:
        case ObstacleKind.PLANE:
            depths = -x[:, 2]
        case ObstacleKind.SPHERE:
            depths = size[0] - np.linalg.norm(x, axis=1)
        case ObstacleKind.CYLINDER:
            depths = np.minimum(size[0] - np.hypot(x[:, 0], x[:, 1]), size[1] - np.abs(x[:, 2]))
        case ObstacleKind.BOX:
            depths = (size - np.abs(x)).min(axis=1)
        case _:
            raise ValueError(f"solids of kind {kind} are not convex")
    return float(depths.max())
