"""How solvers of contact converge: what their forces miss of Coulomb's law, over the iterations and seconds that they took."""

from collections.abc import Iterator, Sequence
from time import perf_counter
from typing import NamedTuple

import numpy as np

from engine.arrays import Floats
from engine.bench.contact_sweeps import Delassus, answered, delassus, sweep
from engine.bench.suite import Measurement
from engine.contact.augmented_lagrangian import Answer, Strands, displacements, law_error, solve
from engine.contact.contact_problem import ContactProblem, align


class LinearProblem(NamedTuple):
    """Contacts of strands that answer linearly, as a round of a step has them."""

    strands: Strands
    contact: ContactProblem
    moved: Floats  # what vertices have moved in the step before [m], shape [V, 3]
    force: Floats  # first guess, in space [N], shape [C, 3]


class Judge:
    """Strands that answer to forces exactly, and Coulomb's law: one measure of error for all solvers."""

    def __init__(self, linear: LinearProblem):
        """Keep the problem, with frames and stiffness of contacts as the solver begins with them."""
        self.contact = linear.contact._replace(frame=linear.contact.frame.copy())
        self.stiffness = align(self.contact, linear.strands.band, linear.strands.held)
        self.operator: Delassus = delassus(linear.strands, self.contact, linear.moved)

    def in_frames(self, force: Floats) -> Floats:
        """Return forces in space [C, 3] in the frames of contacts."""
        return np.einsum("cij,cj->ci", self.contact.frame, force)

    def error(self, force: Floats) -> float:
        """Return what `force` [C, 3] [N], in frames, and the displacements under it miss of the law, in distances of touch."""
        w = np.empty_like(force)
        displacements(self.contact, answered(self.contact, self.operator, force), w)
        return float(law_error(self.contact, self.stiffness, w, force)[0])


def convergence(
    name: str, linear: LinearProblem, tolerances: Sequence[float], rounds: Sequence[int], sweeps: Sequence[int]
) -> Iterator[Measurement]:
    """Yield points on the curves of augmented Lagrangians to each of the `tolerances`, and on that of sweeps over contacts.

    Points are after so many `rounds` and `sweeps`; a solver that has come to its tolerance ends earlier.
    """
    judge = Judge(linear)
    for tolerance in tolerances:
        yield from of_rounds(f"{name}, augmented Lagrangians to {tolerance:g}", linear, judge, tolerance, rounds)
    yield from of_sweeps(f"{name}, sweeps over contacts", linear, judge, sweeps)


def of_rounds(
    case: str, linear: LinearProblem, judge: Judge, tolerance: float, rounds: Sequence[int]
) -> Iterator[Measurement]:
    """Yield a row for each number of `rounds`, which ascend, of one solution; its size are iterations of conjugate gradients.

    Solutions begin anew for each row: they are the same up to where the shorter one ends.
    """
    made = 0
    for most in rounds:
        answer, force, seconds = solved(linear, tolerance, most)
        if answer.rounds > made:
            yield Measurement(
                case, answer.linear, seconds, "iterations", error=judge.error(judge.in_frames(force)), converging=True,
                details={"rounds": answer.rounds, "newton": answer.newton, "error_of_its_own": answer.error})
        made = answer.rounds
        if made < most:
            return


def solved(linear: LinearProblem, tolerance: float, rounds: int) -> tuple[Answer, Floats, float]:
    """Return what the engine's solver comes to, the forces in space [C, 3] [N], and the seconds that it took."""
    contact = linear.contact._replace(frame=linear.contact.frame.copy())
    force = linear.force.copy()
    began = perf_counter()
    answer = solve(linear.strands, contact, linear.moved, force, tolerance, rounds)
    seconds = perf_counter() - began
    return answer, np.einsum("cij,ci->cj", contact.frame, force), seconds


def of_sweeps(case: str, linear: LinearProblem, judge: Judge, sweeps: Sequence[int]) -> Iterator[Measurement]:
    """Yield a row for each number of `sweeps`, which ascend; its seconds leave out those that make the Delassus operator."""
    force = judge.in_frames(linear.force)
    moved = answered(judge.contact, judge.operator, force)
    sweep(judge.contact, judge.operator, force.copy(), moved.copy())  # compiles the kernel, untimed
    made, seconds = 0, 0.0
    for wanted in sweeps:
        began = perf_counter()
        for _ in range(wanted - made):
            sweep(judge.contact, judge.operator, force, moved)
        seconds, made = seconds + perf_counter() - began, wanted
        yield Measurement(case, made, seconds, "sweeps", error=judge.error(force), converging=True)
