"""A dam break: the volume that the liquid takes up, through splashes and until it has nearly come to rest."""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from engine.scene.liquid_materials import LiquidMaterial
from engine.validate.catalogue import CaseResult, case
from engine.validate.liquids import EARTH, FLOOR, Vessel, box, ends, liquid, planes, rows

CELLS = (8, 16, 24)  # in the width of the column
COURANT, COURANTS = 0.8, (0.4, 1.6)  # of the first front; others tried at the middle of CELLS, of which none goes beyond 1 later
BREADTH, HEIGHT, TANK = 0.25, 0.5, 1.0  # of the column and the tank [m]
ACROSS = 4  # cells, after which the tank repeats
DURATION, LAST, LOOK = 5.0, 0.5, 0.05  # [s]


@dataclass(frozen=True)
class Drift:
    """By how much the volume is off what the column had, relative to it."""

    left: float  # at the end, in the mean of the last half second
    most: float  # at any time


@case("liq-volume", bar=0.005, summary="volume that the liquid takes up, at the end of 5 s of a dam break")
def volume(quick: bool) -> CaseResult:
    """Largest drift of the volume over several grids and steps, that is left at the end; the largest on the way beside it."""
    drift(CELLS[0], COURANT, LAST)  # compiles the kernels, untimed
    cells = CELLS[:1] if quick else CELLS
    way: dict[str, float] = {}

    def error(cells: int, courant: float) -> float:
        found = drift(cells, courant, DURATION)
        way[f"{cells} cells, Courant number {courant:g}"] = found.most
        return abs(found.left)

    found = rows("cells in the column", cells, lambda n: error(round(n), COURANT))
    if not quick:
        found += rows(f"Courant number, {CELLS[1]} cells", COURANTS, lambda courant: error(CELLS[1], courant))
    note = "; ".join(f"{which}: {100.0 * most:.2g} %" for which, most in way.items())
    return CaseResult(found, max(row.error for row in found), note=f"largest on the way at {note}")


def drift(cells: int, courant: float, duration: float) -> Drift:
    """Return the drift of volume in `duration` [s], over the volume of the column."""
    vessel = dam(cells, BREADTH, HEIGHT, TANK)
    h = step_of(cells, courant, BREADTH, HEIGHT)
    steps = round(LOOK / h)
    at_start, off = vessel.volume(), np.empty(round(duration / LOOK))
    for look in range(len(off)):
        for _ in range(steps):
            vessel.reach(LOOK / steps)
        off[look] = vessel.volume() / at_start - 1.0
    return Drift(float(off[-round(LAST / LOOK):].mean()), float(np.abs(off).max()))


def dam(cells: int, breadth: float, height: float, tank: float) -> Vessel:
    """Return water at rest in a column at one end of a tank, `cells` in its breadth; lengths in m."""
    model = liquid(LiquidMaterial(density=1000.0), breadth / cells, period=(0, ACROSS, 0))
    state = box(model, (breadth, ACROSS * model.spacing, height))
    return Vessel(model, state, (0.0, 0.0, -EARTH), planes(FLOOR, *ends(tank)))


def step_of(cells: int, courant: float, breadth: float, height: float) -> float:
    """Return the step [s] in which Ritter's front, which moves at 2 sqrt(g height), crosses so many cells."""
    return courant * breadth / cells / (2.0 * sqrt(EARTH * height))
