"""Yarns as the time loop sees them: model, state and stepper of a scene, and what to observe of them."""

import numpy as np
from numpy.typing import NDArray

from engine.run.frames import Components, YarnFrame
from engine.run.statistics import Invariants, kept
from engine.scene.build import build
from engine.scene.schema import Scene
from engine.steppers.step_report import StepReport
from engine.steppers.yarns import YarnStepper
from engine.yarns import observe
from engine.yarns.model import PointKind


class YarnsInMotion:
    """Model, state and stepper of the yarns of a scene."""

    varying: frozenset[str] = frozenset()

    def __init__(self, scene: Scene):
        built = build(scene)
        assert built.yarns is not None and built.state is not None
        self.model, self.state, self.gravity = built.yarns, built.state, np.asarray(built.gravity, float)
        self.stepper = YarnStepper(built.yarns, built.settings, built.gravity, built.obstacles, built.handles, built.collisions)
        self._collisions = 0  # that pressed at the end of the last step
        model = built.yarns
        self.nodes = model.point_count
        contacts = bool(np.any(model.point_nodes[:, 1] >= 0))
        obstacles = len(built.obstacles.kind) > 0
        self.report_keys = {"linear_iterations"} | ({"contact_gap_max"} if contacts else set())
        if np.any(model.point_kind == PointKind.CONTACT):
            self.report_keys |= {"contacts_removed"}
            if built.settings.dynamic_contacts:
                self.report_keys |= {"contacts_added", "addition_gap_max"}
        if obstacles:
            self.report_keys.add("penetration_max")
        unheld = bool(np.all(model.free_directions == np.eye(3))) and not np.any(model.kinematic) and not obstacles
        self._keeps_momentum = unheld and not np.any(model.mass_damping)
        losses = np.any(model.mass_damping) or np.any(model.stretch_damping) or np.any(model.friction)
        moved = np.any(model.handle >= 0) or np.any(model.kinematic)
        self._keeps_energy = not (losses or moved or obstacles)
        self._mass = float(np.sum(model.density * model.length))

    def step(self, time: float, h: float) -> StepReport:
        """Try to advance from `time` by `h` [s]."""
        report = self.stepper.step(self.state, time, h)
        self._collisions = report.collisions
        return report

    def arrays(self) -> dict[str, NDArray]:
        """Return the arrays of the yarn state."""
        return {f"yarns.{name}": values for name, values in vars(self.state).items()}

    def restore(self, arrays: dict[str, NDArray]) -> None:
        """Copy `arrays` into the state."""
        for name, values in vars(self.state).items():
            values[...] = arrays[f"yarns.{name}"]

    def counts(self) -> dict[str, int]:
        """Return nodes by kind, contacts between fabrics that have not been removed, and collisions besides."""
        contacts = np.count_nonzero(self.state.active & (self.model.point_kind == PointKind.CONTACT))
        collisions = {} if self.stepper.collisions is None else {"collisions": self._collisions}
        return observe.counts(self.model, self.state) | {"contacts": int(contacts)} | collisions

    def energies(self) -> dict[str, float]:
        """Return kinetic and potential energy [J]."""
        return observe.energies(self.model, self.state, self.gravity)

    def invariants(self, time: float, energies: dict[str, float]) -> Invariants:
        """Momentum where nothing holds or brakes the yarns, energy where besides nothing dissipates it."""
        momentum = observe.momentum(self.model, self.state) if self._keeps_momentum else None
        return kept(momentum, self._mass * self.gravity * time, self._mass, energies, self._keeps_energy)

    def components(self) -> Components:
        """Return the yarns as they are drawn."""
        return {"yarns": YarnFrame(**observe.yarn_frame_arrays(self.model, self.state))}

    def half_step_errors(self, before: dict[str, NDArray], time: float, h: float) -> dict[str, float] | None:
        """Return the largest differences of positions `x` and Eulerian coordinates `u` [m] to two half steps."""
        halves = self.state.copy()
        for name, values in vars(halves).items():
            values[...] = before[f"yarns.{name}"]
        for start in (time, time + h / 2):
            if not self.stepper.step(halves, start, h / 2).accepted:
                return None
        shared = self.state.active & halves.active
        nodes = shared[self.model.node_point]
        return {
            "x": float(np.max(np.linalg.norm(self.state.x - halves.x, axis=1)[shared], initial=0.0)),
            "u": float(np.max(np.abs(self.state.u - halves.u)[nodes], initial=0.0)),
        }
