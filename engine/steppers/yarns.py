"""One implicit Euler step of Eulerian-on-Lagrangian rods with EoL and EIL nodes (Sánchez-Banderas 2020, sec. 4)."""

import numpy as np
from numba import njit

from engine.arrays import Floats
from engine.contact import obstacles as obstacle_contact
from engine.contact.obstacles import Obstacles
from engine.linalg.block_matrix import BlockMatrix
from engine.linalg.conjugate_gradient import conjugate_gradient
from engine.linalg.incomplete_cholesky import factorise
from engine.steppers.incremental_potential import IncrementalPotential
from engine.steppers.line_search import line_search, longest_update
from engine.steppers.step_report import StepReport, Stopwatch
from engine.yarns import contact, friction, inertia, normal_force
from engine.yarns.handles import Handles
from engine.yarns.model import YarnModel, YarnState
from engine.yarns.removal import parted, remove
from engine.yarns.settings import YarnSettings
from engine.yarns.topology import Chain, assign, chain_of


class YarnStepper:
    """Advances the yarns of a scene, one step at a time."""

    def __init__(
        self, model: YarnModel, settings: YarnSettings, gravity: Floats, obstacles: Obstacles, handles: Handles
    ):
        """Keep what does not change between steps; `gravity` [3] in m/s^2."""
        self.model, self.settings, self.obstacles, self.handles = model, settings, obstacles, handles
        self.gravity = np.asarray(gravity, np.float64)
        self.weight = float(np.max(model.density * model.rest_segment, initial=0.0) * np.linalg.norm(self.gravity))

    def step(self, state: YarnState, time: float, h: float) -> StepReport:
        """Advance `state` from `time` by `h` [s]; a rejected step leaves it as it was."""
        report, watch = StepReport(), Stopwatch()
        start = state.copy()
        chain = self.assign_nodes(start, h)
        potential = IncrementalPotential(
            self.model, self.settings, self.gravity, self.obstacles, start, chain, h)
        hessian = potential.pattern()
        watch.lap("assign")

        x, u = self.extrapolate(start, chain, time, h)
        energy, gradient = potential.gradient(x, u)
        watch.lap("assemble")
        while not self.converged(report, gradient, chain, x, u):
            if report.newton_iterations == self.settings.max_newton:
                return rejected(report, watch, "Newton did not converge")
            direction = self.newton_direction(potential, x, u, gradient, hessian, report, watch)
            dx, du = direction[:, :3], direction[self.model.node_point, 3 + self.model.node_slot]
            slope = float(np.sum(gradient * direction))
            found = line_search(potential, x, u, dx, du, energy, gradient, slope)
            watch.lap("line_search")
            if found is None:
                return rejected(report, watch, "the line search found no descent")
            x, u, energy, gradient = found
            report.newton_iterations += 1
        if not np.isfinite(energy):
            return rejected(report, watch, "the energy is not finite")
        if passes_neighbours(chain.before, chain.after, start.eil, start.order, self.model.node_point, start.active, u):
            return rejected(report, watch, "a node passed more than one neighbour")
        self.commit(state, start, potential, x, u, h, report)
        watch.lap("commit")
        report.accepted, report.stages = True, watch.laps
        return report

    def assign_nodes(self, state: YarnState, h: float) -> Chain:
        """Choose EoL and EIL nodes, and carry the material velocity over to the new mesh (sec. 4.1)."""
        if not self.settings.eil:
            return chain_of(self.model, state.order, state.eil, state.active)
        old = chain_of(self.model, state.order, state.eil, state.active)
        assign(self.model, state, self.settings.safety_distance, h)
        new = chain_of(self.model, state.order, state.eil, state.active)
        if not np.array_equal(old.node, new.node):
            state.velocity = inertia.project(old, state.u, state.velocity, new, state.u)
        return new

    def extrapolate(self, start: YarnState, chain: Chain, time: float, h: float) -> tuple[Floats, Floats]:
        """Return the first guess of (x, u): the last rates go on, handles carry their pinned points."""
        x = start.x + h * np.einsum("pij,pj->pi", self.model.free_directions, start.x_rate)
        held = self.model.handle >= 0
        if held.any():
            motion = self.handles.offsets(time + h) - self.handles.offsets(time)
            x[held] = start.x[held] + motion[self.model.handle[held]]
        du = np.where(self.model.u_fixed | ~start.active[self.model.node_point], 0.0, h * start.u_rate)
        return x, start.u + longest_update(chain, start.u, du) * du

    def converged(self, report: StepReport, gradient: Floats, chain: Chain, x: Floats, u: Floats) -> bool:
        """Compare the residual force with gravity and with the largest internal force; notes it in the report."""
        m = self.model
        tension = largest_tension(chain.node, chain.after, m.node_yarn, m.node_point, m.stretch_stiffness, x, u)
        floor = 1e-9 * float(m.stretch_stiffness.max(initial=0.0))
        report.residual = float(np.abs(gradient).max(initial=0.0)) / max(self.weight, 1e-3 * tension, floor)
        return report.residual <= self.settings.tolerance

    def newton_direction(
        self, potential: IncrementalPotential, x: Floats, u: Floats, gradient: Floats, hessian: BlockMatrix,
        report: StepReport, watch: Stopwatch,
    ) -> Floats:
        """Return H^-1 (-gradient), shape [P, 5]: of the true Hessian or, where that is indefinite, of its positive form."""
        direction = np.empty_like(gradient)
        for convex in (False, True):
            potential.hessian(x, u, convex, hessian)
            watch.lap("assemble")
            preconditioner = factorise(hessian)
            watch.lap("factor")
            if preconditioner is not None:
                iterations, positive = conjugate_gradient(
                    hessian, -gradient, direction, preconditioner, self.settings.linear_tolerance,
                    self.settings.max_linear)
                report.linear_iterations += iterations
                watch.lap("solve")
                if positive:
                    return direction
        return -gradient

    def commit(
        self, state: YarnState, start: YarnState, potential: IncrementalPotential, x: Floats, u: Floats, h: float,
        report: StepReport,
    ) -> None:
        """Take (x, u) as the end of the step: velocity, friction, normal forces, contacts that ended."""
        m, c, s = self.model, potential.chain, self.settings
        at = m.node_point
        contact.place_eil(potential.split, m.point_nodes, start.eil, c.before, c.after, at, x, u)
        start.velocity = inertia.new_velocity(c.node, c.before, c.after, m.node_yarn, m.density, h, potential.corner_force,
                                              start.velocity, start.x[at], start.u, x[at], u)
        start.x_rate, start.u_rate = (x - start.x) / h, (u - start.u) / h

        friction.drag_anchors(potential.sliding, potential.friction_stiffness, potential.friction_limit, u, start.anchor)
        potential.internal(x, u)
        normal_force.normal_forces(
            m.point_kind, m.point_nodes, m.side, start.active, start.eil, c.before, c.after, at, m.node_yarn, m.radius,
            m.rest_segment, m.bending_stiffness, m.stretch_stiffness, potential.constraint_stiffness, potential.by_node,
            potential.gap, x, u, start.normal_force)
        pulling = start.normal_force < -s.separation_force
        start.pulling_steps = np.where(pulling, start.pulling_steps + 1, 0)
        radius = m.radius[m.node_yarn[m.point_nodes[:, 0]]]
        if len(potential.split):
            gap = np.linalg.norm(potential.gap[potential.split], axis=1)
            report.contact_gap = float((gap / radius[potential.split]).max())
        if len(potential.touching):
            o = self.obstacles
            deepest = obstacle_contact.settle(
                potential.touching, o.kind, o.centre, o.rotation, o.size, o.friction, potential.obstacle_distance,
                potential.obstacle_stiffness, x, start.obstacle_anchor, start.obstacle_force,
                potential.state.obstacle_force.copy())
            report.penetration = deepest / float(radius[potential.touching].min())

        start.x, start.u = x, u
        ended = parted(m, start, s.separation_steps)
        if len(ended):
            remove(m, start, ended)
            report.removed = len(ended)
        vars(state).update(vars(start))


def rejected(report: StepReport, watch: Stopwatch, reason: str) -> StepReport:
    """Finish the report of a step that must be tried again with a smaller h."""
    report.reason, report.stages = reason, watch.laps
    return report


@njit(cache=True)
def largest_tension(chain, after, node_yarn, node_point, stiffness, x, u):
    """Largest |T| over all segments [N]."""
    largest = 0.0
    for i in chain:
        j = after[i]
        if j >= 0:
            square = 0.0
            for k in range(3):
                square += (x[node_point[j], k] - x[node_point[i], k]) ** 2
            largest = max(largest, stiffness[node_yarn[i]] * abs(np.sqrt(square) / (u[j] - u[i]) - 1.0))
    return largest


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
