"""Small free vibrations of a cantilever."""

from math import pi, sqrt

import numpy as np

from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandMaterial
from engine.strands.settings import StrandSettings
from engine.validate.catalogue import CaseResult, case, timed_rows
from engine.validate.strands import cantilever

LENGTH, RADIUS = 0.2, 1e-3  # [m]
STEEL = StrandMaterial(density=7800.0, young=2e11, shear=8e10)
ROOTS = (1.87510406871, 4.69409113297)  # of cos(b) cosh(b) = -1
SMALL = 1e-5  # amplitude of the tip over the length
STEPS = 2000  # a period
SEGMENTS = 64


@case("der-vibration", bar=1e-2, summary="cantilever released in the shape of a mode: error of the frequency")
def vibration(quick: bool) -> CaseResult:
    """Relative error of the first frequency, and of the second beside it; `quick` has the coarser rods only."""
    second: list[float] = []

    def error(segments: float) -> float:
        errors = [abs(_frequency(int(segments), root) / _wanted(root) - 1) for root in ROOTS]
        second[:] = errors[1:]
        return errors[0]

    rows = timed_rows("segments", (16, 32, SEGMENTS) if not quick else (8, 16, 32), error)
    return CaseResult(rows, rows[-1].error, note=f"{STEPS} steps a period; second frequency within {second[0]:.2g}",
                      failures=[] if second[0] <= 1e-2 else [f"second frequency off by {second[0]:.2g}"])


def _wanted(root: float) -> float:
    """Frequency of Euler and Bernoulli's beam [Hz]: b^2 / (2 pi L^2) (E I / rho A)^1/2."""
    return root**2 / (2 * pi * LENGTH**2) * sqrt(STEEL.young * RADIUS**2 / (4 * STEEL.density))


def _frequency(segments: int, root: float) -> float:
    """Inverse of the time from the first to the third passage of the tip through the middle [Hz]."""
    model, state = cantilever(segments, LENGTH, RADIUS, STEEL)
    state.x[:, 2] = SMALL * LENGTH * mode(root, np.maximum(state.x[:, 0], 0.0) / LENGTH)
    state.x[:2, 2] = 0.0
    stepper = StrandStepper(model, np.zeros(3), StrandSettings(tolerance=1e-9, contact="none"))
    h = 1 / (_wanted(root) * STEPS)
    passages: list[float] = []
    before = state.x[-1, 2]
    for step in range(4 * STEPS):
        report = stepper.step(state, h)
        if not report.accepted:
            raise RuntimeError(report.reason)
        after = state.x[-1, 2]
        if before * after < 0:
            passages.append((step + before / (before - after)) * h)
        if len(passages) == 3:
            return 1 / (passages[2] - passages[0])
        before = after
    raise RuntimeError("the tip does not swing")


def mode(b: float, s: np.ndarray) -> np.ndarray:
    """Shape of the mode with root b at s in [0, 1], 1 at the tip."""
    ratio = (np.cos(b) + np.cosh(b)) / (np.sin(b) + np.sinh(b))

    def shape(s):
        return np.cosh(b * s) - np.cos(b * s) - ratio * (np.sinh(b * s) - np.sin(b * s))

    return shape(s) / shape(1.0)
