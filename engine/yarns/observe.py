"""What one reads off a state: curves and nodes for pictures, counts, energies, momentum."""

import numpy as np

from engine.arrays import Floats
from engine.yarns import bending, shear, stretch, weave_set
from engine.yarns.crimp import centre_lines
from engine.yarns.model import NodeState, PointKind, YarnModel, YarnState
from engine.yarns.topology import Chain, chain_of

ROUNDING = 1e-3  # share of the thinnest yarn's radius that rounding in frames may move a point


def chain_now(model: YarnModel, state: YarnState) -> Chain:
    """Return the chains of the state's present assignment."""
    return chain_of(model, state.order, state.eil, state.active)


def node_states(model: YarnModel, state: YarnState) -> Floats:
    """Return the `NodeState` of every point, shape [P]."""
    first, second = model.point_nodes.T
    eil = state.eil[first].astype(np.int64) + ((second >= 0) & state.eil[second])
    lone_eil = (second < 0) & (eil == 1)
    states = np.where(eil == 0, NodeState.EOL, np.where(eil == 1, NodeState.EOL_EIL, NodeState.EIL_EIL))
    states[lone_eil] = NodeState.EIL_EIL
    states[model.point_kind == PointKind.LAGRANGIAN] = NodeState.LAGRANGIAN
    states[~state.active] = NodeState.REMOVED
    return states.astype(np.uint8)


def yarn_frame_arrays(model: YarnModel, state: YarnState) -> dict:
    """Return the arrays of a frame: polylines through the nodes in use with their strain, points with their states.

    EIL nodes lie where they are interpolated between EoL nodes: they bend no line, and say where yarns cross. Lengths
    and positions are rounded to float32 where that moves nothing by more than ROUNDING radii, strains always.
    """
    chain = chain_now(model, state)
    line = chain_of(model, state.order, np.zeros_like(state.eil), state.active)
    eil = state.eil[line.node]
    before, after = (np.where(eil, end[line.node], line.node) for end in (chain.before, chain.after))
    span = state.u[after] - state.u[before]
    share = np.divide(state.u[line.node] - state.u[before], span, out=np.zeros(len(span)), where=span > 0.0)
    xa, xb = state.x[model.node_point[before]], state.x[model.node_point[after]]
    strains = np.zeros(model.node_count)
    strains[chain.node] = strain(model, state)
    states = node_states(model, state)
    shown = np.flatnonzero(states != NodeState.REMOVED)
    return dict(
        line_positions=_rounded((1.0 - share)[:, None] * xa + share[:, None] * xb, model.radius),
        line_offsets=line.start,
        line_strain=((1.0 - share) * strains[before] + share * strains[after]).astype(np.float32),
        line_points=model.node_point[line.node].astype(np.int32), radius=model.radius, fabric=model.fabric,
        node_positions=_rounded(state.x[shown], model.radius), node_states=states[shown],
        node_points=shown.astype(np.int32), u=_rounded(state.u, model.radius),
    )


def _rounded(values: Floats, radius: Floats) -> Floats:
    """Return lengths [m] as float32 where that is precise enough for yarns of these radii, else as they are."""
    error = np.finfo(np.float32).eps / 2 * np.abs(values).max(initial=0.0)
    return values.astype(np.float32) if error <= ROUNDING * radius.min(initial=np.inf) else values.copy()


def strain(model: YarnModel, state: YarnState) -> Floats:
    """Return lambda - 1 at the chain's nodes, the mean of both segments, shape [E]."""
    chain = chain_now(model, state)
    total = np.zeros(len(chain.node))
    count = np.zeros(len(chain.node))
    i, j = chain.node[:-1], chain.node[1:]
    joined = np.flatnonzero(model.node_yarn[i] == model.node_yarn[j])
    lines = centre_lines(model, state, chain)
    centre = lines.through(state.x, state.u)
    edge = centre[lines.place[j[joined]]] - centre[lines.place[i[joined]]]
    value = np.linalg.norm(edge, axis=1) / (state.u[j[joined]] - state.u[i[joined]]) - 1.0
    for end in (joined, joined + 1):
        np.add.at(total, end, value)
        np.add.at(count, end, 1.0)
    return total / np.maximum(count, 1.0)


def counts(model: YarnModel, state: YarnState) -> dict[str, int]:
    """Return how many points there are of each kind, as Table 1 of Sánchez-Banderas 2020 counts them."""
    states = node_states(model, state)
    first, second = model.fabric[model.node_yarn[model.point_nodes]].T
    stitch = model.point_kind == PointKind.STITCH
    seam = stitch & (first != second)
    inner = (model.point_kind == PointKind.CROSSING) | (stitch & ~seam)
    outer = np.isin(model.point_kind, (PointKind.CONTACT, PointKind.EYELET, PointKind.EDGE)) | seam
    return dict(
        lagrangian=int(np.sum(states == NodeState.LAGRANGIAN)),
        eol_intra=int(np.sum(state.active & inner)),
        eol_inter=int(np.sum(state.active & outer)),
        eil=int(np.sum((states == NodeState.EOL_EIL) | (states == NodeState.EIL_EIL))),
    )


def energies(model: YarnModel, state: YarnState, gravity: Floats) -> dict[str, float]:
    """Return kinetic energy and potential energy (stretch, bending, shear, weight) [J]; the weight's zero is at the origin."""
    chain = chain_now(model, state)
    i, j, du, rho = _segments(model, state, chain)
    a, b = state.velocity[i, 1], state.velocity[j, 0]
    kinetic = np.sum(rho * du / 6.0 * np.sum(a * a + a * b + b * b, axis=1))
    xa, xb = state.x[model.node_point[i]], state.x[model.node_point[j]]
    weight = -np.sum(rho * du * 0.5 * ((xa + xb) @ np.asarray(gravity)))
    unused = np.zeros((model.node_count, 4))
    elastic = 0.0
    lines = centre_lines(model, state, chain)
    centre = lines.through(state.x, state.u)
    for y, nodes in enumerate(np.split(chain.node, chain.start[1:-1])):
        elastic += stretch.add_gradient(nodes, lines.place, model.stretch_stiffness[y], 0.0, 1.0, centre, state.u,
                                        centre, state.u, unused)
        elastic += bending.add_gradient(nodes, lines.place, model.bending_stiffness[y], centre, state.u, unused)
    if lines.offsets is not None:
        normals = lines.offsets.normals(state.x)
        elastic += weave_set.add_gradient(
            weave_set.set_nodes(model, chain), chain.before, chain.after, model.node_yarn, model.bending_stiffness,
            model.set_angle, model.set_rise, lines.offsets.source, normals, centre, state.u, unused, np.zeros_like(normals))
    elastic += shear.add_gradient(shear.sheared(model, state), model.point_nodes, state.eil, chain.before, chain.after,
                                  model.node_point, shear.stiffness(model), shear.free_angle(model), state.x, unused)
    return dict(kinetic=float(kinetic), potential=float(elastic + weight))


def momentum(model: YarnModel, state: YarnState) -> Floats:
    """Return the linear momentum of all yarns, shape [3] [kg m/s]."""
    i, j, du, rho = _segments(model, state, chain_now(model, state))
    return np.sum((0.5 * rho * du)[:, None] * (state.velocity[i, 1] + state.velocity[j, 0]), axis=0)


def _segments(model, state, chain):
    i = chain.node[chain.after[chain.node] >= 0]
    i = i[~model.kinematic[model.node_yarn[i]]]
    j = chain.after[i]
    return i, j, state.u[j] - state.u[i], model.density[model.node_yarn[i]]
