"""Strands in contact: a bundle over a cylinder, by the number of strands, what precision costs, and how contacts converge."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import isqrt
from statistics import median
from time import perf_counter

import numpy as np

from engine.bench.contact_convergence import LinearProblem, convergence
from engine.bench.strands import GRAVITY, KERATIN, RADIUS
from engine.bench.suite import Measurement, benchmark
from engine.contact.contact_problem import contact_problem
from engine.contact.obstacles import ObstacleKind, Obstacles, motion
from engine.contact.strand_contacts import no_contacts
from engine.geometry.handles import no_handles
from engine.steppers.step_report import StepReport
from engine.steppers.strand_linear import linearised
from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandAssembly
from engine.strands.backward_difference import implicit_euler
from engine.strands.loads import StrandLoads, inertia
from engine.strands.model import StrandModel, StrandState
from engine.strands.settings import StrandSettings

STEP = 1e-3  # [s]
WARM_UP, TIMED = 10, 5  # steps
VERTICES, LENGTH = 41, 0.08  # [m]
CYLINDER = 5e-3  # radius [m]
APART = 1.02  # of strands side by side at the start, in distances of touch
FRICTION = 0.3
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4)
EXACT = 1e-6  # tolerance that shows how rounds converge
ROUNDS, SWEEPS = (1, 2, 3, 4, 6, 8, 10), (1, 3, 10, 30, 100, 300, 1_000)


@benchmark("strand-contacts", summary="a step of 1 ms of a bundle over a cylinder, by strands, tolerance and iterations")
def strand_contacts() -> Iterator[Measurement]:
    """32 to 2,048 strands, four tolerances of contact for 128, and how forces at contacts of 128 and 512 converge."""
    yield from by_size((32, 128, 512, 2_048))
    yield from by_tolerance(128, TOLERANCES)
    for count in (128, 512):
        yield from by_iterations(count, ROUNDS, SWEEPS)


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
    bundle = warm(count)
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


def by_iterations(count: int, rounds: Sequence[int], sweeps: Sequence[int]) -> Iterator[Measurement]:
    """Yield points on the curves of `contact_convergence`, at the default tolerance and at a tight one."""
    tolerances = (StrandSettings.contact_tolerance, EXACT)
    yield from convergence(f"{count} strands", warm(count).linear_problem(), tolerances, rounds, sweeps)


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

    def linear_problem(self) -> LinearProblem:
        """Return what the first round of the next step solves for the forces at contacts."""
        model, state, touching, still = self.model, self.state, self.stepper.touching, np.zeros_like(self.state.x)
        contacts = touching.between_strands(state.x, still, STEP, no_contacts())
        contacts = contacts.and_also(touching.with_solids(state.x, still, STEP, self.obstacles, no_contacts()))
        contacts = contacts.with_forces(state.contact_key, state.contact_force)
        predicted = inertia(model, state, StrandLoads(), GRAVITY, implicit_euler(model, STEP))
        contacts = contacts.those(contacts.may_press(self.stepper.settings.contact_tolerance, still, predicted.target - state.x))
        contact = contact_problem(contacts, touching.strand, np.zeros(len(contacts.edge)), STEP**2 / predicted.mass)
        guess = replace(state, turn=np.zeros_like(state.turn))
        return LinearProblem(linearised(model, predicted, contact.strand, state, guess), contact, still, contacts.force)


def warm(count: int) -> Bundle:
    """Return a bundle of so many strands after steps that warm it up."""
    bundle = Bundle(*laid(count))
    for _ in range(WARM_UP):
        bundle.step()
    return bundle


def laid(count: int) -> tuple[StrandModel, StrandState]:
    """Return so many straight strands along x, a square of them, free at both ends."""
    assembly, side, along = StrandAssembly(), isqrt(count), np.linspace(-0.5, 0.5, VERTICES) * LENGTH
    for k in range(count):
        across, up = (k % side - 0.5 * (side - 1)) * 2 * RADIUS * APART, (k // side) * 2 * RADIUS * APART
        assembly.strand(np.column_stack([along, 0 * along + across, 0 * along + up]), RADIUS, KERATIN, friction=FRICTION)
    return assembly.build()
