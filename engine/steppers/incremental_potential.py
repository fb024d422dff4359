"""The incremental potential of one implicit Euler step of yarns: the sum of its terms, with gradient and Hessian."""

import numpy as np
from numpy.typing import DTypeLike

from engine.arrays import Flags, Floats, Ints
from engine.contact import collisions
from engine.contact import obstacles as obstacle_contact
from engine.contact.collisions import CollisionPairs
from engine.contact.obstacles import ObstacleMotion
from engine.linalg.block_matrix import BLOCK
from engine.steppers.layout import Layout, lay_out, parts_of
from engine.yarns import (
    constraints,
    contact,
    friction,
    friction_circle,
    inertia,
    internal,
    normal_force,
    parallel_contact,
    shear,
    turning,
    weave_set,
)
from engine.yarns.crimp import centre_lines
from engine.yarns.leverage import stiffness_by_leverage
from engine.yarns.model import PointKind, YarnModel, YarnState
from engine.yarns.settings import YarnSettings
from engine.yarns.topology import Chain


class IncrementalPotential:
    """I + V of a step of size h from `state`, whose assignment is `chain`; forces and anchors are those of its start."""

    def __init__(
        self, model: YarnModel, settings: YarnSettings, gravity: Floats, obstacles: ObstacleMotion,
        state: YarnState, chain: Chain, h: float, colliding: CollisionPairs | None = None,
    ):
        """Freeze what stays constant within the step."""
        self.model, self.obstacles, self.state, self.chain, self.h = model, obstacles, state, chain, h
        self.settings = settings
        self.colliding = colliding
        self.x0, self.u0 = state.x.copy(), state.u.copy()
        yarn_scale = model.stretch_stiffness / model.rest_segment
        first, second = model.point_nodes.T
        node_scale = yarn_scale[model.node_yarn]
        point_scale = np.maximum(node_scale[first], np.where(second >= 0, node_scale[second], 0.0))
        # next to stretch, the constraint must outweigh inertia, which a small step makes large
        inertia_scale = np.max(model.density * model.rest_segment, initial=0.0) / (h * h)
        self.constraint_stiffness = settings.constraint_factor * point_scale + 10.0 * inertia_scale
        self.hold = settings.gauge * node_scale
        self.parallel_stiffness = settings.parallel_factor * node_scale
        self.obstacle_stiffness = settings.obstacle_factor * point_scale

        active_node = state.active[model.node_point]
        self.sliding = np.flatnonzero(active_node & ~model.u_fixed)
        has_eil = state.eil[first] | ((second >= 0) & state.eil[second])
        self.split = np.flatnonzero(state.active & has_eil & (model.point_kind != PointKind.LAGRANGIAN))
        interpolated = state.active & constraints.interpolated(model, state)
        self.interpolated = np.flatnonzero(interpolated)
        self.interpolated_contact = interpolated & (model.point_kind == PointKind.CONTACT)
        self.sheared = shear.sheared(model, state)
        self.parts = self.sheared_parts = np.zeros(1, np.int64)  # of both, for work at once: none before `lay_out`
        self.shear_stiffness, self.free_angle = shear.stiffness(model), shear.free_angle(model)
        pair, distance = parallel_contact.touching_pairs(model, state, chain)
        near = parallel_contact.within_reach(pair, distance, self.u0, state.u_rate, h)
        self.parallel_pair, self.parallel_distance = pair[near], distance[near]
        self.centre_lines = centre_lines(model, state, chain)
        self.centre0 = self.centre_lines.through(self.x0, self.u0)
        self.offsets = self.centre_lines.offsets
        self.set_nodes = weave_set.set_nodes(model, chain)
        self.stretch_at_start = np.ones(model.node_count)
        normal_force.stretches(np.flatnonzero(active_node), chain.before, chain.after, self.centre_lines.place,
                               self.centre0, self.u0, self.stretch_at_start)
        pressing = np.maximum(state.normal_force, 0.0) * model.friction
        at_node = pressing[model.node_point]
        self.friction_limit = self.stretch_at_start * at_node
        self.friction_stiffness = friction.springs(settings.friction_factor * node_scale, at_node,
                                                   model.rest_segment[model.node_yarn])
        self._share_friction(pressing)
        at_nodes = self.x0[model.node_point]
        self.prediction = inertia.predict(model, at_nodes, state.velocity, gravity, h)
        self.corner_force = inertia.corner_forces(model, chain, at_nodes, self.u0, state.u_rate, state.velocity)

        self.touching = self._touching()
        distance = model.obstacle_distance[model.node_yarn]
        self.obstacle_distance = np.minimum(distance[first], np.where(second >= 0, distance[second], np.inf))
        self.obstacle_anchor = state.obstacle_anchor.copy()
        self.obstacle_normal, self.obstacle_limit = np.zeros((model.point_count, 3)), np.zeros(model.point_count)
        if len(self.touching):
            obstacle_contact.carry(self.touching, obstacles.begin, obstacles.end, obstacles.friction, state.obstacle_force,
                                   self.x0, self.obstacle_anchor, self.obstacle_normal, self.obstacle_limit)

        self.pull, self.obstacle_pull = np.zeros((model.point_count, 3)), np.zeros((model.point_count, 3))
        self.update_pull(self.x0, self.u0, np.zeros((model.point_count, BLOCK)))

        self.projector = constraints.projectors(model, state)
        self.constrained = (self.projector != np.eye(BLOCK)).any(axis=(1, 2))
        self.constrained_points = np.flatnonzero(self.constrained)
        self.by_node = np.zeros((model.node_count, 4))
        self.gap = np.zeros((model.point_count, 3))
        free = self.projector[:, :3, :3]
        held = state.active & (free != np.eye(3)).any(axis=(1, 2))
        self.constraint_shape = np.zeros((model.point_count, 3, 3))
        self.constraint_shape[self.split] = stiffness_by_leverage(model, state, chain, self.split, free, held)
        self.last_gap = np.full(model.point_count, np.inf)  # when the multipliers were updated [m]
        self.multiplier = np.zeros((model.point_count, 3))
        self.multiplier[self.split] = state.contact_force[self.split]

    def _share_friction(self, limit: Floats) -> None:
        """Let the isotropic law, where it is chosen, have the points on which two yarns slide; `limit` [P] is mu F_n."""
        model, state = self.model, self.state
        slides = np.zeros(model.node_count, np.bool_)
        slides[self.sliding] = self.settings.friction_law == "isotropic"
        first, second = model.point_nodes.T
        self.rubbing = np.flatnonzero((second >= 0) & slides[first] & slides[second])
        self.sliding_alone = self.sliding[~np.isin(model.node_point[self.sliding], self.rubbing)]
        self.rubbing_limit = limit
        self.rubbing_stiffness = np.minimum(self.friction_stiffness[first], self.friction_stiffness[second])
        self.friction_limit[model.point_nodes[self.rubbing]] = 0.0
        self.slope = np.zeros((model.node_count, 3))
        friction_circle.slopes(self.rubbing, model.point_nodes, state.eil, self.chain.before, self.chain.after,
                               model.node_point, self.x0, self.u0, self.slope)

    def update_pull(self, x: Floats, u: Floats, direction: Floats) -> None:
        """Let the estimates of friction's forces follow an update of x and u along `direction` [P, 5]."""
        m = self.model
        friction_circle.update_pull(self.rubbing, m.point_nodes, self.rubbing_stiffness, self.rubbing_limit, self.slope,
                                    self.state.anchor, u, direction[m.node_point, 3 + m.node_slot], self.pull)
        if len(self.touching):
            obstacle_contact.update_pull(self.touching, self.obstacle_stiffness, self.obstacle_anchor, self.obstacle_normal,
                                         self.obstacle_limit, x, direction, self.obstacle_pull)

    def _touching(self) -> Ints:
        """Points that may touch obstacles: those whose x moves with one fabric's material."""
        if len(self.obstacles.end.kind) == 0:
            return np.zeros(0, np.int64)
        model, state = self.model, self.state
        kind = model.point_kind
        of_one_fabric = (kind == PointKind.LAGRANGIAN) | (kind == PointKind.CROSSING) | (kind == PointKind.STITCH)
        free = model.free_directions.any(axis=(1, 2))
        return np.flatnonzero(of_one_fabric & state.active & free & ~constraints.interpolated(model, state))

    def internal(self, x: Floats, u: Floats) -> float:
        """Write the gradient of inertia, elasticity and constraints by node [N, 4]; returns their energy [J]."""
        m, c = self.model, self.chain
        g = self.by_node
        g[:] = 0.0
        energy = self._of_yarns(x, u, g)
        energy += shear.add_gradient_in_parts(self.sheared, self.sheared_parts, m.point_nodes, self.state.eil, c.before,
                                              c.after, m.node_point, self.shear_stiffness, self.free_angle, x, g)
        energy += parallel_contact.add_gradient(self.parallel_pair, self.parallel_distance, self.parallel_stiffness, u, g)
        energy += contact.add_gradient_in_parts(
            self.split, self.parts, m.point_nodes, self.state.eil, c.before, c.after, m.node_point,
            self.constraint_stiffness, self.constraint_shape, self.multiplier, x, u, g, self.gap)
        return energy

    def _of_yarns(self, x: Floats, u: Floats, g: Floats) -> float:
        """Add the gradient of inertia, stretch and bending to g [N, 4]; returns their energy [J].

        Forces on centre lines with offsets are kept too, for what they do by turning these.
        """
        m, c, lines = self.model, self.chain, self.centre_lines
        if self.offsets is None:
            return internal.add_gradient(
                c.node, c.start, m.node_point, m.density, m.kinematic, m.stretch_stiffness, m.stretch_damping,
                m.bending_stiffness, self.h, self.u0, self.prediction, self.corner_force, x, u, lines.place, self.centre0, x, g)
        normals, centre, none = self.offsets.normals(x), lines.through(x, u), np.zeros(m.yarn_count)
        self.on_centres, self.on_normals = np.zeros((m.node_count, 4)), np.zeros(normals.shape)
        energy = internal.add_gradient(
            c.node, c.start, m.node_point, m.density, m.kinematic, none, none, none, self.h, self.u0, self.prediction,
            self.corner_force, x, u, lines.place, self.centre0, centre, g)
        energy += internal.add_gradient(
            c.node, c.start, m.node_point, m.density, np.ones(m.yarn_count, np.bool_), m.stretch_stiffness, m.stretch_damping,
            m.bending_stiffness, self.h, self.u0, self.prediction, self.corner_force, x, u, lines.place, self.centre0, centre,
            self.on_centres)
        energy += weave_set.add_gradient(
            self.set_nodes, c.before, c.after, m.node_yarn, m.bending_stiffness, m.set_angle, m.set_rise, self.offsets.source,
            normals, centre, u, self.on_centres, self.on_normals)
        g += self.on_centres
        return energy

    def gradient(self, x: Floats, u: Floats) -> tuple[float, Floats]:
        """Return the energy [J] and the gradient with respect to the unknowns of points [P, 5] [N]."""
        m = self.model
        energy = self.internal(x, u)
        energy += friction.add_gradient(self.sliding, self.friction_stiffness, self.friction_limit, self.state.anchor,
                                        self.hold, self.u0, u, self.by_node)
        energy += friction_circle.add_gradient(self.rubbing, m.point_nodes, self.rubbing_stiffness, self.rubbing_limit,
                                               self.slope, self.state.anchor, u, self.by_node)
        gradient = np.zeros((m.point_count, BLOCK))
        constraints.gather(m.node_point, m.node_slot, self.by_node, gradient)
        if self.offsets is not None:
            turning.add_couples(self.offsets, m.node_slot, x, u, self.on_centres, self.on_normals, gradient)
        if len(self.touching):
            energy += obstacle_contact.add_gradient(
                self.touching, self.obstacles.end, self.obstacle_distance, self.obstacle_stiffness, self.obstacle_anchor,
                self.obstacle_normal, self.obstacle_limit, x, gradient)
        if (pairs := self.colliding) is not None:
            energy += collisions.add_gradient(pairs.point, pairs.weight, pairs.rest, pairs.stiffness, x, gradient)
        constraints.project_gradient(self.constrained_points, self.projector, gradient)
        return energy, gradient

    def update_multipliers(self, tolerance: float) -> bool:
        """Let the multipliers take over the constraint's force; `tolerance` [m] is a gap that may stay.

        A contact whose gap has hardly shrunk since the last time works against something stiffer than itself: it
        becomes three times as stiff. Returns whether there is one.
        """
        self.multiplier = self.contact_force()
        gap = np.linalg.norm(self.gap[self.split], axis=1)
        slow = self.split[(gap > tolerance) & (gap > 0.25 * self.last_gap[self.split])]
        self.last_gap[self.split] = gap
        self.constraint_stiffness[slow] *= 3.0
        return len(slow) > 0

    def contact_force(self) -> Floats:
        """Return the force between both sides of every point, at the last evaluation of `internal`, shape [P, 3] [N].

        At EIL nodes it is multiplier and resistance; at shared points what one yarn's own equation of motion lacks.
        """
        first, second = self.model.point_nodes.T
        on_first, on_second = self.by_node[first, :3], self.by_node[second, :3]
        force = np.where((second >= 0)[:, None], 0.5 * (on_second - on_first), -on_first)
        force[self.split] = self.multiplier[self.split] + self.resistance()
        return force

    def resistance(self) -> Floats:
        """Return the part of the force at `split` that the gap makes, at the last evaluation of `internal` [n, 3] [N]."""
        return self.constraint_stiffness[self.split, None] * np.einsum(
            "pij,pj->pi", self.constraint_shape[self.split], self.gap[self.split])

    def lay_out(self, dtype: DTypeLike = np.float32, condense: bool = True) -> Layout:
        """Return a linear system with the blocks that the terms of this step touch.

        Without `condense` every unknown keeps its place in it.
        """
        m, c = self.model, self.chain
        node, after = c.node, c.after
        ahead = node[after[node] >= 0]
        beyond = ahead[after[after[ahead]] >= 0]
        pairs = [
            np.column_stack([m.node_point[ahead], m.node_point[after[ahead]]]),
            np.column_stack([m.node_point[beyond], m.node_point[after[after[beyond]]]]),
        ]
        members, sheared = self._members(), shear.members(m, c, self.sheared)
        for together in (members, sheared):
            pairs += [together[:, [a, b]] for a in range(5) for b in range(a)]
        pairs.append(m.node_point[self.parallel_pair])
        if self.colliding is not None:
            pairs.append(self.colliding.coupled(m.point_count))
        if self.offsets is not None:
            pairs.append(turning.coupled(self.offsets, c, m.node_slot, self.x0, self.u0))

        condensed = np.zeros(0, np.int64)
        if condense:
            condensed = np.flatnonzero(self.interpolated_contact[self.split])
        layout = lay_out(np.concatenate(pairs), np.flatnonzero(self.state.active), self.split[condensed],
                         members[condensed, 1:], m.point_count, dtype)
        order, self.parts = parts_of(layout, members)
        self.split, self.split_members = self.split[order], members[order]
        order, self.sheared_parts = parts_of(layout, sheared)
        self.sheared, self.sheared_members = self.sheared[order], sheared[order]
        self.band = np.empty((len(node), 3, 4, 4), dtype)
        self.place = np.full(m.node_count, -1, np.int64)
        self.place[node] = np.arange(len(node))
        self.sliding_curvature = np.empty((m.point_count, 2, 2))
        return layout

    def _members(self) -> Ints:
        """Points that the constraint at each of `split` touches: itself and the EoL nodes around it, shape [n, 5]."""
        m, c = self.model, self.chain
        members = [self.split]
        for n in m.point_nodes[self.split].T:
            is_eil = (n >= 0) & self.state.eil[n]
            for neighbour in (c.before, c.after):
                members.append(np.where(is_eil, m.node_point[neighbour[n]], self.split))
        return np.column_stack(members)

    def hessian(self, x: Floats, u: Floats, convex: Flags, layout: Layout) -> bool:
        """Write the Hessian, with the constrained unknowns as identity; where points are `convex` [P], a positive form of it.

        Returns whether the condensed unknowns could be eliminated, whose block must be positive for that.
        """
        m, c, a = self.model, self.chain, layout.matrix
        lines, centre, none = self.centre_lines, self.centre_lines.through(x, u), np.zeros(m.yarn_count)
        on_x = self.offsets is None  # or on centre lines
        internal.hessian(
            c.node, c.start, m.density, m.kinematic, m.stretch_stiffness if on_x else none, m.stretch_damping,
            m.bending_stiffness if on_x else none, self.h, self.u0, self.prediction, u, lines.place, self.centre0, centre,
            convex[m.node_point], self.band)
        self.sliding_curvature[:] = 0.0
        friction.add_hessian(self.sliding, m.node_point, m.node_slot, self.friction_stiffness, self.friction_limit,
                             self.state.anchor, self.hold, u, self.sliding_curvature)
        friction_circle.add_hessian(self.rubbing, m.point_nodes, self.rubbing_stiffness, self.rubbing_limit, self.slope,
                                    self.state.anchor, self.pull, u, self.sliding_curvature)
        internal.gather(layout.point, layout.row, m.point_nodes, self.place, c.node, c.start, m.node_yarn, m.node_point,
                        m.node_slot, self.band, self.sliding_curvature, a.start, a.column, a.block)
        if self.offsets is not None:
            internal.hessian(
                c.node, c.start, m.density, np.ones(m.yarn_count, np.bool_), m.stretch_stiffness, m.stretch_damping,
                m.bending_stiffness, self.h, self.u0, self.prediction, u, lines.place, self.centre0, centre,
                convex[m.node_point], self.band)
            turning.add_hessian(self.offsets, c, m.node_slot, x, u, self.band, layout.row, a.start, a.column, a.block)
        shear.add_hessian_in_parts(
            self.sheared, self.sheared_parts, m.point_nodes, self.state.eil, c.before, c.after, m.node_point,
            self.shear_stiffness, self.free_angle, x, convex, layout.row, a.start, a.column, a.block)
        parallel_contact.add_hessian(self.parallel_pair, self.parallel_distance, self.parallel_stiffness, m.node_point,
                                     m.node_slot, u, layout.row, a.start, a.column, a.block)
        positive = contact.add_hessian_in_parts(
            self.split, self.parts, m.point_nodes, self.state.eil, c.before, c.after, m.node_point, m.node_slot,
            self.constraint_stiffness, self.constraint_shape, self.multiplier, x, u, convex, self.sliding_curvature,
            layout.row, layout.condensed, a.start, a.column, a.block, layout.inverse, layout.coupling)
        if len(self.touching):
            obstacle_contact.add_hessian(
                self.touching, self.obstacles.end, self.obstacle_distance, self.obstacle_stiffness, self.obstacle_anchor,
                self.obstacle_normal, self.obstacle_limit, self.obstacle_pull, x, a.diagonal[layout.row], a.block)
        if (colliding := self.colliding) is not None:
            collisions.add_hessian(colliding.point, colliding.weight, colliding.rest, colliding.stiffness, x, convex,
                                   layout.row, a.start, a.column, a.block)
        constraints.project_hessian(self.constrained, self.projector, layout.point, a.start, a.column, a.diagonal, a.block)
        constraints.project_coupling(layout.others, self.projector, layout.coupling)
        return positive
