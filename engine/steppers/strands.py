"""One implicit step of discrete elastic rods in contact (Fei 2019, sec. 14.1 and algorithm 2).

Contact forces are found by augmented Lagrangians under strands that answer as their Hessians say; then strands by Newton
iterations of their own, to each of which its contacts are linear springs; in turn, until neither moves anything any more. What a
step ends with is implicit in elasticity, friction and contact alike. (The paper predicts strands without contact first.)
The step is one of implicit Euler, or of BDF2 where strands touch nothing (`engine.strands.backward_difference`).
"""

from dataclasses import replace

import numpy as np

from engine.arrays import Flags, Floats
from engine.contact.augmented_lagrangian import solve
from engine.contact.contact_problem import contact_problem, springs_of
from engine.contact.edge_meetings import CROSSING, length_beside
from engine.contact.obstacles import ObstacleMotion
from engine.contact.strand_contacts import Contacts, Touching, no_contacts
from engine.steppers.step_report import StepReport, Stopwatch
from engine.steppers.strand_linear import linearised
from engine.steppers.strand_newton import advance
from engine.strands.backward_difference import BackwardDifference, bdf2, implicit_euler, remember
from engine.strands.loads import Inertia, StrandLoads, inertia
from engine.strands.model import StrandModel, StrandState
from engine.strands.settings import StrandSettings
from engine.strands.springs import Springs, no_springs

INEXACT = 0.05  # of what strands move by in a round, that contacts may leave to the next: so far they do not answer linearly
AGREE = 0.1  # of the tolerance of contact, by which rounds that get nearer to each other may still move strands
SLOW = 0.5  # share of what the round before moved, above which later rounds do not get nearer any more
FOLLOW = 5  # rounds in which contacts follow the places that touch; later ones are added, lest two take turns for ever


class StrandStepper:
    """Advances strands, one step at a time."""

    def __init__(self, model: StrandModel, gravity: Floats, settings: StrandSettings | None = None):
        """Keep what does not change between steps; `gravity` [3] in m/s^2."""
        self.model, self.settings = model, settings or StrandSettings()
        self.gravity = np.asarray(gravity, np.float64)
        self.iterations = np.zeros(len(model.start) - 1, np.int64)  # of every strand in the last step
        self.contacts = no_contacts()  # of the last step
        self.touching = Touching(model, self.settings.cohesion_reach)

    def step(
        self, state: StrandState, h: float, loads: StrandLoads | None = None, given: tuple[Floats, Floats] | None = None,
        obstacles: ObstacleMotion | None = None,
    ) -> StepReport:
        """Advance `state` by `h` [s]; a rejected step leaves it as it was.

        `given` are the places [V, 3] [m] at which held vertices end, and the angles [V] [rad] by which held edges turn about
        themselves beyond what being carried along does; without it they stay. `obstacles` are how solids move in the step.
        """
        report, watch, settings = StepReport(), Stopwatch(), self.settings
        after = self._first_guess(state, given)
        if settings.contact != "none":
            self.touching.near.look_ahead(state.x, h * state.velocity)
        contacts = self._near(state, np.zeros_like(state.x), h, obstacles, no_contacts())
        contacts = contacts.with_forces(state.contact_key, state.contact_force)
        difference, predicted = self._predict(state, contacts, loads, h)
        which = np.ones(len(self.iterations), np.bool_)
        self.iterations[:] = 0
        springs, met, last, squeezed = no_springs(len(which)), contacts, np.inf, False
        watch.lap("predict")
        for number in range(settings.max_rounds):
            if len(contacts.edge):
                acts = contacts.may_press(settings.contact_tolerance, after.x - state.x, predicted.target - state.x)
                acts |= settings.cohesion > 0.0
                pressing = contacts.those(acts)
                problem = contact_problem(pressing, self.touching.strand, self._pull(pressing, state.x), h * h / predicted.mass)
                strands = linearised(self.model, predicted, problem.strand, state, after)
                force = pressing.force.copy()
                answer = solve(strands, problem, after.x - state.x, force, settings.contact_tolerance,
                               settings.max_contact_rounds, self._penalty(pressing), INEXACT)
                pressing = pressing._replace(force=np.einsum("cij,ci->cj", problem.frame, force))
                if answer.stuck.any():  # what is squeezed in a wedge cannot part from both of its sides
                    squeezed, pressing = True, pressing.unmended(answer.stuck)
                contacts = contacts.with_those(acts, pressing)
                report.linear_iterations += answer.linear
                moves = np.abs(answer.step[:, :3]).max() / contacts.touch.min()
                watch.lap("contact")
                near = max(moves, answer.error) <= settings.contact_tolerance
                slow = number >= FOLLOW and moves > SLOW * last
                if not len(met.edge) and near and (moves <= AGREE * settings.contact_tolerance or slow):
                    break
                last = moves
                springs = springs_of(pressing, problem, force, answer.slope, after.x + answer.step[:, :3], self.touching.strand)
            if not self._solve_strands(predicted, springs, which, state, after, report):
                return report
            watch.lap("strands")
            met = self._near(state, after.x - state.x, h, obstacles, contacts)
            watch.lap("detect")
            if squeezed:
                met = met.unmended(np.ones(len(met.edge), np.bool_))
            contacts = contacts.renewed(met) if number < FOLLOW else contacts.and_also(met)
            if not len(contacts.edge):
                break
            difference, predicted = self._predict(state, contacts, loads, h)
            which = self.touching.strands_of(contacts)
        else:
            report.reason = "strands and contacts did not agree"
            return report
        self._commit(state, after, contacts, difference, report)
        report.stages = watch.laps
        return report

    def _predict(
        self, state: StrandState, contacts: Contacts, loads: StrandLoads | None, h: float
    ) -> tuple[BackwardDifference, Inertia]:
        """The difference that a step takes, and where inertia and loads take strands; those with contacts by implicit Euler."""
        if self.settings.integrator == "bdf2":
            difference = bdf2(self.model, state, h, self.touching.strands_of(contacts))
        else:
            difference = implicit_euler(self.model, h)
        return difference, inertia(self.model, state, loads or StrandLoads(), self.gravity, difference)

    def _first_guess(self, state: StrandState, given: tuple[Floats, Floats] | None) -> StrandState:
        """Everything where it was, but what is given where that ends; what a step does not write is shared with `state`."""
        held, (x, turn) = self.model.held, given or (state.x, np.zeros_like(state.turn))
        return replace(state, x=np.where(held[:, :3], x, state.x), turn=np.where(held[:, 3], turn, 0.0), m1=state.m1.copy(),
                       twist=state.twist.copy())

    def _near(self, state: StrandState, moved: Floats, h: float, obstacles: ObstacleMotion | None, known: Contacts) -> Contacts:
        """Contacts beside those known when vertices move so [V, 3] [m]; penalties only know what is near at the start."""
        if self.settings.contact == "none" or (self.settings.contact == "penalty" and moved.any()):
            return no_contacts()
        found = self.touching.between_strands(state.x, moved, h, known)
        if obstacles is not None and len(obstacles.friction):
            found = found.and_also(self.touching.with_solids(state.x, moved, h, obstacles, known))
        return found if self.settings.contact == "cone" else found._replace(friction=np.zeros(len(found.edge)))

    def _solve_strands(
        self, predicted: Inertia, springs: Springs, which: Flags, before: StrandState, after: StrandState,
        report: StepReport,
    ) -> bool:
        """Solve the strands `which` [S] from what `after` holds; False where one does not converge."""
        settings = self.settings
        converged, residual = np.ones(len(which), np.bool_), np.zeros(len(which))
        advance(self.model, predicted, springs, which, before.x, before.m1, before.twist, settings.tolerance, settings.max_newton,
                after.x, after.m1, after.turn, after.twist, converged, self.iterations, residual)
        report.newton_iterations = int(self.iterations.max(initial=0))
        report.residual = float(residual.max(initial=0.0))
        if not converged.all():
            most = report.newton_iterations >= settings.max_newton
            report.reason = "Newton did not converge" if most else "the line search found no descent"
        return bool(converged.all())

    def _penalty(self, contacts: Contacts) -> Floats | None:
        """Stiffness of contacts where they are no more than springs [N/m], shape [C]: in proportion to the softer side's own."""
        if self.settings.contact != "penalty":
            return None
        edge = np.where(contacts.edge[:, 1:] < 0, contacts.edge[:, :1], contacts.edge)
        return self.settings.penalty_factor * self.model.stretch_stiffness[edge].min(axis=1)

    def _pull(self, contacts: Contacts, x: Floats) -> Floats:
        """What cohesion holds each contact with [N], [C]: over the length that edges lie side by side, or their thickness."""
        pull = np.zeros(len(contacts.edge))
        if self.settings.cohesion > 0.0:
            strands = contacts.edge[:, 1] >= 0
            edge = contacts.edge[strands]
            length = length_beside(x, edge)
            along = (x[edge + 1] - x[edge]) / np.linalg.norm(x[edge + 1] - x[edge], axis=2)[:, :, None]
            cross = np.abs(np.einsum("ck,ck->c", along[:, 0], along[:, 1])) < CROSSING
            length[cross] = np.maximum(length, contacts.touch[strands])[cross]
            pull[strands] = self.settings.cohesion * length
        return pull

    def _commit(
        self, state: StrandState, after: StrandState, contacts: Contacts, difference: BackwardDifference, report: StepReport,
    ) -> None:
        """Take over what a step has come to."""
        after.velocity = difference.rate(after.x, state.x, state.earlier_x)
        after.spin = difference.rate(after.turn, np.zeros_like(state.turn), -state.turn)
        after.contact_key, after.contact_force = contacts.pressing()
        size = np.linalg.norm(contacts.force, axis=1)
        after.vertex_contact_force = contacts.on_vertices(size[:, None], len(after.x), second=1.0)[:, 0]
        if self.settings.integrator == "bdf2":
            remember(self.model, state, after, difference.h)
        report.contact_gap = contacts.overlap(after.x, after.x - state.x)
        report.contacts = int(np.count_nonzero(size))
        self.contacts = contacts
        vars(state).update(vars(after))
        report.accepted = True

