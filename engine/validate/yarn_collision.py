"""Rods that meet where no contact joins them: one at rest on others, and two that collide in flight."""

from dataclasses import replace

import numpy as np

from engine.arrays import Floats
from engine.contact import collisions as contact
from engine.contact.obstacles import Obstacles
from engine.contact.sphere_packing import collision_pairs, collisions_at_start
from engine.geometry.handles import no_handles
from engine.steppers.yarns import YarnStepper
from engine.validate.catalogue import CaseResult, case, timed_rows
from engine.validate.rods import DOWN, WEIGHTLESS, march
from engine.yarns import observe
from engine.yarns.assembly import YarnAssembly, YarnMaterial
from engine.yarns.model import YarnModel, YarnState
from engine.yarns.settings import YarnSettings

STEPS = (2e-3, 1e-3, 5e-4, 2.5e-4)  # [s]
RADIUS, LENGTH, SEGMENTS = 1e-3, 0.1, 20
ROD = YarnMaterial(radius=RADIUS, density=3e-3, stretch_stiffness=100.0, bending_stiffness=1e-4)
SUPPORTS = (-0.0213, 0.0287)  # where a rod lies on two others, on no node [m]
SETTLED, SPEED, FLIGHT = 0.3, 0.5, 0.02  # [s], [m/s], [s]
DRIFT, RISE = 1e-9, 1e-8  # of momentum and energy, relative to those of one rod at the start


@case("yarn-collision", bar=0.05, summary="rods that nothing joins keep their thickness apart; momentum and energy in flight")
def yarn_collision(quick: bool) -> CaseResult:
    """How far the distance of a rod at rest on others is from the sum of both radii, relative to it."""
    flights = []

    def sinkage(dt: float) -> float:
        flights.append(collide(dt))
        return at_rest(dt)

    rows = timed_rows("dt [s]", STEPS[:3] if quick else STEPS, sinkage)
    drift, rise, apart = (max(values) for values in zip(*flights, strict=True))
    failures = [text for holds, text in (
        (drift <= DRIFT, f"momentum drifts by {drift:.2g} of that of one rod"),
        (rise <= RISE, f"energy rises by {rise:.2g} of that at the start"),
        (apart < 0.0, "rods that collided do not fly apart"),
    ) if not holds]
    note = f"of one rod's at the start, momentum drifts by {drift:.1e} and energy rises by {rise:.1e} in a collision in flight"
    return CaseResult(rows, max(row.error for row in rows), note="" if failures else note, failures=failures)


def at_rest(dt: float) -> float:
    """A rod falls from 2.5 radii on two given ones across it; relative error of its distance at rest, at either."""
    yarns = YarnAssembly()
    for x in SUPPORTS:
        add(yarns, np.array([x, -0.5 * LENGTH, 0.0]), np.array([0.0, 1.0, 0.0]), kinematic=True)
    add(yarns, np.array([-0.5 * LENGTH, 0.003, 2.5 * RADIUS]), np.array([1.0, 0.0, 0.0]), mass_damping=30.0)
    model, state = yarns.build()
    for _ in march(stepper(model, state, DOWN), state, SETTLED, dt):
        pass
    own = model.node_point[model.node_start[2]:]
    heights = np.interp(SUPPORTS, state.x[own, 0], state.x[own, 2])
    return float(np.abs(heights / (2.0 * RADIUS) - 1.0).max())


def collide(dt: float) -> tuple[float, float, float]:
    """Two perpendicular rods fly at each other in the middle.

    Returns the largest drift of momentum, the largest rise of energy between steps, each relative to the one of one rod at
    the start, and the speed of approach at the end relative to that at the start.
    """
    yarns = YarnAssembly()
    add(yarns, np.array([-0.5 * LENGTH, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    add(yarns, np.array([0.0, -0.5 * LENGTH, 4.0 * RADIUS]), np.array([0.0, 1.0, 0.0]))
    model, state = yarns.build()
    below = model.node_yarn == 0
    state.velocity[:] = np.where(below, SPEED, -SPEED)[:, None, None] * np.array([0.0, 0.0, 1.0])
    mass = ROD.density * LENGTH
    own = stepper(model, state, WEIGHTLESS)
    energy, rise, drift = energy_of(own, model, state), 0.0, 0.0
    for _ in march(own, state, FLIGHT, dt):
        before, energy = energy, energy_of(own, model, state)
        rise = max(rise, (energy - before) / (0.5 * mass * SPEED**2))
        drift = max(drift, float(np.abs(observe.momentum(model, state)).max()) / (mass * SPEED))
    speed = state.x_rate[model.node_point, 2]
    return drift, rise, float(speed[below].mean() - speed[~below].mean()) / (2.0 * SPEED)


def add(yarns: YarnAssembly, start: Floats, along: Floats, kinematic: bool = False, mass_damping: float = 0.0) -> None:
    """Add a straight rod."""
    rod = yarns.yarn(replace(ROD, mass_damping=mass_damping), LENGTH, LENGTH / SEGMENTS, kinematic=kinematic)
    u = np.linspace(0.0, LENGTH, SEGMENTS + 1)
    yarns.lagrangians(rod, u, start + u[:, None] * along, pinned=kinematic)


def stepper(model: YarnModel, state: YarnState, gravity: Floats) -> YarnStepper:
    """Return a stepper whose yarns collide."""
    nothing = Obstacles(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(0))
    collisions = collisions_at_start(model, state, thickness=1.0, stiffness=1.0, spacing=0.5)
    return YarnStepper(model, YarnSettings(tolerance=1e-5), gravity, nothing, no_handles(), collisions)


def energy_of(own: YarnStepper, model: YarnModel, state: YarnState) -> float:
    """Return the energy of yarns and of what presses them together [J]."""
    assert own.collisions is not None
    chain = observe.chain_now(model, state)
    pairs = collision_pairs(own.collisions, model, state.copy(), chain, 0.0)
    unused = np.zeros((model.point_count, 5))
    pressed = contact.add_gradient(pairs.point, pairs.weight, pairs.rest, pairs.stiffness, state.x, unused)
    return sum(observe.energies(model, state, WEIGHTLESS).values()) + float(pressed)
