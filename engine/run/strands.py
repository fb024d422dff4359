"""Strands as the time loop sees them: model, state and stepper of a scene, and what to observe of them."""

import numpy as np
from numpy.typing import NDArray

from engine.contact.obstacles import motion
from engine.contact.surface_roots import follow
from engine.run.frames import Components, StrandFrame
from engine.run.statistics import Invariants, kept
from engine.scene.build import build
from engine.scene.schema import Scene
from engine.steppers.step_report import StepReport
from engine.steppers.strands import StrandStepper
from engine.strands import observe
from engine.strands.handles import given
from engine.strands.loads import StrandLoads
from engine.strands.model import StrandState


class StrandsInMotion:
    """Model, state and stepper of the strands of a scene."""

    varying = frozenset({"strands.contact_key", "strands.contact_force"})

    def __init__(self, scene: Scene):
        built = build(scene)
        assert built.strands is not None and built.strand_state is not None
        model, settings = built.strands, built.strand_settings
        self.model, self.state, self.gravity = model, built.strand_state, np.asarray(built.gravity, float)
        self.stepper = StrandStepper(model, self.gravity, settings)
        self.nodes = len(model.mass)
        self._touch = settings.contact != "none"
        self._handles = built.handles
        self._bodies, self._roots = built.obstacles, built.strand_roots
        self._obstacles = built.obstacles if self._touch and len(built.obstacles.kind) else None
        self._loads = StrandLoads(drag=built.strand_drag)
        self._contacts = 0  # at the end of the last step
        self.report_keys = {"contact_gap_max", "linear_iterations"} if self._touch else set()
        drag = built.strand_drag is not None and bool(np.any(built.strand_drag))
        self._keeps_momentum = not (np.any(model.held) or drag or self._obstacles is not None)
        moved = bool(built.strand_roots) or np.any(model.held[model.handle >= 0])
        self._keeps_energy = not (np.any(model.damping) or drag or moved or self._touch)
        self._mass = float(model.mass.sum())

    def step(self, time: float, h: float) -> StepReport:
        """Try to advance from `time` by `h` [s]."""
        report = self._advance(self.state, time, h)
        if report.accepted:
            self._contacts = report.contacts
        return report

    def arrays(self) -> dict[str, NDArray]:
        """Return the arrays of the strand state."""
        return {f"strands.{name}": values for name, values in vars(self.state).items()}

    def restore(self, arrays: dict[str, NDArray]) -> None:
        """Make a state of `arrays`."""
        self.state = _state_of(arrays)

    def counts(self) -> dict[str, int]:
        """Return vertices, and contacts where strands touch each other and obstacles."""
        return {"strand_vertices": self.nodes} | ({"contacts": self._contacts} if self._touch else {})

    def energies(self) -> dict[str, float]:
        """Return kinetic and potential energy [J]."""
        return observe.energies(self.model, self.state, self.gravity)

    def invariants(self, time: float, energies: dict[str, float]) -> Invariants:
        """Momentum where nothing holds or brakes the strands, energy where nothing but the integrator dissipates it."""
        momentum = observe.momentum(self.model, self.state) if self._keeps_momentum else None
        return kept(momentum, self._mass * self.gravity * time, self._mass, energies, self._keeps_energy)

    def components(self) -> Components:
        """Return the strands as they are drawn."""
        return {"strands": StrandFrame(**observe.strand_frame_arrays(self.model, self.state))}

    def half_step_errors(self, before: dict[str, NDArray], time: float, h: float) -> dict[str, float] | None:
        """Return the largest difference of positions `x` [m] to two half steps."""
        halves = _state_of(before)
        for start in (time, time + h / 2):
            if not self._advance(halves, start, h / 2).accepted:
                return None
        return {"x": float(np.linalg.norm(self.state.x - halves.x, axis=1).max())}

    def _advance(self, state: StrandState, time: float, h: float) -> StepReport:
        obstacles = None if self._obstacles is None else motion(self._obstacles, self._handles, time, h)
        x, turn = given(self.model, state, self._handles, time, h)
        for held in self._roots:
            follow(held, self.model, state, self._bodies, self._handles, time, h, x, turn)
        return self.stepper.step(state, h, self._loads, (x, turn), obstacles)


def _state_of(arrays: dict[str, NDArray]) -> StrandState:
    """Return the state that shares no array with those that `arrays` gives."""
    return StrandState(**{name.removeprefix("strands."): values.copy() for name, values in arrays.items()})
