"""Stability of the integrators of liquids (Fei 2019, Fig. 14.1): the largest Courant number with which each can step."""

from dataclasses import replace
from math import inf, sqrt
from time import perf_counter

import numpy as np

from engine.contact.obstacles import motion
from engine.liquid.observe import energies
from engine.liquid.settings import LiquidSettings
from engine.scene.build import Built, build
from engine.scene.load import load_scene
from engine.steppers.liquid import LiquidStepper
from engine.validate.catalogue import CaseResult, Row, case

WANTED = 1.24  # Courant number of the thesis's semi-implicit integrator
SIDE, SPEED, DURATION = 0.04, 1.0, 0.1  # of a cube of liquid that falls on a rod and a floor: [m], [m/s], [s]
RUNAWAY = 30.0  # times that speed, with which it has blown up
GAIN = 1e-3  # of the energy at the start, that round-off and solvers may add
STILL = {"milk-cream": 3e-3, "drilling-mud": inf}  # share of that energy left in motion: cream's yield stress brings it to rest
PATIENT = LiquidSettings(courant=inf, max_newton=50, max_linear=1000)
INTEGRATORS = {
    "explicit": replace(PATIENT, shear="explicit", pressure="explicit"),
    "explicit in shear": replace(PATIENT, shear="explicit"),
    "semi-implicit": PATIENT,
    "semi-implicit with the iterations that scenes have": LiquidSettings(courant=inf),
}
JUDGED = "semi-implicit"
MOST, LEAST = 1.5, 0.005  # Courant numbers of the speed at the start, with which the search begins and ends
HALVINGS = 3  # of the ratio 2 between a stable step and one that is not


@case("liq-stability", bar=1.0, summary="1.24 over the largest stable Courant number of a fall of cream and mud (Fei 2019)")
def stability(quick: bool) -> CaseResult:
    """The worst of the semi-implicit integrator over liquids and grids; rows tell those of the others."""
    rows: list[Row] = []
    found: dict[str, list[float]] = {}
    for liquid in STILL:
        for integrator in (JUDGED,) if quick else INTEGRATORS:
            if integrator == "explicit" and liquid == "drilling-mud":
                continue  # incompressible: there is no explicit pressure
            for cells in (6,) if quick else (6, 8, 10):
                began = perf_counter()
                courant = largest_stable(liquid, cells, INTEGRATORS[integrator])
                rows.append(Row(f"cells a side, {liquid}, {integrator}", cells, WANTED / courant if courant else inf,
                                perf_counter() - began))
                found.setdefault(f"{liquid}, {integrator}", []).append(courant)
    judged = [courant for of, courants in found.items() if of.endswith(JUDGED) for courant in courants]
    table = "; ".join(f"{of}: {', '.join(f'{courant:.2g}' for courant in courants)}" for of, courants in found.items())
    note = f"largest stable u h/dx by grid, where no speed at the start times h/dx above {MOST:g} was tried: {table}"
    return CaseResult(rows, WANTED / min(judged) if min(judged) else inf, note=note)


def largest_stable(liquid: str, cells: int, settings: LiquidSettings) -> float:
    """Return the largest Courant number of a stable fall of `cells` [cells a side], 0 where none is; its u is the fastest."""
    stable, unstable, number = 0.0, MOST, MOST
    while not (courant := stable_courant(liquid, cells, number, settings)):
        unstable, number = number, 0.5 * number
        if number < LEAST:
            return 0.0
    if number == MOST:
        return courant
    stable = number
    for _ in range(HALVINGS):
        number = sqrt(stable * unstable)
        if better := stable_courant(liquid, cells, number, settings):
            stable, courant = number, better
        else:
            unstable = number
    return courant


def stable_courant(liquid: str, cells: int, number: float, settings: LiquidSettings) -> float:
    """Return the Courant number of a fall whose step has that `number` with the speed at the start; 0 if it is not stable.

    Stable is a fall of which every step is accepted, whose energy never rises above that at the start, and after which what a
    yield stress can hold is at rest.
    """
    built = falling(liquid, cells)
    assert built.liquid is not None and built.liquid_state is not None and built.liquid_obstacles is not None
    model, state, gravity = built.liquid, built.liquid_state, np.array(built.gravity)
    solids = motion(built.liquid_obstacles, built.handles, 0.0, DURATION).end
    stepper, h = LiquidStepper(model, gravity, settings), number * model.spacing / SPEED
    at_start, fastest = sum(energies(model, state, gravity).values()), 0.0
    with np.errstate(all="ignore"):  # what blows up overflows
        for _ in range(round(DURATION / h)):
            if not stepper.step(state, h, solids, solids).accepted:
                return 0.0
            speed = float(np.linalg.norm(state.velocity, axis=1).max())
            energy = energies(model, state, gravity)
            if not (speed < RUNAWAY * SPEED and sum(energy.values()) <= (1.0 + GAIN) * at_start):
                return 0.0
            fastest = max(fastest, speed)
    return fastest * h / model.spacing if energy["kinetic"] <= STILL[liquid] * at_start else 0.0


def falling(liquid: str, cells: int) -> Built:
    """Return a cube of liquid of so many cells a side above a rod, above a floor."""
    low, high = (-0.5 * SIDE, -0.5 * SIDE, SIDE), (0.5 * SIDE, 0.5 * SIDE, 2.0 * SIDE)
    return build(load_scene({
        "strandline": 1, "name": "liq-stability", "duration": DURATION,
        "liquid": {
            "material": liquid, "spacing": SIDE / cells,
            "initial": [{"shape": "box", "low": low, "high": high, "velocity": [0, 0, -SPEED]}],
        },
        "obstacles": [
            {"name": "floor", "shape": "plane"},
            {"name": "rod", "shape": "cylinder", "radius": 0.2 * SIDE, "height": 10 * SIDE, "position": [0, 0, 0.7 * SIDE],
             "rotation": [90, 0, 0]},
        ],
    }))
