"""A rubber rod that is clamped at one end: let go under its weight, or swinging a little; this engine's way through both.

The places of its tip are compared with closed forms of rods as those who solve them see them: here without shear.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.polynomial import Chebyshev

from engine.arrays import Floats
from engine.run.threads import threads_for
from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandMaterial
from engine.strands.loads import StrandLoads
from engine.strands.settings import StrandSettings
from engine.validate.der_statics import elastica_tip
from engine.validate.der_vibration import ROOTS, mode
from engine.validate.strands import EARTH, cantilever

LENGTH, RADIUS = 0.2, 2e-3  # [m]; thick, for the peer's steps get shorter with the radius
RUBBER = StrandMaterial(density=1000.0, young=1e7, shear=1e7 / 3)
SHEAR_FACTOR = 27 / 28  # of a round section (Kaneko 1975), as the peer has it
SLENDERNESS = (RADIUS / (2 * LENGTH)) ** 2  # I / (A L^2)
SHEARED = SLENDERNESS * RUBBER.young / (SHEAR_FACTOR * RUBBER.shear)  # E I / (k G A L^2)
HEAVINESS = 4 * RUBBER.density * EARTH * LENGTH**3 / (RUBBER.young * RADIUS**2)  # rho g A L^3 / E I
PULSE = ROOTS[0] ** 2 / LENGTH**2 * sqrt(RUBBER.young * RADIUS**2 / (4 * RUBBER.density))  # of Euler and Bernoulli's beam [rad/s]
SETTLED = 2.0  # [s], after which what is left of the motion is 1e-7 of the length
SMALL = 1e-5  # amplitude of the tip over the length
TOLERANCE = 1e-9  # of Newton's residual, so that what is off comes of segments and steps


@dataclass(frozen=True)
class RodProblem:
    """A rod that is straight and level at the start."""

    name: str
    duration: float  # [s]
    gravity: float  # [m/s^2]
    damping: float  # force over velocity and mass [1/s]
    speed: Callable[[Floats], Floats]  # at the start, upward, by the distance from the clamp [m/s]
    error: Callable[[Floats, bool], float]  # of the places of the tip after even steps [n, 3] [m], of a rod with shear or without


def let_go() -> RodProblem:
    """Return the rod that comes to rest under its weight, damped critically as far as small vibrations go.

    The error is the distance of the tip to that of the elastica, over the length.
    """
    without, sheared = elastica_tip(HEAVINESS, SLENDERNESS), elastica_tip(HEAVINESS, SLENDERNESS, SHEARED)

    def error(tips: Floats, shear: bool) -> float:
        x, z = sheared if shear else without
        return float(np.hypot(tips[-1, 0] / LENGTH - x, tips[-1, 2] / LENGTH - z))

    return RodProblem("cantilever", SETTLED, EARTH, 2 * PULSE, np.zeros_like, error)


def first_mode() -> RodProblem:
    """Return a period of the first mode from the straight rod; the error is the largest of the tip's way, over the amplitude."""
    amplitude = SMALL * LENGTH
    duration = 2 * np.pi / PULSE

    def error(tips: Floats, shear: bool) -> float:
        time = duration * np.arange(1, len(tips) + 1) / len(tips)
        pulse = PULSE / sqrt(1 + thickness_effect()) if shear else PULSE
        return float(np.abs(tips[:, 2] / amplitude - PULSE / pulse * np.sin(pulse * time)).max())

    def speed(x: Floats) -> Floats:
        return amplitude * PULSE * mode(ROOTS[0], x / LENGTH)

    return RodProblem("vibration", duration, 0.0, 0.0, speed, error)


def thickness_effect() -> float:
    """Relative increase of the first mode's 1 / pulse^2 by shear and by inertia of sections (Timoshenko), to first order.

    That is I / (A L^2) times |w'|^2 / |w|^2 + E / (k G) |w'''|^2 / (b^4 |w|^2), w being the mode over the length.
    """
    shape = Chebyshev.interpolate(lambda s: mode(ROOTS[0], s), 24, [0.0, 1.0])

    def squared(values: Chebyshev) -> float:
        whole = (values**2).integ(lbnd=0.0)
        return float(whole(1.0))

    bent = SLENDERNESS * squared(shape.deriv()) + SHEARED * squared(shape.deriv(3)) / ROOTS[0] ** 4
    return bent / squared(shape)


def swing(problem: RodProblem, segments: int, steps: int) -> Floats:
    """Return the places of the tip after each step, shape [steps, 3] [m]. Raises RuntimeError where a step is rejected."""
    model, state = cantilever(segments, LENGTH, RADIUS, RUBBER)
    state.velocity[2:, 2] = problem.speed(state.x[2:, 0])
    stepper = StrandStepper(model, np.array([0.0, 0.0, -problem.gravity]), StrandSettings(tolerance=TOLERANCE, contact="none"))
    loads = StrandLoads(drag=problem.damping * model.mass)
    tips = np.empty((steps, 3))
    with threads_for(len(model.mass)):
        for step in range(steps):
            report = stepper.step(state, problem.duration / steps, loads)
            if not report.accepted:
                raise RuntimeError(report.reason)
            tips[step] = state.x[-1]
    return tips
