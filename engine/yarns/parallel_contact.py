"""Contact of parallel yarns: neighbours in a weave do not slide through each other (Sánchez-Banderas 2020, sec. 4.2).

Between successive crossings of one fabric along a yarn, at the distance Du along it,

    V = k (d_min - Du)^2 / 2 where Du < d_min,

with k a multiple of k_s / L. Of the yarns crossed, of radius R like this one, those on the same side touch at d_min = 2 R;
where one is below and the other above, the yarn passes between them: d_min = 4 R. V depends on u alone.

In thick weaves, as the paper's tablecloths (R = 2.25 mm, spacing 5.6 mm), 4 R is more than the spacing, which the model's
straight yarns have without their crimp. A weave at rest must be free of force, so d_min is at most a share of the spacing.

Off where (a) a node is a contact with another fabric: such nodes are passed over, as if they were not there; and where
(b) the yarns crossed lie on different sides and neither bends around this one, so that they may pass each other. A yarn
bends around it where the mean direction to its crossings on both sides, on their true height above or below the nodes,
points towards it by more than a threshold. All this is decided at the start of a step.
"""

import numpy as np
from numba import njit

from engine.arrays import Flags, Floats, Ints
from engine.linalg.block_matrix import locate
from engine.yarns.model import PointKind, YarnModel, YarnState
from engine.yarns.normal_force import tangent
from engine.yarns.topology import Chain

SHARE = 0.8  # of the spacing, below which parallel yarns touch at the latest
WITHIN_REACH = 1.1  # d_min times this, within which a pair counts as close enough to touch in a step
BENDS = 0.25  # part of the mean direction that points towards a yarn which is bent around (sec. 4.2)


def touching_pairs(model: YarnModel, state: YarnState, chain: Chain) -> tuple[Ints, Floats]:
    """Return the pairs of nodes that may touch, in the order of u, shape [n, 2], and their d_min, shape [n] [m]."""
    woven = state.active & (model.point_kind == PointKind.CROSSING)
    woven &= model.fabric[model.node_yarn[model.point_nodes[:, 0]]] >= 0
    before, after = (np.full(model.node_count, -1, np.int64) for _ in range(2))
    first = np.empty(model.node_count, np.int64)
    count = _neighbours(state.order, woven, model.node_point, model.node_yarn, before, after, first)
    bends = np.zeros(model.node_count, np.bool_)
    _bends_around(np.flatnonzero(woven), model.point_nodes, model.side, model.node_point, model.node_slot, model.node_yarn,
                  model.radius, chain.before, chain.after, before, after, state.x, state.u, bends)
    first = first[:count]
    pair = np.column_stack([first, after[first]])
    # of each of both: its slot is the side on which this yarn lies, and the other node there that of the yarn crossed
    crossed = model.point_nodes[model.node_point[pair], 1 - model.node_slot[pair]]
    apart = model.node_slot[pair[:, 0]] != model.node_slot[pair[:, 1]]
    yarn = model.node_yarn[first]
    distance = model.radius[model.node_yarn[crossed]].sum(axis=1) + np.where(apart, 2.0 * model.radius[yarn], 0.0)
    on = ~apart | bends[crossed].any(axis=1)
    return pair[on], np.minimum(distance, SHARE * model.crossing_spacing[yarn])[on]


def within_reach(pair: Ints, distance: Floats, u: Floats, u_rate: Floats, h: float) -> Flags:
    """Return which pairs may touch within a step h [s], though they close in twice as fast as in the last one, shape [n]."""
    i, j = pair.T
    return u[j] - u[i] - 2.0 * h * np.maximum(u_rate[i] - u_rate[j], 0.0) < WITHIN_REACH * distance


@njit(cache=True)
def _neighbours(order, woven, node_point, node_yarn, before, after, first):
    """Link successive crossings along each yarn; returns how many have one behind them, which `first` lists."""
    count, last = 0, -1
    for i in order:
        if woven[node_point[i]]:
            if last >= 0 and node_yarn[last] == node_yarn[i]:
                before[i], after[last] = last, i
                first[count] = last
                count += 1
            last = i
    return count


@njit(cache=True)
def _bends_around(
    points, point_nodes, side, node_point, node_slot, node_yarn, radius, chain_before, chain_after, before, after, x, u,
    bends,
):
    """Flag in `bends` [N] the nodes at which a yarn bends around the one that it crosses there."""
    tangents, normals = np.zeros((2, 3)), np.zeros((len(side), 3))
    for p in points:
        for slot in range(2):
            tangent(point_nodes[p, slot], chain_before, chain_after, node_point, x, u, tangents[slot])
        _normal(side[p], tangents[0], tangents[1], normals[p])
    for p in points:
        for slot in range(2):
            i = point_nodes[p, slot]
            towards = 1.0 if slot == 0 else -1.0  # the normal points from the yarn of slot 0 to the other
            rise, count = 0.0, 0
            for j in (before[i], after[i]):
                if j < 0:
                    continue
                q, height = node_point[j], (2.0 * node_slot[j] - 1.0) * radius[node_yarn[i]]
                square = along = 0.0
                for k in range(3):
                    edge = x[q, k] + height * normals[q, k] - x[p, k] + towards * radius[node_yarn[i]] * normals[p, k]
                    square += edge * edge
                    along += edge * normals[p, k]
                rise += towards * along / max(np.sqrt(square), 1e-100)
                count += 1
            bends[i] = count > 0 and rise > BENDS * count


@njit(cache=True)
def _normal(side, t0, t1, n):
    length = 0.0
    for k in range(3):
        n[k] = side * (t0[(k + 1) % 3] * t1[(k + 2) % 3] - t0[(k + 2) % 3] * t1[(k + 1) % 3])
        length += n[k] * n[k]
    for k in range(3):
        n[k] /= max(np.sqrt(length), 1e-100)


@njit(cache=True)
def add_gradient(pair, distance, stiffness, u, gradient):
    """Add the gradient to `gradient` [N, 4] and return the energy [J].

    `pair` [n, 2] and `distance` [n] are of `touching_pairs`, those within reach; `stiffness` [N] is k of the nodes' yarns [N/m].
    """
    energy = 0.0
    for e in range(len(pair)):
        i, j = pair[e, 0], pair[e, 1]
        overlap = distance[e] - (u[j] - u[i])
        if overlap > 0.0:
            energy += 0.5 * stiffness[i] * overlap * overlap
            gradient[i, 3] += stiffness[i] * overlap
            gradient[j, 3] -= stiffness[i] * overlap
    return energy


@njit(cache=True)
def add_hessian(pair, distance, stiffness, node_point, node_slot, u, row, start, column, block):
    """Add the Hessian, which is nowhere negative; `row` [P] are the points' rows."""
    for e in range(len(pair)):
        i, j = pair[e, 0], pair[e, 1]
        if distance[e] - (u[j] - u[i]) <= 0.0:
            continue
        for a in range(2):
            for b in range(2):
                k = locate(start, column, row[node_point[pair[e, a]]], row[node_point[pair[e, b]]])
                block[k, 3 + node_slot[pair[e, a]], 3 + node_slot[pair[e, b]]] += stiffness[i] if a == b else -stiffness[i]
