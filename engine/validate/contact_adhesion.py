"""Two strands that cohesion holds together, pulled apart."""

import numpy as np

from engine.arrays import Floats
from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandAssembly, StrandMaterial
from engine.strands.loads import StrandLoads
from engine.strands.model import StrandModel, StrandState
from engine.strands.settings import StrandSettings
from engine.validate.catalogue import CaseResult, case, timed_rows

RADIUS, LENGTH, SEGMENTS = 5e-5, 0.02, 20  # [m], [m]
HAIR = StrandMaterial(density=1300.0, young=3e9, shear=1e9)
COHESION = 0.01  # [N/m]
REACH = 0.1 * RADIUS  # of cohesion [m]
STEP, STEPS = 1e-3, 5  # in which the pull stays, so that a small excess of it moves strands out of reach [s]
INCREMENTS = (0.11, 0.033, 0.011)  # over what holds; none of them has a multiple of 1


@case("contact-adhesion", bar=1.0, summary="strands held by cohesion part where the pull exceeds it: error in load increments")
def adhesion(quick: bool) -> CaseResult:
    """How far the pull at which strands part is from cohesion times length."""
    rows = timed_rows("increment", INCREMENTS, lambda increment: abs(parting_pull(increment) - 1.0) / increment)
    return CaseResult(rows, max(row.error for row in rows), note="increments are of cohesion times length")


def parting_pull(increment: float) -> float:
    """Return the pull, over cohesion times length, under which strands come out of reach of each other somewhere."""
    model, state = pair()
    stepper = StrandStepper(model, np.zeros(3), StrandSettings(cohesion=COHESION, cohesion_reach=REACH))
    pull = 0.0
    while pull < 2.0:
        pull += increment
        for _ in range(STEPS):
            report = stepper.step(state, STEP, StrandLoads(force=pull * COHESION * evenly(model)))
            if not report.accepted:
                raise RuntimeError(report.reason)
        if distances(state).max() > 2.0 * RADIUS + REACH:
            return pull
    raise RuntimeError("the strands do not part")


def pair() -> tuple[StrandModel, StrandState]:
    """Return a free strand that touches a held one all along."""
    s = np.linspace(0.0, LENGTH, SEGMENTS + 1)
    assembly = StrandAssembly()
    assembly.strand(np.column_stack([s, 0.0 * s, np.full_like(s, 2.0 * RADIUS)]), RADIUS, HAIR)
    held = np.ones((SEGMENTS + 1, 4), np.bool_)
    assembly.strand(np.column_stack([s, 0.0 * s, 0.0 * s]), RADIUS, HAIR, held=held)
    return assembly.build()


def evenly(model: StrandModel) -> Floats:
    """Return the length of strand that goes to each free vertex, upward, shape [V, 3] [m]."""
    share = np.zeros((len(model.mass), 3))
    share[: SEGMENTS + 1, 2] = model.mass[: SEGMENTS + 1] / model.mass[: SEGMENTS + 1].sum() * LENGTH
    return share


def distances(state: StrandState) -> Floats:
    """Return the heights of the free strand's centre line at its vertices over that of the held one [m]."""
    return state.x[: SEGMENTS + 1, 2] - state.x[SEGMENTS + 1 :, 2]
