"""Scenes stepped for validation: the adaptive time loop of a run, without its output."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from engine.arrays import Floats
from engine.run.adaptivity import StepLimits, after_accepted, after_rejected, first_size, plan
from engine.run.threads import threads_for
from engine.scene.build import build
from engine.scene.load import load_scene
from engine.steppers.step_report import StepReport
from engine.steppers.yarns import YarnStepper
from engine.yarns.model import YarnModel, YarnState

ROUND_OFF = 1e-9  # of a step: what is left of the time is no step


@dataclass(frozen=True)
class Attempt:
    """One call of the stepper."""

    time: float  # of the state after it [s]
    h: float  # the step that was tried [s]
    report: StepReport


class March:
    """A scene on its way; `state` is that of the last accepted step."""

    def __init__(self, scene: dict[str, Any]):
        loaded = load_scene(scene)
        built = build(loaded)
        assert built.yarns is not None and built.state is not None
        self.model: YarnModel = built.yarns
        self.state: YarnState = built.state
        self.built = built
        self.limits = StepLimits(loaded.step.default, loaded.step.min, loaded.step.max)
        self.time = 0.0
        self.size = first_size(self.limits)
        self.pull(built.gravity)

    def pull(self, gravity: Floats, **settings: Any) -> None:
        """Go on under another gravity [3], with other settings where given."""
        self.stepper = YarnStepper(self.model, replace(self.built.settings, **settings), np.asarray(gravity, float),
                                   self.built.obstacles, self.built.handles, self.built.collisions)

    def attempts(self, until: float) -> Iterator[Attempt]:
        """Step to `until` [s] and yield every attempt, rejected ones too; raises StepTooSmall as a run would."""
        while until - self.time > ROUND_OFF * self.limits.default:
            h = plan(self.size.dt, until - self.time)
            with threads_for(self.model.node_count):
                report = self.stepper.step(self.state, self.time, h)
            if report.accepted:
                self.time += h
                self.size = after_accepted(self.size, self.limits)
            yield Attempt(self.time, h, report)
            if not report.accepted:
                self.size = after_rejected(h, self.limits)

    def reach(self, until: float) -> None:
        """Step to `until` [s]."""
        for _ in self.attempts(until):
            pass

    @property
    def free_mass(self) -> float:
        """Mass of all yarns whose shape is not given [kg]."""
        m = self.model
        return float(np.sum((m.density * m.length)[~m.kinematic]))
