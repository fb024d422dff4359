"""What the cases of Eulerian-on-Lagrangian rods share: surroundings, marching in time."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from engine.arrays import Floats
from engine.contact.obstacles import Obstacles
from engine.geometry.handles import Handles, no_handles
from engine.steppers.yarns import YarnStepper
from engine.yarns import observe
from engine.yarns.model import YarnModel, YarnState
from engine.yarns.settings import YarnSettings

EARTH = 9.81  # gravity, along -z [m/s^2]
DOWN = np.array([0.0, 0.0, -EARTH])
WEIGHTLESS = np.zeros(3)


def stepper(model: YarnModel, gravity: Floats, handles: Handles | None = None, **settings: Any) -> YarnStepper:
    """Return a stepper without obstacles; `settings` are those that differ from the defaults."""
    nothing = Obstacles(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(0))
    return YarnStepper(model, YarnSettings(**settings), gravity, nothing, handles or no_handles())


def march(yarns: YarnStepper, state: YarnState, duration: float, h: float) -> Iterator[float]:
    """Advance `state` by steps h [s], yielding the time after each. Raises RuntimeError when a step is rejected."""
    for step in range(round(duration / h)):
        report = yarns.step(state, step * h, h)
        if not report.accepted:
            raise RuntimeError(f"step {step} of {h:.3g} s: {report.reason}, residual {report.residual:.3g}")
        yield (step + 1) * h


def tensions(model: YarnModel, state: YarnState) -> Floats:
    """Return T = k_s (lambda - 1) of the segments of a single yarn, from its first end on [N]."""
    node = observe.chain_now(model, state).node
    length = np.linalg.norm(np.diff(state.x[model.node_point[node]], axis=0), axis=1)
    return model.stretch_stiffness[0] * (length / np.diff(state.u[node]) - 1.0)
