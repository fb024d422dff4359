"""Pressure of incompressible liquid with a free surface: iterations that do not depend on size, and a solution that is known."""

import time

import numpy as np

from engine.arrays import Flags, Floats
from engine.linalg.multigrid import multigrid, solve
from engine.linalg.seven_point import Indices, SevenPoint
from engine.validate.catalogue import CaseResult, Row, case
from engine.validate.fit import fitted_exponent

TOLERANCE, MOST = 1e-8, 100
SPREAD = 0.2  # of iterations, about the middle of the least and the most
NEVER = np.zeros(3, np.int64)  # space does not repeat
NEAREST = 0.01  # distances to the surface in cells are at least
BLOBS, CAVITIES = 12, 8
BALL, RADIUS = np.array([0.5, 0.5, 0.3]), 0.17  # solid
WAVE, LEVEL = 2.0, 0.5  # p = cos x cos y cos z - LEVEL in units of 1/WAVE


@case("liq-projection", bar=TOLERANCE, order=1.9,
      summary="random divergence in random free-surface domains; order for a pressure that is known")
def projection(quick: bool) -> CaseResult:
    """Worst residual, relative in the largest component, and order of the pressure's error; iterations are a condition."""
    sizes = (32, 64) if quick else (32, 64, 128, 256)
    measured(sizes[0])  # compiles
    rows, iterations = zip(*map(measured, sizes), strict=True)
    middle, failures = 0.5 * (min(iterations) + max(iterations)), []
    if not max(iterations) <= (1.0 + SPREAD) * middle:
        failures.append(f"iterations {list(iterations)} depend on size")
    spacings = [1.0 / cells for cells in ((16, 32, 64) if quick else (16, 32, 64, 128))]
    errors = [manufactured_error(h) for h in spacings]
    return CaseResult(
        list(rows), max(row.error for row in rows), fitted_exponent(spacings, errors), failures=failures,
        note=f"iterations {list(iterations)}; errors of a known pressure {', '.join(f'{error:.2g}' for error in errors)}")


def measured(cells: int) -> tuple[Row, int]:
    """Return the row of a box of `cells`^3, with the seconds to set up and to solve, and the iterations."""
    system = free_surface(cells)
    load = np.random.default_rng(cells).normal(size=len(system.place))
    p = np.zeros_like(load)
    began = time.perf_counter()
    iterations, _ = solve(multigrid(system, NEVER), load, p, TOLERANCE, MOST)
    seconds = time.perf_counter() - began
    return Row("cells along an edge", cells, residual(system, load, p), seconds), iterations


def residual(system: SevenPoint, load: Floats, p: Floats) -> float:
    """Return the largest component of the residual over that of the load."""
    product = np.empty_like(load)
    system.multiply(p, product)
    return float(np.abs(load - product).max() / np.abs(load).max())


def free_surface(cells: int) -> SevenPoint:
    """Return a box of `cells`^3 with a wavy pool, blobs and cavities with p = 0 around, and a solid ball that cuts faces.

    The shapes are the same at every size.
    """
    rng = np.random.default_rng(0)
    x, y, z = np.meshgrid(*3 * [(np.arange(cells) + 0.5) / cells], indexing="ij", sparse=True)
    depth = 0.55 + 0.06 * np.sin(7 * x + 1) * np.cos(9 * y) - z
    for sign, count, largest in ((1.0, BLOBS, 0.2), (-1.0, CAVITIES, 0.15)):
        for _ in range(count):
            (a, b, c), radius = rng.random(3), rng.uniform(0.25 * largest, largest)
            ball = radius - np.sqrt((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2)
            depth = sign * np.maximum(sign * depth, ball)
    return discretised(depth)


def discretised(depth: Floats) -> SevenPoint:
    """Return the system of cells of positive `depth` [N, N, N] outside of the ball; walls are around the box."""
    cells = len(depth)
    x, y, z = np.meshgrid(*3 * [(np.arange(cells) + 0.5) / cells], indexing="ij", sparse=True)
    wet = (depth > 0.0) & (_clearance(x, y, z) > -0.5 / cells)
    place, beside = listed(wet)
    coupling, diagonal = np.zeros((len(place), 3)), np.zeros(len(place))
    here = depth[tuple(place.T)]
    for d in range(6):
        step = np.zeros(3)
        step[d // 2] = d % 2 - 0.5
        face = (place + 0.5 + step) / cells
        there = (place + 2 * step).astype(np.int32)
        within = ((there >= 0) & (there < cells)).all(axis=1)
        beyond = depth[tuple(np.clip(there, 0, cells - 1).T)]
        fraction = np.where(within, np.clip(0.5 + cells * _clearance(*face.T), 0.0, 1.0), 0.0)
        to_air = (beside[:, d] < 0) & (beyond <= 0.0)
        theta = np.clip(here / np.where(to_air, here - beyond, here), NEAREST, 1.0)  # of the way to the next centre
        conductance = np.where(to_air, fraction / theta, np.where(beside[:, d] >= 0, fraction, 0.0))
        diagonal += conductance
        if d % 2 == 1:
            coupling[:, d // 2] = np.where(to_air, 0.0, conductance)
    return SevenPoint(place, beside, coupling, diagonal)


def listed(wet: Flags) -> tuple[Indices, Indices]:
    """Return `place` and `beside` of a system on the cells of a box where `wet` [N, N, N] is set, in order of blocks."""
    place = np.argwhere(wet).astype(np.int32)
    place = place[np.lexsort((*(place >> 2).T[::-1],))]
    number = np.full(np.array(wet.shape) + 2, -1, np.int32)
    number[tuple((place + 1).T)] = np.arange(len(place), dtype=np.int32)
    beside = np.empty((len(place), 6), np.int32)
    for d in range(6):
        step = np.zeros(3, np.int32)
        step[d // 2] = 2 * (d % 2) - 1
        beside[:, d] = number[tuple((place + 1 + step).T)]
    return place, beside


def _clearance(x: Floats, y: Floats, z: Floats) -> Floats:
    """Distance from the ball."""
    return np.sqrt((x - BALL[0]) ** 2 + (y - BALL[1]) ** 2 + (z - BALL[2]) ** 2) - RADIUS


def manufactured_error(h: float) -> float:
    """Return the largest error of p in liquid in the corner of three walls, whose surface is where p vanishes."""
    cells = round(1.0 / h)
    centre = np.cos(WAVE * h * (np.arange(cells) + 0.5))
    exact = centre[:, None, None] * centre[:, None] * centre - LEVEL
    place, beside = listed(exact > 0.0)
    p = exact[tuple(place.T)]
    coupling, diagonal = np.zeros((len(place), 3)), np.zeros(len(place))
    for d in range(6):
        a, side = d // 2, 2 * (d % 2) - 1
        at = h * (place[:, a] + 0.5)
        others = (p + LEVEL) / np.cos(WAVE * at)  # the factors along the other axes: p vanishes where cos x = LEVEL / others
        surface = np.arccos(LEVEL / others) / WAVE
        joined = beside[:, d] >= 0
        to_air = ~joined & (side > 0)  # at the other side of a cell without a neighbour is a wall
        diagonal += np.where(joined, 1.0, np.where(to_air, h / np.where(to_air, surface - at, h), 0.0))
        if side > 0:
            coupling[:, a] = joined
    found = np.zeros_like(p)
    load = 3.0 * WAVE**2 * h**2 * (p + LEVEL)
    solve(multigrid(SevenPoint(place, beside, coupling, diagonal), NEVER), load, found, 1e-12, MOST)
    return float(np.abs(found - p).max())
