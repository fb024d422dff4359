"""What a step tells about itself."""

import time
from dataclasses import dataclass, field

import numpy as np


@dataclass
class StepReport:
    """What happened in one step."""

    accepted: bool = False
    reason: str = ""
    newton_iterations: int = 0
    linear_iterations: int = 0
    residual: float = np.inf  # largest force that is left over, in units of the step's force scale
    contact_gap: float = 0.0  # largest gap of an EIL contact, in yarn radii; of strands, overlap over the distance of touch
    contacts: int = 0  # of strands that press on each other or on solids
    penetration: float = 0.0  # deepest centre line inside an obstacle, in yarn radii
    collisions: int = 0  # pairs of spheres of a yarn or two that press on each other
    removed: int = 0  # contacts removed at the end of the step
    added: int = 0  # contacts between fabrics that begin at the end of the step
    addition_gap: float = 0.0  # the widest gap with which one of them begins, in yarn radii
    stages: dict[str, float] = field(default_factory=dict)  # seconds


class Stopwatch:
    """Adds up the seconds spent in named stages."""

    def __init__(self) -> None:
        """Start the first lap."""
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        """Count the time since the last lap towards `stage`."""
        now = time.perf_counter()
        self.laps[stage] = self.laps.get(stage, 0.0) + now - self._last
        self._last = now
