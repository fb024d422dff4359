"""One implicit Euler step of Eulerian-on-Lagrangian rods with EoL and EIL nodes (Sánchez-Banderas 2020, sec. 4)."""

import numpy as np
from numba import njit

from engine.arrays import Flags, Floats, Ints
from engine.contact import obstacles as obstacle_contact
from engine.contact.collisions import pressing
from engine.contact.obstacles import Obstacles, motion
from engine.contact.sphere_packing import Collisions, collision_pairs
from engine.geometry.handles import Handles
from engine.steppers.incremental_potential import IncrementalPotential
from engine.steppers.line_search import longest_update
from engine.steppers.newton import newton
from engine.steppers.newton_system import NewtonSystem
from engine.steppers.step_report import StepReport, Stopwatch
from engine.yarns import addition, contact, friction, friction_circle, inertia, normal_force, transition
from engine.yarns.model import PointKind, YarnModel, YarnState
from engine.yarns.removal import parted, remove
from engine.yarns.settings import YarnSettings
from engine.yarns.topology import Chain, assign, chain_of

WORTHWHILE = 1e5  # times the tolerance: from this residual on, multipliers are worth an update
# pulls that count: an F_n that may lack less is not worth more iterations, since only a pull that lasts ends a contact
ENOUGH = 10.0
MEETING = 0.05  # of the safety distance: EoL nodes that come nearer than that within a step would have met


class YarnStepper:
    """Advances the yarns of a scene, one step at a time."""

    def __init__(
        self, model: YarnModel, settings: YarnSettings, gravity: Floats, obstacles: Obstacles, handles: Handles,
        collisions: Collisions | None = None,
    ):
        """Keep what does not change between steps; `gravity` [3] in m/s^2. Without `collisions` yarns meet at points only."""
        self.model, self.settings, self.obstacles, self.handles = model, settings, obstacles, handles
        self.collisions = collisions
        self.gravity = np.asarray(gravity, np.float64)
        self.weight = float(np.max(model.density * model.rest_segment, initial=0.0) * np.linalg.norm(self.gravity))
        self.radius = model.radius[model.node_yarn[model.point_nodes[:, 0]]]
        self.least_radius = float(model.radius.min())
        self.meeting_distance = MEETING * settings.safety_distance * model.rest_segment[model.node_yarn]

    def step(self, state: YarnState, time: float, h: float) -> StepReport:
        """Advance `state` from `time` by `h` [s]; a rejected step leaves it as it was.

        Beyond the paper, where EoL nodes turn out to meet whose last rates did not say so, it begins anew with one of them EIL.
        """
        report, watch = StepReport(), Stopwatch()
        rates = self.attempt(state, time, h, state.u_rate, report, watch, last=not self.settings.eil)
        if rates is not None:
            self.attempt(state, time, h, rates, report, watch, last=True)
        report.stages = watch.laps
        return report

    def attempt(
        self, state: YarnState, time: float, h: float, rates: Floats, report: StepReport, watch: Stopwatch, last: bool = False
    ) -> Floats | None:
        """Try a step in which u is expected to change at `rates` [N] [m/s].

        Returns None when it is done or rejected, as the report says; unless it is the `last`, other rates to expect where
        EoL nodes are about to meet. The iterations of a step's attempts add up, also towards the most there may be.
        """
        start = state.copy()
        chain = self.assign_nodes(start, h, rates)
        obstacles = motion(self.obstacles, self.handles, time, h)
        watch.lap("assign")
        colliding = None
        if self.collisions is not None:
            colliding = collision_pairs(self.collisions, self.model, start, chain, h)
            watch.lap("detect")
        potential = IncrementalPotential(self.model, self.settings, self.gravity, obstacles, start, chain, h, colliding)
        system = NewtonSystem(potential, self.settings, watch)
        watch.lap("assign")

        x, u, energy, gradient = self.first_guess(start, potential, time, h)
        watch.lap("assemble")
        lacked = np.full(self.model.point_count, np.inf)
        while True:
            scale = self.measure(report, potential, gradient, x, u)
            closed = report.contact_gap <= self.settings.gap_tolerance
            settled = closed and report.residual <= self.settings.tolerance
            ended = report.newton_iterations == self.settings.max_newton
            if settled and (ended or not self.in_doubt(potential, x, u, scale, lacked).any()):
                break
            if (settled or not closed) and report.residual <= WORTHWHILE * self.settings.tolerance:
                if potential.update_multipliers(self.settings.gap_tolerance * self.least_radius):
                    system.forget_factor()
                energy, gradient = potential.gradient(x, u)
            if ended:
                report.reason = "Newton did not converge"
                return None
            found, iterations = newton(potential, system, (x, u, energy, gradient), self.settings.tolerance * scale)
            report.linear_iterations += iterations
            if found is None:
                report.reason = "the line search found no descent"
                return None
            x, u, energy, gradient = found
            report.newton_iterations += 1
            if not last and meets_neighbour(chain.node, chain.after, self.meeting_distance, start.u, u):
                return (u - start.u) / h
        if not np.isfinite(energy):
            report.reason = "the energy is not finite"
            return None
        if passes_neighbours(chain.before, chain.after, start.eil, start.order, self.model.node_point, start.active, u):
            report.reason = "a node passed more than one neighbour"
            return None
        if colliding is not None:
            report.collisions, passed = pressing(colliding.point, colliding.weight, colliding.rest, start.x, x)
            if passed:
                report.reason = "yarns passed through each other"
                return None
        self.end(start, potential, x, u, h, report, scale)
        watch.lap("commit")
        if self.settings.dynamic_contacts:
            self.add_contacts(start, h, report)
            watch.lap("add")
        self.remove_contacts(start, report)
        vars(state).update(vars(start))
        watch.lap("commit")
        report.accepted = True
        return None

    def assign_nodes(self, state: YarnState, h: float, rates: Floats) -> Chain:
        """Choose EoL and EIL nodes for `rates` of u [N] [m/s], and carry the material velocity to the new mesh (sec. 4.1)."""
        if not self.settings.eil:
            state.eil[:] = False
            return chain_of(self.model, state.order, state.eil, state.active)
        old, was_eil, u = chain_of(self.model, state.order, state.eil, state.active), state.eil.copy(), state.u.copy()
        assign(self.model, state, self.settings.safety_distance, h, rates)
        new = chain_of(self.model, state.order, state.eil, state.active)
        if not np.array_equal(old.node, new.node):
            if self.settings.optimal_transition:
                transition.settle_switched(self.model, state, was_eil, new, self.settings.safety_distance)
            state.velocity = inertia.project(old, u, state.velocity, new, state.u)
        return new

    def first_guess(
        self, start: YarnState, potential: IncrementalPotential, time: float, h: float
    ) -> tuple[Floats, Floats, float, Floats]:
        """Return (x, u, energy, gradient) to start Newton from, handles having carried their pinned points.

        Either the last rates go on or everything stays, whichever has the lower incremental potential: where nodes
        meet, rates change at once.
        """
        x, u = start.x.copy(), start.u.copy()
        held = self.model.handle >= 0
        if held.any():
            x[held] = self.handles.carry(x[held], self.model.handle[held], time, h)
        du = np.zeros(self.model.node_count)
        du[potential.sliding] = h * start.u_rate[potential.sliding]
        further = x + h * np.einsum("pij,pj->pi", potential.projector[:, :3, :3], start.x_rate)
        slid = u + longest_update(potential.chain, u, du) * du
        on, still = ((*q, *potential.gradient(*q)) for q in ((further, slid), (x, u)))
        # anew, for what the potential keeps of it
        return still if still[2] <= on[2] else (*on[:2], *potential.gradient(*on[:2]))

    def measure(
        self, report: StepReport, potential: IncrementalPotential, gradient: Floats, x: Floats, u: Floats
    ) -> float:
        """Note the residual force, compared with gravity and with the largest internal force, and the largest gap.

        Returns the scale of force [N] that the residual is compared with.
        """
        m, c = self.model, potential.chain
        lines = potential.centre_lines
        tension = largest_tension(c.node, c.after, m.node_yarn, lines.place, m.stretch_stiffness, lines.through(x, u), u)
        floor = 1e-9 * float(m.stretch_stiffness.max(initial=0.0))
        scale = max(self.weight, 1e-3 * tension, floor)
        report.residual = float(np.abs(gradient).max(initial=0.0)) / scale
        report.contact_gap = self.largest_gap(potential.split, potential.gap[potential.split])
        return scale

    def largest_gap(self, points: Ints, gap: Floats) -> float:
        """Return the largest of the gaps [n, 3] at `points`, in yarn radii."""
        return float((np.linalg.norm(gap, axis=1) / self.radius[points]).max(initial=0.0))

    def end(
        self, start: YarnState, potential: IncrementalPotential, x: Floats, u: Floats, h: float, report: StepReport,
        scale: float,
    ) -> None:
        """Take (x, u) as the end of the step: velocity, friction, normal forces; `scale` is that of forces [N]."""
        m, c, s = self.model, potential.chain, self.settings
        at = m.node_point
        contact.place_eil(potential.interpolated, m.point_nodes, c.before, c.after, at, x, u)
        start.velocity = inertia.new_velocity(c.node, c.before, c.after, m.node_yarn, m.density, h, potential.corner_force,
                                              start.velocity, start.x[at], start.u, x[at], u)
        start.x_rate, start.u_rate = (x - start.x) / h, (u - start.u) / h

        friction.drag_anchors(potential.sliding_alone, potential.friction_stiffness, potential.friction_limit, u, start.anchor)
        friction_circle.drag_anchors(potential.rubbing, m.point_nodes, potential.rubbing_stiffness, potential.rubbing_limit,
                                     potential.slope, u, start.anchor)
        potential.internal(x, u)
        start.contact_force = potential.contact_force()
        start.gap[:] = 0.0
        start.gap[potential.split] = potential.gap[potential.split]
        self.write_normal_forces(start.active, potential, start.contact_force, x, u, start.normal_force)
        pulling = start.normal_force < -s.separation_force * scale
        start.pulling_time = np.where(pulling, start.pulling_time + h, 0.0)
        untouched = np.ones(m.point_count, np.bool_)
        untouched[potential.touching] = False
        start.obstacle_force[untouched], start.obstacle_anchor[untouched] = 0.0, x[untouched]
        if len(potential.touching):
            start.obstacle_anchor[potential.touching] = potential.obstacle_anchor[potential.touching]
            deepest = obstacle_contact.settle(
                potential.touching, potential.obstacles.end, potential.obstacle_distance, potential.obstacle_stiffness,
                potential.obstacle_limit, x, start.obstacle_anchor, start.obstacle_force)
            report.penetration = deepest / float(self.radius[potential.touching].min())

        start.x, start.u = x, u

    def in_doubt(
        self, potential: IncrementalPotential, x: Floats, u: Floats, scale: float, lacked: Floats,
    ) -> Flags:
        """Return which contacts between fabrics pull or press as far as their gaps let one know, shape [P].

        What its gap adds to a multiplier is a measure of what F_n lacks still: a small gap between stiff yarns is no small
        force. It matters where it is more than a multiple of the pull that counts as pulling, and than the residual that a
        step may leave; `scale` is that of forces [N]. What an update of the multipliers has not halved comes from that
        residual, and more of them would not tell: `lacked` [P] is what it was the last time [N], and is written.
        """
        m, s, split = self.model, self.settings, potential.split
        threshold = s.separation_force * scale
        least = max(ENOUGH * threshold, s.tolerance * scale)
        resistance = np.zeros((m.point_count, 3))
        resistance[split] = potential.resistance()
        doubtful = (m.point_kind == PointKind.CONTACT) & (np.linalg.norm(resistance, axis=1) > least)
        if doubtful.any():
            force, lacking = np.zeros(m.point_count), np.zeros(m.point_count)
            self.write_normal_forces(doubtful, potential, potential.contact_force(), x, u, force)
            self.write_normal_forces(doubtful, potential, resistance, x, u, lacking)
            lacking = np.abs(lacking)
            doubtful &= (lacking > least) & (np.abs(force + threshold) <= lacking) & (lacking <= 0.5 * lacked)
            lacked[:] = np.where(lacking > least, lacking, np.inf)
        return doubtful

    def write_normal_forces(
        self, points: Flags, potential: IncrementalPotential, contact_force: Floats, x: Floats, u: Floats, force: Floats
    ) -> None:
        """Write F_n [N] of `points` [P] to `force` [P], 0 for the others; `contact_force` [P, 3] acts on them [N]."""
        m, c = self.model, potential.chain
        normal_force.normal_forces(
            m.point_kind, m.point_nodes, m.side, points, c.before, c.after, m.node_point, m.node_yarn, m.radius,
            m.crossing_spacing, m.bending_stiffness, m.stretch_stiffness, m.height, contact_force, x, u, force)

    def add_contacts(self, state: YarnState, h: float, report: StepReport) -> None:
        """Let contacts begin where yarns would pass through each other."""
        coming = addition.approach(self.model, state, chain_of(self.model, state.order, state.eil, state.active))
        begin = addition.meeting(self.model, coming, h)
        if begin.any():
            addition.add(self.model, state, coming, begin)
            report.added = int(begin.sum())
            report.addition_gap = self.largest_gap(coming.points[begin], coming.between[begin])

    def remove_contacts(self, state: YarnState, report: StepReport) -> None:
        """Take contacts that ended out of use."""
        ended = parted(self.model, state, self.settings.separation_time, self.settings.safety_distance)
        if len(ended):
            remove(self.model, state, ended)
            if self.collisions is not None:
                state.parting[ended] = self.model.point_nodes[ended, 1] >= 0
            report.removed = len(ended)


@njit(cache=True)
def largest_tension(chain, after, node_yarn, place, stiffness, centre, u):
    """Largest |T| over all segments [N]."""
    largest = 0.0
    for i in chain:
        j = after[i]
        if j >= 0:
            square = 0.0
            for k in range(3):
                square += (centre[place[j], k] - centre[place[i], k]) ** 2
            largest = max(largest, stiffness[node_yarn[i]] * abs(np.sqrt(square) / (u[j] - u[i]) - 1.0))
    return largest


@njit(cache=True)
def meets_neighbour(chain, after, distance, u0, u):
    """Whether EoL nodes that were farther apart at u0 have come nearer to each other than their `distance` [N] [m] at u."""
    for i in chain:
        j = after[i]
        if j >= 0 and u[j] - u[i] < distance[i] <= u0[j] - u0[i]:
            return True
    return False


@njit(cache=True)
def passes_neighbours(before, after, eil, order, node_point, active, u):
    """Whether an EIL node left the segments next to its own, between the EoL nodes around it."""
    for i in order:
        if eil[i] and active[node_point[i]]:
            a, c = before[i], after[i]
            low = u[before[a]] if before[a] >= 0 else -np.inf
            high = u[after[c]] if after[c] >= 0 else np.inf
            if u[i] < low or u[i] > high:
                return True
    return False
