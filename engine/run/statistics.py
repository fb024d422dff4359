"""What the report says about all steps, accumulated step by step and carried through checkpoints."""

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from engine.arrays import Floats

if TYPE_CHECKING:
    from engine.steppers.step_report import StepReport


@dataclass(frozen=True)
class Invariants:
    """Quantities that the exact motion keeps; None where outside forces or losses change them."""

    momentum: Floats | None = None  # linear momentum less the impulse of gravity [kg m/s], shape [3]
    momentum_scale: float = 0.0  # sum of the magnitudes of what adds up to the momentum [kg m/s]
    kinetic_energy: float | None = None  # [J]
    potential_energy: float | None = None  # [J]
    volume: float | None = None  # that liquid takes up, over that of its particles


def kept(momentum: Floats | None, impulse: Floats, mass: float, energies: dict[str, float], energy_kept: bool) -> Invariants:
    """Return what the exact motion keeps of a scene.

    `momentum` [3] [kg m/s] is None where something holds or brakes the scene; else gravity alone changed it, by `impulse` [3].
    `mass` [kg] is that of all that moves, `energies` its "kinetic" and "potential" energy [J], which count where `energy_kept`.
    """
    kinetic, potential = energies["kinetic"], energies["potential"]
    scale = 0.0
    if momentum is not None:
        # a bound of what cancels in the sum, so that a body at rest in total has a scale as well
        scale = float(max(np.linalg.norm(impulse), np.sqrt(2.0 * mass * kinetic)))
    return Invariants(momentum=None if momentum is None else momentum - impulse, momentum_scale=scale,
                      kinetic_energy=kinetic if energy_kept else None, potential_energy=potential if energy_kept else None)


@dataclass
class Statistics:
    """Sums, extremes and per-step values of a run; every field goes into a checkpoint as JSON."""

    seconds: list[float] = field(default_factory=list)  # wall time of each step without compilation
    newton_iterations: list[int] = field(default_factory=list)  # of each accepted step
    linear_iterations: list[int] = field(default_factory=list)  # of each accepted step
    rejected_steps: int = 0
    dt_min: float | None = None  # smallest accepted step [s]
    residual_max: float = 0.0
    contact_gap_max: float = 0.0  # [radii]
    penetration_max: float = 0.0  # [radii]
    contacts_added: int = 0
    contacts_removed: int = 0
    addition_gap_max: float = 0.0  # [radii]
    counts: dict[str, int] = field(default_factory=dict)  # largest of each kind of node
    stages: dict[str, float] = field(default_factory=dict)  # seconds in steps without compilation
    compile_s: float = 0.0
    wall_s: float = 0.0
    momentum_start: list[float] | None = None
    momentum_scale: float = 0.0
    momentum_change: float = 0.0
    energy_start: list[float] | None = None  # kinetic, potential [J]
    energy_scale: float = 0.0
    energy_change: float = 0.0
    volume_start: float | None = None
    volume_change: float = 0.0
    step_errors: dict[str, list[float]] = field(default_factory=dict)  # of the sampled steps, by field
    failed_samples: int = 0  # sampled steps one of whose halves was rejected

    def accepted(self, h: float, report: "StepReport", seconds: float, compiled: bool) -> None:
        """Add an accepted step of `h` [s] with its StepReport, that took `seconds` of wall time.

        A step in which kernels were compiled says nothing about speed: it is left out of the timings.
        """
        if not compiled:
            self.seconds.append(seconds)
            for name, spent in report.stages.items():
                self.stages[name] = self.stages.get(name, 0.0) + spent
        self.newton_iterations.append(int(report.newton_iterations))
        self.linear_iterations.append(int(report.linear_iterations))
        self.dt_min = h if self.dt_min is None else min(self.dt_min, h)
        self.residual_max = max(self.residual_max, float(report.residual))
        self.contact_gap_max = max(self.contact_gap_max, float(report.contact_gap))
        self.penetration_max = max(self.penetration_max, float(report.penetration))
        self.contacts_added += report.added
        self.contacts_removed += report.removed
        self.addition_gap_max = max(self.addition_gap_max, float(report.addition_gap))

    def counted(self, counts: dict[str, int]) -> None:
        """Add the node counts after a step."""
        for name, count in counts.items():
            self.counts[name] = max(self.counts.get(name, 0), int(count))

    def observed(self, invariants: Invariants) -> None:
        """Add invariants; the first ones are what the others are compared with."""
        if invariants.momentum is not None:
            if self.momentum_start is None:
                self.momentum_start = invariants.momentum.tolist()
            change = float(np.linalg.norm(invariants.momentum - self.momentum_start))
            self.momentum_change = max(self.momentum_change, change)
            self.momentum_scale = max(self.momentum_scale, invariants.momentum_scale)
        if invariants.kinetic_energy is not None and invariants.potential_energy is not None:
            kinetic, potential = invariants.kinetic_energy, invariants.potential_energy
            if self.energy_start is None:
                self.energy_start = [kinetic, potential]
            potential_change = potential - self.energy_start[1]
            self.energy_change = max(self.energy_change, abs(kinetic - self.energy_start[0] + potential_change))
            # potential energy has no zero of its own: what was exchanged is the scale of what was lost
            self.energy_scale = max(self.energy_scale, kinetic, abs(potential_change))

        if invariants.volume is not None:
            if self.volume_start is None:
                self.volume_start = invariants.volume
            self.volume_change = max(self.volume_change, abs(invariants.volume / self.volume_start - 1.0))

    def sampled(self, errors: dict[str, float] | None) -> None:
        """Add the estimated errors of a sampled step by field, None where its halves were rejected."""
        if errors is None:
            self.failed_samples += 1
            return
        for name, error in errors.items():
            self.step_errors.setdefault(name, []).append(error)

    def to_dict(self) -> dict:
        """Return all fields in a form that JSON holds without loss."""
        return asdict(self)
