"""A liquid as the time loop sees it: model, state and stepper of a scene, sources and sinks, and what to observe of it."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.contact.obstacles import motion
from engine.geometry.solids import Solids, clear_of
from engine.liquid import observe
from engine.liquid.evolve import wrap
from engine.liquid.model import LiquidState
from engine.liquid.resampling import LARGE, SMALL, merge, relax, split
from engine.liquid.sinks import leaving
from engine.liquid.sources import emitted
from engine.run.frames import Components, LiquidFrame
from engine.run.statistics import Invariants
from engine.scene.build import build, estimate
from engine.scene.schema import Scene
from engine.steppers.liquid import LiquidStepper
from engine.steppers.step_report import StepReport

ALIKE = {"emitted", "drained"}  # arrays of the state that are not of particles


class LiquidInMotion:
    """Model, state and stepper of the liquid of a scene."""

    def __init__(self, scene: Scene):
        assert scene.liquid is not None
        built = build(scene)
        assert built.liquid is not None and built.liquid_state is not None
        assert built.sources is not None and built.sinks is not None
        self.model, self.state, self.gravity = built.liquid, built.liquid_state, np.asarray(built.gravity, float)
        self.stepper = LiquidStepper(self.model, self.gravity, built.liquid_settings)
        self._sampler = LiquidStepper(self.model, self.gravity, replace(built.liquid_settings, spread=0.0))
        self.nodes = estimate(scene).particles
        self.report_keys = {"linear_iterations"}
        self.varying = frozenset(f"liquid.{name}" for name, values in vars(self.state).items()
                                 if values is not None and name not in ALIKE)
        self._obstacles, self._handles = built.liquid_obstacles, built.handles
        self._sources, self._sinks = built.sources, built.sinks
        self._fine_volume = scene.liquid.spacing**3 / scene.liquid.particles_per_cell
        self._surface = scene.output.surface
        self._default = scene.step.default

    def step(self, time: float, h: float) -> StepReport:
        """Try to advance from `time` by `h` [s]."""
        return self._advance(self.stepper, self.state, time, h)[0]

    def arrays(self) -> dict[str, NDArray]:
        """Return the arrays of the liquid's state."""
        return {f"liquid.{name}": values for name, values in vars(self.state).items() if values is not None}

    def restore(self, arrays: dict[str, NDArray]) -> None:
        """Make a state of `arrays`."""
        self.state = _state_of(arrays)

    def counts(self) -> dict[str, int]:
        """Return particles, and cells of the grid of the last step."""
        flow = self.stepper.flow
        return {"particles": len(self.state.x), "grid_cells": 0 if flow is None else flow.filled.size}

    def energies(self) -> dict[str, float]:
        """Return kinetic and potential energy [J]."""
        return observe.energies(self.model, self.state, self.gravity)

    def invariants(self, time: float, energies: dict[str, float]) -> Invariants:
        """The volume that the liquid takes up over that of its particles."""
        if not len(self.state.x):
            return Invariants()
        moved = motion(self._obstacles, self._handles, time, self._default)
        taken_up = self.stepper.volume(self.state, moved.begin, moved.begin)
        return Invariants(volume=taken_up / float(observe.present_volume(self.state).sum()))

    def components(self) -> Components:
        """Return the liquid as it is drawn."""
        state, pressure = self.state, self.stepper.particle_pressure
        if len(pressure) != len(state.x):  # before the first step, and of what has come since
            pressure = np.concatenate([pressure, np.zeros(len(state.x), np.float32)])[: len(state.x)]
        arrays = observe.frame_arrays(self.model, state, pressure)
        if self._surface:
            from engine.liquid.surface_mesh import surface

            arrays["surface_vertices"], arrays["surface_faces"] = surface(state.x, observe.present_volume(state))
        return {"liquid": LiquidFrame(**arrays)}

    def half_step_errors(self, before: dict[str, NDArray], time: float, h: float) -> dict[str, float] | None:
        """Return the largest difference of places `x` [m] to two half steps, of particles that all have.

        Without what spreads particles, which every step does as much, whatever its size.
        """
        whole, order = _state_of(before), np.arange(len(before["liquid.x"]))
        _, whole_order = self._advance(self._sampler, whole, time, h)
        halves = _state_of(before)
        for start in (time, time + h / 2):
            report, found = self._advance(self._sampler, halves, start, h / 2)
            if not report.accepted:
                return None
            order = np.where(found >= 0, np.append(order, -1)[found], -1)
        places = np.full((2, len(before["liquid.x"]), 3), np.nan)
        for which, (state, numbers) in enumerate(((whole, whole_order), (halves, order))):
            places[which, numbers[numbers >= 0]] = state.x[numbers >= 0]
        difference = np.linalg.norm(places[0] - places[1], axis=1)
        both = np.isfinite(difference)
        if len(both) and not both.any():  # all were made anew
            return None
        return {"x": float(difference[both].max(initial=0.0))}

    def _advance(self, stepper: LiquidStepper, state: LiquidState, time: float, h: float) -> tuple[StepReport, NDArray]:
        """Take a step of `state`; returns which of its particles each was before, -1 for new ones, as well."""
        solids = motion(self._obstacles, self._handles, time, h)
        report = stepper.step(state, h, solids.begin, solids.end)
        order = stepper.order
        if report.accepted:
            order = self._exchange(stepper, state, time, h, solids.end)
        return report, order

    def _exchange(self, stepper: LiquidStepper, state: LiquidState, time: float, h: float, solids: Solids) -> NDArray:
        """Let liquid in and out at the end of a step, and keep particles of about one size; returns their order [P]."""
        order = stepper.order
        gone = leaving(self._sinks, self.model, state.x)
        if gone.any():
            state.drained = state.drained + state.volume[gone].sum()
            _take(state, ~gone)
            order = order[~gone]
            stepper.particle_pressure = stepper.particle_pressure[~gone]
        if len(state.emitted):
            came = emitted(self._sources, state.emitted, self._handles, time, h)
            state.emitted = came.layers
            if len(came.x):
                wrap(came.x, self.model.origin, self.model.spacing * self.model.period)
                _append(state, came.x, came.velocity, came.volume)
                order = np.concatenate([order, np.full(len(came.x), -1)])
        volume, fine = state.volume, self._fine_volume
        if len(volume) and (volume.min() < SMALL * fine or volume.max() > LARGE * fine):

            def clear(x: NDArray) -> NDArray:
                return clear_of(solids, x, self.model.spacing)

            sized = split(self.model, merge(self.model, state, fine, clear), fine, clear)
            if sized is not state:
                sized = relax(self.model, sized, clear)
                vars(state).update(vars(sized))
                order = np.full(len(state.x), -1)
                stepper.particle_pressure = np.zeros(len(order), np.float32)
        return order


def _take(state: LiquidState, which: NDArray) -> None:
    """Leave only some particles of a state."""
    for name, values in vars(state).items():
        if values is not None and name not in ALIKE:
            setattr(state, name, values[which])


def _append(state: LiquidState, x: NDArray, velocity: NDArray, volume: NDArray) -> None:
    """Add particles at rest in themselves."""
    count = len(x)
    new = {
        "x": x, "velocity": velocity, "volume": volume, "affine": np.zeros((count, 3, 3)),
        "strain": np.tile([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], (count, 1)), "compression": np.ones(count),
        "plastic_strain": np.zeros(count),
    }
    for name, values in new.items():
        old = getattr(state, name)
        if old is not None:
            setattr(state, name, np.concatenate([old, values]))


def _state_of(arrays: dict[str, NDArray]) -> LiquidState:
    """Return the state that shares no array with those that `arrays` gives."""
    held: dict[str, Any] = dict.fromkeys(LiquidState.__dataclass_fields__)
    return LiquidState(**held | {name.removeprefix("liquid."): values.copy() for name, values in arrays.items()})
