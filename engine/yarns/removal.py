"""Contacts that end: yarns that pull apart, or slide off each other's ends (Sánchez-Banderas 2020, sec. 5)."""

import numpy as np

from engine.arrays import Ints
from engine.yarns import inertia
from engine.yarns.model import PointKind, YarnModel, YarnState
from engine.yarns.topology import chain_of

SLIDING_KINDS = (PointKind.CROSSING, PointKind.CONTACT, PointKind.EYELET, PointKind.EDGE)
ROUND_OFF = 1e-9  # of the separation time: the time of pulling is a sum of steps


def parted(model: YarnModel, state: YarnState, separation_time: float, safety_distance: float) -> Ints:
    """Return the points that have lost their contact.

    A contact between fabrics ends when it has pulled for the `separation_time` [s]. Every sliding point ends where u
    has left the yarn; so does a crossing within a fabric, which then unravels. A yarn slips off an edge where it
    slides to one of its ends, less the `safety_distance` in rest segments: over a corner it would lie on two edges at the
    same place, and nothing could move it there.
    """
    first, second = model.point_nodes.T
    off_the_end = _outside(model, state, first) | ((second >= 0) & _outside(model, state, second))
    pulled = (state.pulling_time > 0.0) & (state.pulling_time >= (1.0 - ROUND_OFF) * separation_time)
    pulled &= model.point_kind == PointKind.CONTACT
    edge = np.flatnonzero(model.point_kind == PointKind.EDGE)
    reach = model.edge_half_length[edge] - safety_distance * model.rest_segment[model.node_yarn[first[edge]]]
    slipped = np.zeros(model.point_count, np.bool_)
    from_middle = state.x[edge] - model.edge_middle[edge]
    outwards = np.einsum("pk,pk->p", from_middle, state.x_rate[edge]) > 0.0
    slipped[edge] = outwards & (np.linalg.norm(from_middle, axis=1) > reach)
    may_end = state.active & np.isin(model.point_kind, SLIDING_KINDS)
    return np.flatnonzero(may_end & (off_the_end | pulled | slipped))


def remove(model: YarnModel, state: YarnState, points: Ints) -> None:
    """Take points out of `state`; the velocity of their yarns is projected on what is left of their meshes."""
    old = chain_of(model, state.order, state.eil, state.active)
    state.active[points] = False
    nodes = model.point_nodes[points].ravel()
    state.eil[nodes[nodes >= 0]] = False
    new = chain_of(model, state.order, state.eil, state.active)
    state.velocity = inertia.project(old, state.u, state.velocity, new, state.u)
    state.normal_force[points] = 0.0


def _outside(model, state, node):
    return (state.u[node] < 0.0) | (state.u[node] > model.length[model.node_yarn[node]])
