"""A piece of an incremental potential: the terms that some points take part in, while everything else stands still.

It has the same terms as the whole potential, packed with numbers of its own: so it takes the same code, and as much time as
its size asks for. Where a yarn leaves the piece and comes back, each run of its nodes is a yarn of the piece.
"""

from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from engine.arrays import Flags, Floats, Ints
from engine.steppers.incremental_potential import IncrementalPotential
from engine.steppers.layout import Layout
from engine.yarns.crimp import CentreLines
from engine.yarns.model import YarnModel
from engine.yarns.topology import Chain

OF_POINTS = (
    "x0", "interpolated_contact", "constraint_stiffness", "constraint_shape", "multiplier", "gap", "last_gap",
    "shear_stiffness", "free_angle", "rubbing_stiffness", "rubbing_limit", "pull", "obstacle_stiffness", "obstacle_distance",
    "obstacle_anchor", "obstacle_normal", "obstacle_limit", "obstacle_pull",
)
OF_NODES = (
    "u0", "hold", "prediction", "corner_force", "parallel_stiffness", "friction_stiffness", "friction_limit", "slope", "by_node",
)


@dataclass(frozen=True)
class Piece:
    """Its potential has p points and n nodes, those at the ends of its terms among them, which stand still."""

    potential: IncrementalPotential
    points: Ints  # which they are of the whole, shape [p]
    nodes: Ints  # [n]

    def put_back(self, own_x: Floats, own_u: Floats, x: Floats, u: Floats, whole: IncrementalPotential) -> None:
        """Write the piece's x [p, 3] and u [n] to x [P, 3] and u [N], and what it learnt of friction, to the `whole`."""
        x[self.points], u[self.nodes] = own_x, own_u
        whole.pull[self.moving] = self.potential.pull[self.moves]
        whole.obstacle_pull[self.moving] = self.potential.obstacle_pull[self.moves]

    @property
    def moves(self) -> Flags:
        """Which of its points have something that may move, shape [p]."""
        return np.asarray(self.potential.projector.any(axis=(1, 2)))

    @property
    def moving(self) -> Ints:
        """Which points of the whole they are."""
        return self.points[self.moves]


def points_around(seeds: Ints, rings: int, layout: Layout) -> Flags:
    """Return the points with a row within so many `rings` of coupled points around `seeds` [n], shape [P]."""
    a = layout.matrix
    condensed = layout.condensed[seeds]
    edge = np.unique(layout.row[np.concatenate([seeds[condensed < 0], layout.others[condensed[condensed >= 0]].ravel()])])
    within = np.zeros(a.rows, np.bool_)
    within[edge] = True
    for _ in range(rings):
        length = a.start[edge + 1] - a.start[edge]
        before = np.cumsum(length) - length
        beside = np.unique(a.column[np.repeat(a.start[edge] - before, length) + np.arange(length.sum())])
        edge = beside[~within[beside]]
        within[edge] = True
    around = np.zeros(len(layout.row), np.bool_)
    around[layout.point[within]] = True
    return around


def piece_of(whole: IncrementalPotential, free: Flags) -> Piece:
    """Return the terms that touch `free` points [P], which alone may move.

    Yarns have no crimp: normals reach from piece to piece. The u of a contact with two EIL nodes meet nothing but the
    contact's own term, and are free where that is there.
    """
    assert whole.offsets is None
    m, s = whole.model, whole.state
    split, sheared, pair = (free[members].any(axis=1) for members in (
        whole.split_members, whole.sheared_members, m.node_point[whole.parallel_pair]))
    free = free.copy()
    free[whole.split[split & whole.interpolated_contact[whole.split]]] = True
    present = free.copy()
    present[m.node_point[_within_two(whole.chain, m.point_nodes[free], s.eil)]] = True
    for members in (whole.split_members[split], whole.sheared_members[sheared], m.node_point[whole.parallel_pair[pair]]):
        present[members] = True
    if (pairs := whole.colliding) is not None:
        colliding = free[pairs.point].any(axis=1)
        present[pairs.point[colliding]] = True

    points, nodes = np.flatnonzero(present), s.order[present[m.node_point[s.order]]]
    point_number, node_number = (np.full(count + 1, -1, np.int64) for count in (m.point_count, m.node_count))  # -1 stays so
    point_number[points], node_number[nodes] = np.arange(len(points)), np.arange(len(nodes))

    def numbered(of_whole: Ints, number: Ints) -> Ints:
        return number[of_whole[number[of_whole] >= 0]]

    own = copy(whole)
    own.model, own.chain = _runs(whole, points, nodes, point_number, node_number)
    own.state = replace(s, **_taken(s, s.OF_POINTS, points), **_taken(s, s.OF_NODES, nodes))
    own.state.order = np.arange(len(nodes))
    vars(own).update(_taken(whole, OF_POINTS, points), **_taken(whole, OF_NODES, nodes))
    own.split, own.sheared = point_number[whole.split[split]], point_number[whole.sheared[sheared]]
    own.touching, own.rubbing = numbered(whole.touching, point_number), numbered(whole.rubbing, point_number)
    own.sliding, own.sliding_alone = numbered(whole.sliding, node_number), numbered(whole.sliding_alone, node_number)
    own.parallel_pair, own.parallel_distance = node_number[whole.parallel_pair[pair]], whole.parallel_distance[pair]
    if pairs is not None:
        own.colliding = replace(pairs, point=point_number[pairs.point[colliding]], weight=pairs.weight[colliding],
                                rest=pairs.rest[colliding], stiffness=pairs.stiffness[colliding])
    own.centre_lines, own.centre0 = CentreLines(own.model.node_point, own.model.node_point, None), own.x0
    own.parts = own.sheared_parts = np.zeros(1, np.int64)
    still = ~free[points]
    own.projector = whole.projector[points]
    own.projector[still] = 0.0
    own.constrained = whole.constrained[points] | still
    own.constrained_points = np.flatnonzero(own.constrained)
    return Piece(own, points, nodes)


def _taken(owner: object, names: tuple[str, ...], index: Ints) -> dict[str, Any]:
    return {name: getattr(owner, name)[index] for name in names}


def _within_two(chain: Chain, nodes: Ints, eil: Flags) -> Ints:
    """Return the EoL nodes among `nodes`, -1 being none, and the two before and behind each: bending reaches no further."""
    nodes = nodes[nodes >= 0]
    nodes = nodes[~eil[nodes]]
    for _ in range(2):
        nodes = np.unique(np.concatenate([nodes, chain.before[nodes], chain.after[nodes]]))
        nodes = nodes[nodes >= 0]
    return nodes


def _runs(
    whole: IncrementalPotential, points: Ints, nodes: Ints, point_number: Ints, node_number: Ints
) -> tuple[YarnModel, Chain]:
    """Return the model and the chains of a piece: successive EoL nodes that are all there are a yarn of it."""
    m, c = whole.model, whole.chain
    before, after = node_number[c.before[nodes]], node_number[c.after[nodes]]
    chained = ~whole.state.eil[nodes]
    first = np.flatnonzero(chained & (before < 0))
    node_yarn = np.maximum(np.searchsorted(first, np.arange(len(nodes)), side="right") - 1, 0)
    in_chain = np.flatnonzero(chained)
    model = replace(
        m, **_taken(m, m.OF_YARNS, m.node_yarn[nodes[first]]), **_taken(m, m.OF_NODES, nodes), **_taken(m, m.OF_POINTS, points),
        node_start=np.append(np.append(0, first[1:]), len(nodes)), node_yarn=node_yarn,
        node_point=point_number[m.node_point[nodes]], point_nodes=node_number[m.point_nodes[points]])
    return model, Chain(in_chain, np.append(np.searchsorted(in_chain, first), len(in_chain)), before, after)
