"""Strands in contact: a bundle that lies over a cylinder, by the number of strands, and what precision costs."""

from collections.abc import Iterator, Sequence
from math import isqrt
from statistics import median
from time import perf_counter

import numpy as np

from engine.bench.strands import GRAVITY, KERATIN, RADIUS
from engine.bench.suite import Measurement, benchmark
from engine.contact.obstacles import ObstacleKind, Obstacles, motion
from engine.geometry.handles import no_handles
from engine.steppers.step_report import StepReport
from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandAssembly
from engine.strands.model import StrandModel, StrandState
from engine.strands.settings import StrandSettings

STEP = 1e-3  # [s]
WARM_UP, TIMED = 10, 5  # steps
VERTICES, LENGTH = 41, 0.08  # [m]
CYLINDER = 5e-3  # radius [m]
APART = 1.02  # of strands side by side at the start, in distances of touch
FRICTION = 0.3
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4)


@benchmark("strand-contacts", summary="a step of 1 ms of a bundle over a cylinder, by strands and by tolerance of contact")
def strand_contacts() -> Iterator[Measurement]:
    """32 to 2,048 strands, and four tolerances of contact for 128."""
    yield from by_size((32, 128, 512, 2_048))
    yield from by_tolerance(128, TOLERANCES)


def by_size(counts: Sequence[int]) -> Iterator[Measurement]:
    """Yield a row for every number of strands: the median time of a step, and the contacts that press in it."""
    for count in counts:
        bundle = Bundle(*laid(count))
        seconds, reports = [], []
        for _ in range(WARM_UP + TIMED):
            began = perf_counter()
            reports.append(bundle.step())
            seconds.append(perf_counter() - began)
        timed = reports[WARM_UP:]
        contacts = sum(report.contacts for report in timed)
        yield Measurement(
            "bundle over a cylinder", count, median(seconds[WARM_UP:]), "strands",
            error=max(report.contact_gap for report in timed),
            details={"contacts": contacts / TIMED, "contacts_per_s": contacts / sum(seconds[WARM_UP:]),
                     "linear_iterations": sum(report.linear_iterations for report in timed) / TIMED},
        )


def by_tolerance(count: int, tolerances: Sequence[float]) -> Iterator[Measurement]:
    """Yield a row for every tolerance of the same step; its error is how far off the most exact one vertices end, in touches."""
    bundle = Bundle(*laid(count))
    for _ in range(WARM_UP):
        bundle.step()
    ends, seconds, iterations = [], [], []
    for tolerance in tolerances:
        copy = Bundle(bundle.model, bundle.state.copy(), tolerance)
        began = perf_counter()
        report = copy.step()
        seconds.append(perf_counter() - began)
        ends.append(copy.state.x)
        iterations.append(report.linear_iterations)
    for end, tolerance, spent, made in zip(ends[:-1], tolerances[:-1], seconds[:-1], iterations[:-1], strict=True):
        error = float(np.linalg.norm(end - ends[-1], axis=1).max() / (2 * RADIUS))
        yield Measurement(f"tolerance {tolerance:g}", count, spent, "strands", error=error, details={"linear_iterations": made})


class Bundle:
    """Strands side by side and on each other, over a fixed cylinder."""

    def __init__(self, model: StrandModel, state: StrandState, tolerance: float = StrandSettings.contact_tolerance):
        """Take strands of `laid`; `tolerance` is that of contact."""
        self.model, self.state = model, state
        self.stepper = StrandStepper(model, GRAVITY, StrandSettings(contact_tolerance=tolerance))
        centre = np.array([[0.0, 0.0, -CYLINDER - RADIUS * APART]])
        lying = np.array([[[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]])
        kind, size = np.array([ObstacleKind.CYLINDER]), np.array([[CYLINDER, 1.0, 0.0]])
        solid = Obstacles(kind, centre, lying, size, np.array([FRICTION]))
        self.obstacles = motion(solid, no_handles(), 0.0, STEP)

    def step(self) -> StepReport:
        """Advance; raises RuntimeError where the step is rejected."""
        report = self.stepper.step(self.state, STEP, obstacles=self.obstacles)
        if not report.accepted:
            raise RuntimeError(f"a step was rejected: {report.reason}")
        return report


def laid(count: int) -> tuple[StrandModel, StrandState]:
    """Return so many straight strands along x, a square of them, free at both ends."""
    assembly, side, along = StrandAssembly(), isqrt(count), np.linspace(-0.5, 0.5, VERTICES) * LENGTH
    for k in range(count):
        across, up = (k % side - 0.5 * (side - 1)) * 2 * RADIUS * APART, (k // side) * 2 * RADIUS * APART
        assembly.strand(np.column_stack([along, 0 * along + across, 0 * along + up]), RADIUS, KERATIN, friction=FRICTION)
    return assembly.build()
