"""Which nodes are EoL and which EIL: the assignment that precedes every step (Sánchez-Banderas 2020, sec. 4.1)."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from engine.arrays import Flags, Floats, Ints
from engine.yarns.crimp import centre_lines
from engine.yarns.model import PointKind, YarnModel, YarnState

OPEN = 0.01  # radii: contacts with a wider gap have not met yet


@dataclass
class Chain:
    """The EoL nodes of every yarn in order: what carries internal forces and inertia."""

    node: Ints  # EoL nodes, yarn after yarn, shape [E]
    start: Ints  # EoL nodes of yarn y are node[start[y]] ... node[start[y+1]-1], shape [Y+1]
    before: Ints  # the nearest EoL node before each active node, -1 at a yarn's first, shape [N]
    after: Ints  # the nearest EoL node behind each active node, -1 at a yarn's last, shape [N]


def assign(model: YarnModel, state: YarnState, safety_distance: float, h: float, rates: Floats) -> None:
    """Sort the nodes of every yarn by u and choose the EIL nodes; writes `state.order` and `state.eil`.

    `safety_distance` is in rest segments. Two nodes that close in on each other count as nearer by what they will
    travel within the step `h` [s], at their last rates or the expected `rates` of u [N] [m/s], so that they do not pass
    each other as EoL nodes.

    Beyond the paper, of two contacts the one becomes EIL whose yarn is straighter there, since that moves its yarn least;
    one that is EIL stays so. A discretisation point that nothing holds gives way to a contact that comes close: it rests
    on the segment until the contact has passed. A contact that has just begun stays EIL until its yarns have met: as EoL
    node it would move them there at once.
    """
    kink = kinks(model, state, chain_of(model, state.order, state.eil, state.active))
    # in whole millionths of a radius, so that round-off does not decide between straight yarns
    kink = np.round(kink / (1e-6 * model.radius[model.node_yarn]))
    _assign(model.node_start, model.rest_segment, model.kinematic, model.node_point, standing(model), kink, _open(model, state),
            state.active, state.u, state.u_rate, rates, h, safety_distance, state.order, state.eil)


def standing(model: YarnModel) -> Ints:
    """Return which node gives way to which when two come close, shape [N].

    2: a fixed coordinate that must stay (an end, a pin, a stitch); 1: a contact; 0: a point that only discretises.
    """
    inside = np.ones(model.node_count, np.bool_)
    inside[model.node_start[:-1]] = False
    inside[model.node_start[1:] - 1] = False
    free = (model.free_directions == np.eye(3)).all(axis=(1, 2)) & (model.point_kind == PointKind.LAGRANGIAN)
    gives_way = inside & free[model.node_point] & ~model.kinematic[model.node_yarn]
    return np.where(gives_way, 0, np.where(model.u_fixed, 2, 1))


def _open(model: YarnModel, state: YarnState) -> Flags:
    """EIL nodes of contacts between fabrics whose gap is still open, shape [N]."""
    wide = np.linalg.norm(state.gap, axis=1) > OPEN * model.radius[model.node_yarn[model.point_nodes[:, 0]]]
    return state.eil & (wide & (model.point_kind == PointKind.CONTACT))[model.node_point]


def kinks(model: YarnModel, state: YarnState, chain: Chain) -> Floats:
    """Return how far each EoL node is from the line between its neighbours, at its u, shape [N] [m]; 0 for the others."""
    inner = chain.node[(chain.before[chain.node] >= 0) & (chain.after[chain.node] >= 0)]
    before, after = chain.before[inner], chain.after[inner]
    span = state.u[after] - state.u[before]
    share = np.divide(state.u[inner] - state.u[before], span, out=np.zeros(len(inner)), where=span > 0.0)[:, None]
    lines = centre_lines(model, state, chain)
    centre, at = lines.through(state.x, state.u), lines.place
    between = (1.0 - share) * centre[at[before]] + share * centre[at[after]]
    kink = np.zeros(model.node_count)
    kink[inner] = np.linalg.norm(centre[at[inner]] - between, axis=1)
    return kink


def chain_of(model: YarnModel, order: Ints, eil: Flags, active: Flags) -> Chain:
    """Return the chains of EoL nodes for a given order, assignment and set of active points."""
    before = np.full(model.node_count, -1, np.int64)
    after = np.full(model.node_count, -1, np.int64)
    node = np.empty(model.node_count, np.int64)
    start = np.zeros(model.yarn_count + 1, np.int64)
    length = _link(model.node_start, model.node_point, order, eil, active, node, start, before, after)
    return Chain(node[:length].copy(), start, before, after)


@njit(cache=True)
def _assign(node_start, rest_segment, kinematic, node_point, standing, kink, open_gap, active, u, u_rate, rates, h,
            safety_distance, order, eil):
    for y in range(len(rest_segment)):
        nodes = order[node_start[y] : node_start[y + 1]]
        for a in range(1, len(nodes)):  # insertion sort: stable, and linear on what is nearly sorted
            node = nodes[a]
            b = a - 1
            while b >= 0 and u[nodes[b]] > u[node]:
                nodes[b + 1] = nodes[b]
                b -= 1
            nodes[b + 1] = node
        distance = safety_distance * rest_segment[y]
        last = -1  # position in `nodes` of the last EoL node
        for a in range(len(nodes)):
            node = nodes[a]
            eil[node] = False
            if not active[node_point[node]]:
                continue
            if kinematic[y]:
                eil[node] = standing[node] < 2
                continue
            if open_gap[node]:
                eil[node] = True
                continue
            while last >= 0 and _apart(u, u_rate, rates, nodes[last], node, h) < distance:
                gives_way = standing[node] < standing[nodes[last]] or (
                    standing[node] == standing[nodes[last]] and kink[node] <= kink[nodes[last]])
                if standing[node] < 2 and gives_way:
                    eil[node] = True
                    break
                if standing[nodes[last]] == 2:
                    break
                eil[nodes[last]] = True
                last = _previous_eol(nodes, last, eil, active, node_point)
            if not eil[node]:
                last = a


@njit(cache=True)
def _apart(u, u_rate, rates, i, j, h):
    now = u[j] - u[i]
    return now + h * min(0.0, u_rate[j] - u_rate[i], rates[j] - rates[i])


@njit(cache=True)
def _previous_eol(nodes, position, eil, active, node_point):
    position -= 1
    while position >= 0 and (eil[nodes[position]] or not active[node_point[nodes[position]]]):
        position -= 1
    return position


@njit(cache=True)
def _link(node_start, node_point, order, eil, active, node, start, before, after):
    length = 0
    for y in range(len(start) - 1):
        last = -1
        first, end = node_start[y], node_start[y + 1]
        for a in range(first, end):
            i = order[a]
            if active[node_point[i]]:
                before[i] = last
                if not eil[i]:
                    node[length] = i
                    length += 1
                    last = i
        start[y + 1] = length
        last = -1
        for a in range(end - 1, first - 1, -1):
            i = order[a]
            if active[node_point[i]]:
                after[i] = last
                if not eil[i]:
                    last = i
    return length
