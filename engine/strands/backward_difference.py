"""Time integrators of strands: implicit Euler, and the backward differentiation formula BDF2 for steps that vary.

From y_n, in a step h that follows one of h / w from y_(n-1), BDF2 takes y' = f(y) to

    (1 + 2w) / (1 + w) y - (1 + w) y_n + w^2 / (1 + w) y_(n-1) = h f(y)

(Hairer, Norsett and Wanner 1993, sec. III.5). This is implicit Euler's step y = y* + h* f(y), but one of
h* = h (1 + w) / (1 + 2w) from y* = y_n + c (y_n - y_(n-1)) with c = w^2 / (1 + 2w); w = 0 is implicit Euler itself. So places,
velocities, turns, spins and the strains that internal friction sees are led by the same incremental potential either way.

BDF2 knows the motion before the step, and is right to second order where that goes on smoothly. Strands that touch something
take implicit Euler's step, and the one after a contact has pressed does: across an impact BDF2 would go on from a velocity that
is no more, and throw a strand that hits a wall back at up to 1.1 times its speed.
"""

from typing import NamedTuple

import numpy as np

from engine.arrays import Flags, Floats
from engine.strands.model import StrandModel, StrandState

LARGEST_RATIO = 1.0 + np.sqrt(2.0)  # of a step to the one before, up to which BDF2 is stable as steps tend to zero


class BackwardDifference(NamedTuple):
    """The rate (y - y*) / h* of y at the end of a step; all vertices of a strand have the same entries."""

    h: float  # the step [s]
    effective: Floats  # h* [s], shape [V]
    lean: Floats  # c, shape [V]

    def base(self, now: Floats, earlier: Floats) -> Floats:
        """Return y* where y [V, ...] is `now` at the start of the step and was `earlier` a step before."""
        return now + _column(self.lean, now) * (now - earlier) if self.lean.any() else now

    def rate(self, end: Floats, now: Floats, earlier: Floats) -> Floats:
        """Return y' at the end of the step, where y [V, ...] is `end` there, and `now` and `earlier` as in `base`."""
        return (end - self.base(now, earlier)) / _column(self.effective, now)


def implicit_euler(model: StrandModel, h: float) -> BackwardDifference:
    """Return that of a step of h [s] that knows of none before."""
    return BackwardDifference(h, np.full(len(model.mass), h), np.zeros(len(model.mass)))


def bdf2(model: StrandModel, state: StrandState, h: float, touches: Flags) -> BackwardDifference:
    """Return that of a step of h [s]: implicit Euler's for strands that `touches` [S], or that have no step before.

    It is, too, where h is more than LARGEST_RATIO times the step before.
    """
    goes_on = ~touches & (state.last_step > 0.0) & (h <= LARGEST_RATIO * state.last_step)
    ratio = np.divide(h, state.last_step, out=np.zeros(len(touches)), where=goes_on)
    effective, lean = h * (1.0 + ratio) / (1.0 + 2.0 * ratio), ratio**2 / (1.0 + 2.0 * ratio)
    vertices = np.diff(model.start)
    return BackwardDifference(h, np.repeat(effective, vertices), np.repeat(lean, vertices))


def remember(model: StrandModel, before: StrandState, after: StrandState, h: float) -> None:
    """Let `after` know what was `before` the step of h [s] that led to it, but of strands that something pressed."""
    after.earlier_x, after.earlier_velocity, after.earlier_m1 = before.x, before.velocity, before.m1
    after.earlier_spin, after.earlier_twist = before.spin, before.twist
    pressed = np.add.reduceat(after.vertex_contact_force, model.start[:-1]) > 0.0
    after.last_step = np.where(pressed, 0.0, h)


def _column(values: Floats, like: Floats) -> Floats:
    """Values [V] as an array that has as many axes as another."""
    return values.reshape(-1, *(1,) * (like.ndim - 1))
