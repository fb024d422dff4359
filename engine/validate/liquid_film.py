"""Steady films down an incline, whose profiles are known: Newtonian, and with a plug of Herschel-Bulkley's liquids."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, radians, sin
from typing import Literal

import numpy as np

from engine.arrays import Flags, Floats
from engine.liquid.observe import shear_stress
from engine.liquid.settings import LiquidSettings
from engine.scene.liquid_materials import LiquidMaterial
from engine.validate.catalogue import CaseResult, Row, case
from engine.validate.liquids import EARTH, FLOOR, PER_SIDE, Vessel, box, liquid, planes, rows

CELLS = (8, 16, 32)  # through the film
JUDGED = 16  # from as many on: of 8, fewer than five shear where there is a plug
DEPTH, ANGLE, DENSITY = 0.01, radians(30.0), 1000.0  # [m], of the incline, [kg/m^3]
PULL = DENSITY * EARTH * sin(ANGLE)  # along the incline [N/m^3]
ACROSS = 4  # cells, after which the film repeats
COURANT = 0.5  # of the surface in steady flow
LONGEST_STEP, QUICK_STEP = 5e-4, 1.5e-3  # at most [s]: so that strain in it is not far beyond that which is elastic
STEADY, QUICK_STEADY = 5e-4, 5e-3  # of gravity along the incline, that the mean velocity still grows by
LOOK, LONGEST = 0.02, 3.0  # [s] between looks at whether it is steady; until it must be
LOOKS = 3  # in a row at which it must be: shear waves come to rest for a moment
ALIKE = 0.99  # of the surface's velocity: what is faster counts as the plug that one sees
YIELDING = LiquidMaterial(density=DENSITY, shear_modulus=2000.0, yield_stress=20.0, consistency=1.0)
LIQUIDS = {
    "Newtonian": LiquidMaterial(density=DENSITY, consistency=1.0),
    "Bingham": YIELDING,
    "n = 0.5": YIELDING.model_copy(update={"flow_index": 0.5, "consistency": 3.0}),
    "n = 0.3": YIELDING.model_copy(update={"flow_index": 0.3, "consistency": 8.0}),
}
QUICK = ("Newtonian", "Bingham")

Flow = Literal["implicit", "analytic"]


@dataclass(frozen=True)
class Film:
    """How far a steady film is from its closed form."""

    velocity: float  # largest difference, over the velocity of the surface
    plug: float  # difference of the thickness of what has not yielded [cells]
    alike: float  # and of what moves nearly as the surface does [cells]


@case("liq-film", bar=0.03, summary="velocity and plug of steady films down an incline: Newtonian, Bingham, Herschel-Bulkley")
def film(quick: bool) -> CaseResult:
    """Largest relative error of velocity; the thickness of the plug must be right to a cell, by stress and by velocity."""
    cells, enough, longest = (CELLS[:1], QUICK_STEADY, QUICK_STEP) if quick else (CELLS, STEADY, LONGEST_STEP)
    found, failures, notes = [], [], []
    for name in QUICK if quick else LIQUIDS:
        films: dict[int, Film] = {}
        found += _rows(name, cells, enough, longest, "implicit", films)
        for count, one in films.items():
            notes.append(f"{name}, {count} cells: plug off by {one.plug:.2g} cells by stress, {one.alike:.2g} by velocity")
            if not max(one.plug, one.alike) <= 1.0:
                failures.append(f"{name}, {count} cells: the thickness of the plug is off by more than a cell")
    judged = max(row.error for row in found if quick or row.value >= JUDGED)
    if not quick:
        notes.append(f"judged from {JUDGED} cells on")
        found += _rows("Bingham", cells[:2], enough, longest, "analytic", {})
        notes.append("rows with the return of eq. 14.9 are not judged")
    return CaseResult(found, judged, note="; ".join(notes), failures=failures)


def _rows(
    name: str, cells: Sequence[int], enough: float, longest: float, plastic_flow: Flow, films: dict[int, Film]
) -> list[Row]:
    """Rows over cells, and what each film was."""
    steady(LIQUIDS[name], cells[0], enough=1.0, plastic_flow=plastic_flow)  # compiles the kernels, untimed

    def error(count: float) -> float:
        films[round(count)] = steady(LIQUIDS[name], round(count), COURANT, enough, longest, plastic_flow)
        return films[round(count)].velocity

    return rows(f"cells, {name}{'' if plastic_flow == 'implicit' else ', return of eq. 14.9'}", cells, error)


def steady(
    material: LiquidMaterial, cells: int, courant: float = COURANT, enough: float = STEADY, longest: float = LONGEST_STEP,
    plastic_flow: Flow = "implicit",
) -> Film:
    """Return how a film is that began at rest, once it is steady. Raises RuntimeError where it does not come to that.

    It is steady where its mean velocity grows by less than `enough` of gravity along the incline; `courant` is the number of
    cells that the surface crosses in a step then, unless that is a step longer than `longest` [s].
    """
    model = liquid(material, DEPTH / cells, period=(ACROSS, ACROSS, 0), no_slip=True)
    state = box(model, (ACROSS * model.spacing, ACROSS * model.spacing, DEPTH))
    gravity = (EARTH * sin(ANGLE), 0.0, -EARTH * cos(ANGLE))
    vessel = Vessel(model, state, gravity, planes(FLOOR), LiquidSettings(plastic_flow=plastic_flow, shear_tolerance=1e-4))
    surface = float(velocity_at(material, np.array([DEPTH]))[0])
    _bring_to_steady_flow(vessel, min(courant * model.spacing / surface, longest), enough)
    z, u = state.x[:, 2], state.velocity[:, 0]
    off = float(np.abs(u - velocity_at(material, z)).max()) / surface
    pitch = model.spacing / PER_SIDE
    alike = _top_layer(z, u > ALIKE * u.max(), pitch) - _top_layer(z, velocity_at(material, z) > ALIKE * surface, pitch)
    plug = 0.0
    if model.elastic:
        holds = shear_stress(model, state) < material.yield_stress
        plug = _top_layer(z, holds, pitch) - (DEPTH - sheared_depth(material))
    return Film(off, abs(plug) / model.spacing, abs(alike) / model.spacing)


def _bring_to_steady_flow(vessel: Vessel, h: float, enough: float) -> None:
    volume, steps = vessel.state.volume, round(LOOK / h)
    mean, steady_looks = 0.0, 0
    for _ in range(round(LONGEST / LOOK)):
        for _ in range(steps):
            vessel.step(h)
        before, mean = mean, float(volume @ vessel.state.velocity[:, 0] / volume.sum())
        is_steady = abs(mean - before) < enough * EARTH * sin(ANGLE) * steps * h
        steady_looks = steady_looks + 1 if is_steady else 0
        if steady_looks == LOOKS:
            return
    raise RuntimeError(f"the film is not steady after {LONGEST:g} s")


def _top_layer(z: Floats, within: Flags, pitch: float) -> float:
    """Thickness [m] of the layer under the surface in which all particles are `within`; they are `pitch` [m] apart."""
    return DEPTH - 0.5 * pitch - float(z[~within].max(initial=-0.5 * pitch))


def sheared_depth(material: LiquidMaterial) -> float:
    """Return how deep the liquid shears [m]: up to where its weight along the incline no longer makes it yield."""
    return max(DEPTH - material.yield_stress / PULL, 0.0)


def velocity_at(material: LiquidMaterial, z: Floats) -> Floats:
    """Return the velocity [m/s] of the steady film at heights z [m], of a shear stress yield + consistency rate^n."""
    n, sheared = material.flow_index, sheared_depth(material)
    power = 1.0 + 1.0 / n
    rate = (PULL / material.consistency) ** (1.0 / n)
    return rate / power * (sheared**power - np.maximum(sheared - z, 0.0) ** power)
