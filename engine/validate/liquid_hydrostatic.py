"""Columns of liquid at rest: pressure from the weight above, and no motion."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from math import sqrt
from time import perf_counter

import numpy as np

from engine.arrays import Floats
from engine.liquid.model import LiquidModel, LiquidState
from engine.liquid.settings import LiquidSettings
from engine.scene.liquid_materials import LiquidMaterial
from engine.validate.catalogue import CaseResult, Row, case
from engine.validate.liquids import EARTH, FLOOR, Vessel, box, ends, liquid, planes

CELLS_HIGH = (8, 16, 32)
HEIGHT, WIDTH, STEP = 1.0, 0.5, 0.02  # [m], [m], [s]
DURATION, SETTLING = 5.0, 2.0  # [s]
QUICK_DURATION, QUICK_SETTLING = 0.5, 1.0  # [s]
DENSITY = 1000.0  # [kg/m^3]
MODULUS = 5.0 * DENSITY * EARTH * HEIGHT  # bulk modulus [Pa]: the foot has some four fifths of its volume at rest
JITTER = 0.5
CALMING = 0.1  # share of velocities that each step of settling takes: waves of an uneven surface do not die out by themselves
STILL = 1e-3  # of sqrt(g H)
SETTINGS = LiquidSettings(pressure_tolerance=1e-8)


@dataclass
class Unrest:
    """What a column is off by, at most."""

    pressure: float = 0.0  # of rho g H
    speed: float = 0.0  # of sqrt(g H)


@case("liq-hydrostatic", bar=0.01, summary="pressure and rest of columns, incompressible and not, on a lattice and jittered")
def hydrostatic(quick: bool) -> CaseResult:
    """Largest error of pressure in any cell at any time, relative to that at the foot; speeds beside it."""
    cells, jitters = (CELLS_HIGH[:1], (0.0,)) if quick else (CELLS_HIGH, (0.0, JITTER))
    duration, settling = (QUICK_DURATION, QUICK_SETTLING) if quick else (DURATION, SETTLING)
    found, failures = [], []
    notes = [f"for {duration:g} s, that begin after {settling:g} s in which what the grid cannot hold exactly is brought "
             "to rest: it is jittered, or compressed by its equation of state"]
    for bulk_modulus, jitter in product((None, MODULUS), jitters):
        kind = f"{'compressible' if bulk_modulus else 'incompressible'}, {'jittered' if jitter else 'lattice'}"
        before = settling if jitter or bulk_modulus else 0.0
        at_rest(cells[0], bulk_modulus, jitter, STEP, STEP)  # compiles the kernels, untimed
        for count in cells:
            began = perf_counter()
            first, then = at_rest(count, bulk_modulus, jitter, before, duration)
            found.append(Row(f"cells high, {kind}", count, then.pressure, perf_counter() - began))
            if not then.speed < STILL:
                failures.append(f"{kind}, {count} cells: moves at {then.speed:.2g} sqrt(g H)")
            if before:
                notes.append(f"{kind}, {count} cells: before, pressure off by {first.pressure:.2g}, speed {first.speed:.2g}")
    return CaseResult(found, max(row.error for row in found), note="; ".join(notes), failures=failures)


def at_rest(cells: int, bulk_modulus: float | None, jitter: float, settling: float, duration: float) -> tuple[Unrest, Unrest]:
    """Return what a column is off by while it is calmed for `settling` [s], and in the `duration` [s] after."""
    model = liquid(LiquidMaterial(density=DENSITY, bulk_modulus=bulk_modulus), HEIGHT / cells)
    state = box(model, (WIDTH, WIDTH, HEIGHT), jitter)
    pressure = weight_above if bulk_modulus is None else begin_in_equilibrium(model, state)
    vessel = Vessel(model, state, (0.0, 0.0, -EARTH), planes(FLOOR, *ends(WIDTH), *ends(WIDTH, axis=1)), SETTINGS)
    settled, after = Unrest(), Unrest()
    for unrest, span in ((settled, settling), (after, duration)):
        for _ in range(round(span / STEP)):
            vessel.step(STEP)
            wet, p = vessel.stepper.wet, vessel.stepper.pressure
            assert wet is not None
            z = model.spacing * (wet.system.place[:, 2].astype(np.float64) + 0.5)
            off = float(np.abs(p - pressure(z)).max()) / (DENSITY * EARTH * HEIGHT)
            speed = float(np.linalg.norm(state.velocity, axis=1).max()) / sqrt(EARTH * HEIGHT)
            unrest.pressure, unrest.speed = max(unrest.pressure, off), max(unrest.speed, speed)
            if unrest is settled:
                state.velocity *= 1.0 - CALMING
                state.affine *= 1.0 - CALMING
    return settled, after


def weight_above(z: Floats) -> Floats:
    """Return rho g (H - z) [Pa]."""
    return DENSITY * EARTH * (HEIGHT - z)


def begin_in_equilibrium(model: LiquidModel, state: LiquidState) -> Callable[[Floats], Floats]:
    """Compress particles as their weight does, where they are; returns pressure [Pa] as a function of height [m]."""
    state.compression = compression(state.x[:, 2], model.bulk_modulus)
    state.volume /= state.compression

    def pressure(z: Floats) -> Floats:
        j = compression(z, model.bulk_modulus)
        return -0.5 * model.bulk_modulus * (j - 1.0 / j)

    return pressure


def compression(z: Floats, bulk_modulus: float) -> Floats:
    """Return J at heights z [m] of a column HEIGHT high under its weight, by Newton's iterations.

    With p = -kappa/2 (J - 1/J) and dp/dz = -rho g / J, kappa/2 ((J^2 - 1)/2 + ln J) is -rho g (H - z). Source of the equation of
    state: Fei 2019, eqs. 13.4 and 13.8.
    """
    load = 2.0 * weight_above(z) / bulk_modulus
    j = np.ones_like(z)
    for _ in range(20):
        j -= (0.5 * (j * j - 1.0) + np.log(j) + load) / (j + 1.0 / j)
    return j
