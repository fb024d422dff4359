"""Order of both integrators in the step: small vibrations in bending and in twist, with and without friction.

The references are the motions of the same chains of masses and springs, each a mode, whose matrices are made here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product
from math import pi
from typing import Literal, get_args

import numpy as np
from scipy.linalg import eigh

from engine.arrays import Floats
from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandMaterial
from engine.strands.model import StrandModel, StrandState
from engine.strands.observe import energies
from engine.strands.settings import StrandSettings
from engine.validate.catalogue import CaseResult, Row, case, timed_rows
from engine.validate.fit import fitted_exponent
from engine.validate.strands import cantilever

Integrator = Literal["euler", "bdf2"]
ORDERS: dict[Integrator, float] = {"euler": 0.9, "bdf2": 1.8}  # at least
SEGMENTS, LENGTH, RADIUS = 16, 0.2, 0.01  # [m]
STEEL = StrandMaterial(density=7800.0, young=2e11, shear=8e10)
BENT, TWISTED = 1e-4, 0.1  # amplitudes: of the tip over the length, of the last edge [rad]
PERIODS = 1.25
DAMPED = 0.1  # share of the critical damping
STEPS = (100, 200, 400, 800)  # a period
LONG = (100, 50)  # periods in which energy must not rise, steps of each


@dataclass(frozen=True)
class Mode:
    """A vibration of a cantilever: q(t) times `shape`, where q'' + friction omega^2 q' + omega^2 q = 0, q(0) = 1, q'(0) = 0."""

    model: StrandModel
    state: StrandState
    omega: float  # [rad/s]
    damping: float  # share of the critical one
    read: Callable[[StrandState], tuple[float, float]]  # q and q'

    def error(self, integrator: Integrator, steps: float) -> float:
        """Distance from the motion after PERIODS in `steps` a period, in the plane of q and q' / omega."""
        return self.error_after(integrator, np.full(round(PERIODS * steps), 2 * pi / (self.omega * steps)))

    def error_after(self, integrator: Integrator, steps: Floats) -> float:
        """The same after `steps` [n] of any lengths [s]."""
        state, stepper = self.state.copy(), _stepper(self.model, integrator)
        for h in steps:
            _step(stepper, state, float(h))
        q, rate = self.read(state)
        time = steps.sum()
        decay, omega = self.damping * self.omega, self.omega * np.sqrt(1 - self.damping**2)
        cosine, sine = np.exp(-decay * time) * np.array([np.cos(omega * time), np.sin(omega * time)])
        wanted, wanted_rate = cosine + decay / omega * sine, -(self.omega**2) / omega * sine
        return float(np.hypot(q - wanted, (rate - wanted_rate) / self.omega))


@case("der-order", bar=1e-3, order=ORDERS["bdf2"], summary="vibrations in bending and twist, with friction: order in the step")
def order(quick: bool) -> CaseResult:
    """Error of BDF2 in undamped bending, and its order; orders in all motions, and that energy never rises, beside it."""
    modes = {"bending": bending(0.0), "bending with friction": bending(DAMPED),
             "twist": twist(0.0), "twist with friction": twist(DAMPED)}
    rows: dict[tuple[str, Integrator], list[Row]] = {}
    failures, notes = [], []
    steps = STEPS[:3] if quick else STEPS
    for name, integrator in product(modes, get_args(Integrator)):
        error = partial(modes[name].error, integrator)
        rows[name, integrator] = timed_rows(f"steps a period, {integrator}, {name}", steps, error)
        reached = _order(rows[name, integrator])
        notes.append(f"order of {integrator} in {name} {reached:.2f}")
        if reached < ORDERS[integrator]:
            failures.append(f"{notes[-1]} is below {ORDERS[integrator]}")
    periods, steps_each = LONG
    for integrator in get_args(Integrator):
        kept, rise = energy_kept(modes["bending"], integrator, periods // 10 if quick else periods, steps_each)
        notes.append(f"{integrator} keeps {kept:.2g} of the energy of bending")
        if rise > 1e-9:
            failures.append(f"energy rises in a step of {integrator} by {rise:.2g} of what it was at first")
    judged = rows["bending", "bdf2"]
    return CaseResult([row for own in rows.values() for row in own], judged[-1].error, order=_order(judged),
                      note="; ".join(notes), failures=failures)


def _order(rows: list[Row]) -> float:
    return fitted_exponent([1 / row.value for row in rows], [row.error for row in rows]) or 0.0


def bending(damping: float) -> Mode:
    """Return the lowest mode of bending, with a share of the critical damping."""
    model, state = cantilever(SEGMENTS, LENGTH, RADIUS, STEEL)
    segment = LENGTH / (SEGMENTS + 0.5)
    count = SEGMENTS + 2
    curvature = (np.eye(count - 2, count) - 2 * np.eye(count - 2, count, 1) + np.eye(count - 2, count, 2))[:, 2:] / segment
    mass = np.full(count - 2, STEEL.density * pi * RADIUS**2 * segment)
    mass[-1] /= 2
    stiffness = STEEL.young * pi * RADIUS**4 / 4 / segment * curvature.T @ curvature
    omega, shape = _lowest(stiffness, mass)
    amplitude = BENT * LENGTH
    state.x[2:, 2] = amplitude * shape
    return Mode(_with_friction(model, damping, omega), state, omega, damping,
                lambda now: (now.x[-1, 2] / amplitude, now.velocity[-1, 2] / amplitude))


def twist(damping: float) -> Mode:
    """Return the lowest mode of twist, with a share of the critical damping."""
    model, state = cantilever(SEGMENTS, LENGTH, RADIUS, STEEL)
    segment = LENGTH / (SEGMENTS + 0.5)
    difference = (np.eye(SEGMENTS) - np.eye(SEGMENTS, k=-1)) / segment  # of edges behind the one that is held
    stiffness = STEEL.shear * pi * RADIUS**4 / 2 * segment * difference.T @ difference
    omega, shape = _lowest(stiffness, np.full(SEGMENTS, STEEL.density * pi * RADIUS**4 / 2 * segment))
    angle = np.concatenate([[0.0], TWISTED * shape])
    first, second = state.m1[0].copy(), np.cross([1.0, 0.0, 0.0], state.m1[0])
    state.m1[:-1] = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    state.twist[1:-1] = np.diff(angle)
    return Mode(_with_friction(model, damping, omega), state, omega, damping,
                lambda now: (np.arctan2(now.m1[-2] @ second, now.m1[-2] @ first) / TWISTED, now.spin[-2] / TWISTED))


def energy_kept(mode: Mode, integrator: Integrator, periods: int, steps: int) -> tuple[float, float]:
    """Return the share of the energy that is left after so many periods, and the largest rise in a step over that at first."""
    state, stepper, still = mode.state.copy(), _stepper(mode.model, integrator), np.zeros(3)

    def energy() -> float:
        return sum(energies(mode.model, state, still).values())

    start = last = energy()
    rise = 0.0
    for _ in range(periods * steps):
        _step(stepper, state, 2 * pi / (mode.omega * steps))
        rise, last = max(rise, energy() - last), energy()
    return last / start, rise / start


def _stepper(model: StrandModel, integrator: Integrator) -> StrandStepper:
    return StrandStepper(model, np.zeros(3), StrandSettings(integrator=integrator, tolerance=1e-9, contact="none"))


def _step(stepper: StrandStepper, state: StrandState, h: float) -> None:
    report = stepper.step(state, h)
    if not report.accepted:
        raise RuntimeError(report.reason)


def _lowest(stiffness: Floats, mass: Floats) -> tuple[float, Floats]:
    """Frequency [rad/s] and shape of the lowest mode, 1 at the tip."""
    squares, shapes = eigh(stiffness, np.diag(mass), subset_by_index=[0, 0])
    return float(np.sqrt(squares[0])), shapes[:, 0] / shapes[-1, 0]


def _with_friction(model: StrandModel, damping: float, omega: float) -> StrandModel:
    return model._replace(damping=np.full(len(model.mass), 2 * damping / omega))
