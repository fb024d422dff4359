"""How long the next step is: a controller without side effects, whose whole memory is a `StepSize`.

The step is halved when one is rejected and doubles again after a number of accepted ones. Frames are hit exactly: the
step is shortened before them, and that shortening is forgotten afterwards.
"""

from dataclasses import dataclass

CALM = 8  # accepted steps in a row after which a reduced step doubles
ROUND_OFF = 1e-9  # a remainder this close to a whole step, relative to it, is one step


class StepTooSmall(Exception):
    """The step would have to be smaller than the scene allows."""


@dataclass(frozen=True)
class StepLimits:
    """The scene's bounds on the step [s]."""

    default: float
    min: float
    max: float


@dataclass(frozen=True)
class StepSize:
    """The size that steps have at present."""

    dt: float  # [s]
    calm: int = 0  # accepted steps since the size changed


def first_size(limits: StepLimits) -> StepSize:
    """Return the size that a run starts with."""
    return StepSize(min(limits.default, limits.max))


def plan(dt: float, remaining: float) -> float:
    """Return the step to take [s] when `remaining` [s] are left until a time that must be hit.

    A result equal to `remaining` hits it. What is left of one to two steps is shared by two equal ones: a sliver would
    cost a step and buy nothing.
    """
    if remaining <= dt * (1 + ROUND_OFF):
        return remaining
    if remaining < 2 * dt * (1 - ROUND_OFF):
        return remaining / 2
    return dt


def after_accepted(size: StepSize, limits: StepLimits) -> StepSize:
    """Return the size after an accepted step."""
    if size.calm + 1 < CALM or size.dt >= limits.max:
        return StepSize(size.dt, min(size.calm + 1, CALM))
    return StepSize(min(2 * size.dt, limits.max))


def after_rejected(taken: float, limits: StepLimits) -> StepSize:
    """Return the size after a step of `taken` [s] was rejected; raises StepTooSmall below the scene's minimum."""
    if taken / 2 < limits.min:
        raise StepTooSmall(f"a step of {taken:.3g} s was rejected and the scene allows none below {limits.min:.3g} s")
    return StepSize(taken / 2)
