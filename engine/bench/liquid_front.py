"""Speed against error of liquids: what cells and steps cost, and what they buy, for a film and for the front of a dam break."""

from collections.abc import Iterator, Sequence
from functools import partial
from math import sqrt

import numpy as np

from engine.arrays import Floats
from engine.bench.choices import rows, tried
from engine.bench.suite import Measurement, Note, benchmark
from engine.scene.liquid_materials import LiquidMaterial
from engine.validate import liquid_film, liquid_volume
from engine.validate.liquids import EARTH, PER_SIDE

FILM_CELLS, FILM_STEPS, FILM_COURANT = (8, 16, 32), (1.5e-3, 5e-4, 1.5e-4), 0.9  # steps [s], none beyond that Courant number
FRONT_CELLS, FRONT_COURANTS = (4, 8, 16), (0.8, 0.4)
FINEST = (32, 0.4)  # cells and Courant number of the dam break that all others are compared with
BREADTH = 0.05715  # of the column, 2.25 inches [m]
SLENDER = 2.0  # its height over its breadth, n^2
TANK = 5.0  # its length over the breadth of the column
# Martin and Moyce 1952, on a dry floor: times over sqrt(breadth / (n^2 g)), and places of the front over the breadth.
MEASURED = np.array([
    (0.41, 1.11), (0.84, 1.22), (1.19, 1.44), (1.43, 1.67), (1.63, 1.89), (1.83, 2.11), (1.98, 2.33), (2.20, 2.56), (2.32, 2.78),
    (2.51, 3.00), (2.65, 3.22), (2.83, 3.44), (2.98, 3.67), (3.11, 3.89), (3.33, 4.11),
])


@benchmark("liquid-front", summary="error against wall time of a film and of a dam break's front, by cells and Courant numbers")
def liquid_front() -> Iterator[Measurement | Note]:
    """Every pair of cells and steps for the profile of two films, of cells and Courant numbers for the front of a dam break."""
    for name in ("Newtonian", "Bingham"):
        yield from of_film(name, liquid_film.LIQUIDS[name], FILM_CELLS, FILM_STEPS)
    yield from of_dam(FRONT_CELLS, FRONT_COURANTS, FINEST)


def of_film(name: str, material: LiquidMaterial, cells: Sequence[int], steps: Sequence[float]) -> Iterator[Measurement]:
    """Yield a row for every pair of cells through the film and steps [s], whose size is steps a second.

    The error is that of the profile.
    """
    liquid_film.steady(material, cells[0], enough=1.0)  # compiles the kernels, untimed
    yield from rows([
        tried(f"{name} film, {n} cells", 1.0 / h, partial(liquid_film.steady, material, n, FILM_COURANT, longest=h),
              lambda film: film.velocity, cells=n)
        for n in cells for h in steps
    ])


def of_dam(cells: Sequence[int], courants: Sequence[float], finest: tuple[int, float]) -> Iterator[Measurement | Note]:
    """Yield a row for every pair of cells in the column and Courant numbers, whose size is the steps to the last time measured.

    The error is the largest difference of places of the front to those of the `finest` pair, over the breadth of the column.
    """
    fronts(cells[0], courants[0], MEASURED[:1, 0])  # compiles the kernels, untimed
    time, last = MEASURED[:, 0], float(MEASURED[-1, 0])
    wanted = fronts(*finest, time)
    yield from rows([
        tried(f"dam break, {n} cells", last * sqrt(BREADTH / (SLENDER * EARTH)) / _step(n, courant),
              partial(fronts, n, courant, time), lambda found: float(np.abs(found - wanted).max()), cells=n)
        for n in cells for courant in courants
    ])
    yield Note(comparison(wanted))


def comparison(front: Floats) -> str:
    """Return how a front at the times of MEASURED compares with what was measured, and with how fast it may be."""
    ahead = front / MEASURED[:, 1] - 1.0
    fastest = float((np.diff(front) / np.diff(MEASURED[:, 0])).max())
    return (f"the finest front is {100.0 * ahead.min():+.1f} to {100.0 * ahead.max():+.1f} % ahead of what Martin and Moyce "
            f"measured in 1952, at most {fastest / 2.0:.2f} times as fast as Ritter's 2 sqrt(g height)")


def fronts(cells: int, courant: float, time: Floats) -> Floats:
    """Return how far water has come at times over sqrt(breadth / (n^2 g)), over the breadth; both are those of MEASURED."""
    vessel = liquid_volume.dam(cells, BREADTH, SLENDER * BREADTH, TANK * BREADTH)
    h = _step(cells, courant)
    found = np.empty(len(time))
    for n, span in enumerate(np.diff(time, prepend=0.0) * sqrt(BREADTH / (SLENDER * EARTH))):
        steps = max(round(span / h), 1)
        for _ in range(steps):
            vessel.reach(span / steps)
        found[n] = vessel.state.x[:, 0].max() / BREADTH + 0.5 / (PER_SIDE * cells)
    return found


def _step(cells: int, courant: float) -> float:
    return liquid_volume.step_of(cells, courant, BREADTH, SLENDER * BREADTH)
