"""A dam break: the volume that the liquid takes up, through splashes and until it has nearly come to rest."""

from math import sqrt

from engine.scene.liquid_materials import LiquidMaterial
from engine.validate.catalogue import CaseResult, case
from engine.validate.liquids import EARTH, FLOOR, Vessel, box, ends, liquid, planes, rows

CELLS = (8, 16, 32)  # in the width of the column
COURANT, COURANTS = 0.8, (0.4, 1.6)  # of the first front; others tried at the middle of CELLS, of which none goes beyond 1 later
BREADTH, HEIGHT, TANK = 0.25, 0.5, 1.0  # of the column and the tank [m]
ACROSS = 4  # cells, after which the tank repeats
DURATION, QUICK_DURATION, LOOK = 5.0, 0.8, 0.05  # [s]


@case("liq-volume", bar=0.005, summary="volume that the liquid takes up, for 5 s of a dam break")
def volume(quick: bool) -> CaseResult:
    """Largest drift of the volume from what the column had, relative to it, over several grids and steps."""
    drift(CELLS[0], COURANT, LOOK)  # compiles the kernels, untimed
    cells, duration = (CELLS[:1], QUICK_DURATION) if quick else (CELLS, DURATION)
    found = rows("cells in the column", cells, lambda n: drift(round(n), COURANT, duration))
    if not quick:
        found += rows(f"Courant number, {CELLS[1]} cells", COURANTS, lambda courant: drift(CELLS[1], courant, duration))
    return CaseResult(found, max(row.error for row in found), note=f"for {duration:g} s")


def drift(cells: int, courant: float, duration: float) -> float:
    """Return the largest drift of volume in `duration` [s], over the volume of the column."""
    vessel = dam(cells, BREADTH, HEIGHT, TANK)
    h = step_of(cells, courant, BREADTH, HEIGHT)
    steps = round(LOOK / h)
    seeded = float(vessel.state.volume.sum())
    worst = 0.0
    for _ in range(round(duration / LOOK)):
        for _ in range(steps):
            vessel.reach(LOOK / steps)
        worst = max(worst, abs(vessel.volume() / seeded - 1.0))
    return worst


def dam(cells: int, breadth: float, height: float, tank: float) -> Vessel:
    """Return water at rest in a column at one end of a tank, `cells` in its breadth; lengths in m."""
    model = liquid(LiquidMaterial(density=1000.0), breadth / cells, period=(0, ACROSS, 0))
    state = box(model, (breadth, ACROSS * model.spacing, height))
    return Vessel(model, state, (0.0, 0.0, -EARTH), planes(FLOOR, *ends(tank)))


def step_of(cells: int, courant: float, breadth: float, height: float) -> float:
    """Return the step [s] in which Ritter's front, which moves at 2 sqrt(g height), crosses so many cells."""
    return courant * breadth / cells / (2.0 * sqrt(EARTH * height))
