"""One yarn pulled out of the yarns it crosses: it rubs on each of them, and on one less after every exit."""

from typing import Any

import numpy as np

from engine.arrays import Floats
from engine.geometry.handles import Handles
from engine.validate.catalogue import CaseResult, case, timed_rows
from engine.validate.rods import WEIGHTLESS, stepper
from engine.yarns.assembly import YarnAssembly, YarnMaterial
from engine.yarns.normal_force import crimp_force

CROSSINGS, SPACING, FRICTION = 6, 1e-2, 0.5
# so stiff and thin that its crimp presses with a force of its own, to which the pull adds a thousandth
CORD = YarnMaterial(radius=2e-6, density=1e-6, stretch_stiffness=50.0, bending_stiffness=6e-4, mass_damping=50.0)
TAIL = 0.5  # of the yarn behind the last crossing at the start [spacings]
SPEED = 0.02  # of the pull [m/s]
TAKES_HOLD = 0.3  # after which every crossing slips; later, an exit leaves this long for the force to fall [spacings]
TIGHT: dict[str, Any] = dict(tolerance=1e-2, linear_tolerance=1e-6)


@case("woven-pull-out", bar=0.02, summary="yarn pulled out of n crossings: force over n mu F_n while n yarns are left")
def pull_out(quick: bool) -> CaseResult:
    """Worst relative error of the force over all steps, while 6, 5, ... 1 crossings are left, and force left after that."""
    of_count: dict[int, float] = {}

    def error(dt: float) -> float:
        of_count.clear()
        for passed, force in zip(*pulled(dt), strict=True):
            left = CROSSINGS - int(np.floor(passed + 1.0 - TAIL))
            since = (passed + 1.0 - TAIL) % 1.0 if left < CROSSINGS else passed
            if since > TAKES_HOLD:
                wrong = abs(force / (FRICTION * normal_force()) - left) / max(left, 1)
                of_count[left] = max(of_count.get(left, 0.0), wrong)
        return float(max(of_count.values()))

    rows = timed_rows("dt [s]", (0.05, 0.025, 0.0125) if quick else (0.05, 0.025, 0.0125, 0.00625), error)
    said = ", ".join(f"{left} left: {wrong:.1e}" for left, wrong in of_count.items())
    return CaseResult(rows, rows[-1].error, note=f"what is left is the viscous hold of u; {said}")


def normal_force() -> float:
    """F_n of a crossing of two crimped yarns without tension [N]."""
    return float(crimp_force(2.0 * CORD.radius, SPACING, CORD.bending_stiffness, 0.0))


def pulled(dt: float) -> tuple[Floats, Floats]:
    """Return how far the yarn has been pulled [spacings] and the force that takes [N], after every step."""
    yarns = YarnAssembly()
    start, length = -TAIL * SPACING, (CROSSINGS + TAIL) * SPACING
    drawn = yarns.yarn(CORD, length, SPACING, fabric=0)
    yarns.lagrangian(drawn, 0.0, np.array([start, 0.0, 0.0]))
    head = yarns.lagrangian(drawn, length, np.array([start + length, 0.0, 0.0]), pinned=True, handle=0)
    for k in range(CROSSINGS):
        x = np.array([k * SPACING, 0.0, 0.0])
        other = yarns.yarn(CORD, SPACING, SPACING, fabric=0)
        for end in (-0.5, 0.5):
            yarns.lagrangian(other, (end + 0.5) * SPACING, x + end * np.array([0.0, SPACING, 0.0]), pinned=True)
        below, above = (drawn, x[0] - start), (other, 0.5 * SPACING)
        if k % 2:
            below, above = above, below
        yarns.crossing(*below, *above, x, np.array([0.0, 0.0, 1.0]), FRICTION)
    model, state = yarns.build()
    far = CROSSINGS + TAIL
    handles = Handles(np.array([0, 2]), np.array([0.0, far * SPACING / SPEED]), np.array([[0.0, 0, 0], [far * SPACING, 0, 0]]))
    march = stepper(model, WEIGHTLESS, handles, **TIGHT)
    passed, force = [], []
    for step in range(round(far * SPACING / SPEED / dt)):
        report = march.step(state, step * dt, dt)
        if not report.accepted:
            raise RuntimeError(f"step {step} of {dt:.3g} s: {report.reason}, residual {report.residual:.3g}")
        passed.append((step + 1) * dt * SPEED / SPACING)
        force.append(-state.contact_force[head, 0])
    return np.array(passed), np.array(force)
