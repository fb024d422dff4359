"""What it does to points that the offsets of centre lines turn with the cloth (`engine.yarns.crimp`).

A centre is c = x + sum of w n over one or two crossings, n a function of the points around each of them, and w one of u. A
force on c is one on x, couples on those points by the derivatives of n, and one along the yarn. The Hessian of what acts on
centre lines becomes J^T H J
with J the derivatives of c; what the forces do in its second derivatives is left out. With J taken as the identity, as if n were
given, Newton does not converge: to tilt alternate crossings would cost nothing.
"""

import numpy as np
from numba import njit
from scipy import sparse

from engine.arrays import Floats, Ints
from engine.linalg.block_matrix import BLOCK, locate
from engine.yarns.crimp import Offsets
from engine.yarns.topology import Chain

AROUND = 5  # points that a normal depends on: its own and the next of both yarns on either side


def slopes(offsets: Offsets, x: Floats) -> tuple[Ints, Floats]:
    """Return the points that each normal depends on, shape [C, 5], and dn/dx of them, shape [C, 5, 3, 3] [1/m]."""
    crossings = len(offsets.crossings)
    around, slope = np.empty((crossings, AROUND), np.int64), np.zeros((crossings, AROUND, 3, 3))
    _slopes(offsets.crossings, offsets.point_nodes, offsets.side, offsets.before, offsets.after, offsets.node_point, x,
            around, slope)
    return around, slope


def add_couples(
    offsets: Offsets, node_slot: Ints, x: Floats, u: Floats, on_centres: Floats, on_normals: Floats, gradient: Floats
) -> None:
    """Add to the gradient [P, 5] what forces `on_centres` [N, 4] and `on_normals` [C, 3] do by changing offsets."""
    turning, weight = on_normals.copy(), offsets.weights(u)
    for s in range(2):
        np.add.at(turning, offsets.source[:, s], weight[:, s, None] * on_centres[:, :3])
    around, slope = slopes(offsets, x)
    np.add.at(gradient[:, :3], around, np.einsum("cqij,ci->cqj", slope, turning))
    nodes, of_u = along(offsets, x, u)
    np.add.at(gradient, (offsets.node_point[nodes], 3 + node_slot[nodes]), np.einsum("nqk,nk->nq", of_u, on_centres[:, :3]))


def along(offsets: Offsets, x: Floats, u: Floats) -> tuple[Ints, Floats]:
    """Return the nodes on whose u each offset depends, its own and its ends, shape [N, 3], and its derivatives [N, 3, 3]."""
    low, high = offsets.ends.T
    span = u[high] - u[low]
    rate = np.divide(1.0, span, out=np.zeros(len(u)), where=span > 0.0)
    n, share = offsets.normals(x)[offsets.source], offsets.shares(u)
    rise = offsets.height[high, None] * n[:, 1] - offsets.height[low, None] * n[:, 0]
    of_share = np.column_stack([rate, -(1.0 - share) * rate, -share * rate])
    return np.column_stack([np.arange(len(u)), low, high]), of_share[:, :, None] * rise[:, None, :]


def jacobian(offsets: Offsets, chain: Chain, node_slot: Ints, x: Floats, u: Floats) -> sparse.csr_matrix:
    """Return the derivatives of (centre, u) of the EoL nodes in the unknowns of points, shape [4 E, 5 P]."""
    around, slope = slopes(offsets, x)
    weight = offsets.weights(u)
    e, point = np.arange(len(chain.node)), offsets.node_point[chain.node]
    rows, columns, values = [4 * e + 3], [BLOCK * point + 3 + node_slot[chain.node]], [np.ones(len(e))]
    for k in range(3):
        rows.append(4 * e + k)
        columns.append(BLOCK * point + k)
        values.append(np.ones(len(e)))
    for s in range(2):
        raised = np.flatnonzero(offsets.height[offsets.ends[chain.node, s]] != 0.0)
        source, of_normal = offsets.source[chain.node[raised], s], weight[chain.node[raised], s]
        for q in range(AROUND):
            for k in range(3):
                for m in range(3):
                    rows.append(4 * raised + k)
                    columns.append(BLOCK * around[source, q] + m)
                    values.append(of_normal * slope[source, q, k, m])
    nodes, of_u = along(offsets, x, u)
    between = np.flatnonzero(offsets.ends[chain.node, 0] != offsets.ends[chain.node, 1])
    for q in range(3):
        n = nodes[chain.node[between], q]
        for k in range(3):
            rows.append(4 * between + k)
            columns.append(BLOCK * offsets.node_point[n] + 3 + node_slot[n])
            values.append(of_u[chain.node[between], q, k])
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_matrix(entries, shape=(4 * len(e), BLOCK * len(x)))


def of_centres(chain: Chain, band: Floats) -> sparse.csr_matrix:
    """Return the `band` [E, 3, 4, 4] of a Hessian in (centre, u) of the EoL nodes as a matrix [4 E, 4 E]."""
    yarn = np.repeat(np.arange(len(chain.start) - 1), np.diff(chain.start))
    rows, columns, values = [], [], []
    for d in range(3):
        e = np.flatnonzero(yarn[: len(yarn) - d] == yarn[d:])
        for r in range(4):
            for c in range(4):
                rows.append(4 * e + r)
                columns.append(4 * (e + d) + c)
                values.append(band[e, d, r, c])
                if d > 0:
                    rows.append(columns[-1])
                    columns.append(rows[-2])
                    values.append(values[-1])
    entries = np.concatenate(values).astype(np.float64), (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_matrix(entries, shape=(4 * len(yarn),) * 2)


def coupled(offsets: Offsets, chain: Chain, node_slot: Ints, x: Floats, u: Floats) -> Ints:
    """Return the pairs of points that stretch and bending of centre lines couple, shape [n, 2]."""
    j = abs(jacobian(offsets, chain, node_slot, x, u))
    j.data[:] = 1.0
    pattern = (j.T @ of_centres(chain, np.ones((len(chain.node), 3, 4, 4))) @ j).tocoo()
    pairs = np.unique(np.column_stack([pattern.row, pattern.col]) // BLOCK, axis=0)
    return pairs[pairs[:, 0] > pairs[:, 1]]


def add_hessian(
    offsets: Offsets, chain: Chain, node_slot: Ints, x: Floats, u: Floats, band: Floats, row: Ints, start: Ints, column: Ints,
    block: Floats,
) -> None:
    """Add J^T H J to the blocks of a matrix whose `row` [P] belongs to each point; `band` [E, 3, 4, 4] is H."""
    j = jacobian(offsets, chain, node_slot, x, u)
    k = (j.T @ of_centres(chain, band) @ j).tobsr((BLOCK, BLOCK))
    _add_blocks(k.indptr, k.indices, k.data, row, start, column, block)


@njit(cache=True)
def _add_blocks(block_start, block_column, values, row, start, column, block):
    for p in range(len(block_start) - 1):
        for e in range(block_start[p], block_start[p + 1]):
            k = locate(start, column, row[p], row[block_column[e]])
            for r in range(BLOCK):
                for c in range(BLOCK):
                    block[k, r, c] += values[e, r, c]


@njit(cache=True, error_model="numpy")
def _slopes(crossings, point_nodes, side, before, after, node_point, x, around, slope):
    t, of_neighbours = np.empty((2, 3)), np.empty((2, 2, 3, 3))
    n, half = np.empty(3), np.empty((3, 3))
    for c in range(len(crossings)):
        p = crossings[c]
        around[c] = p
        for s in range(2):
            i = point_nodes[p, s]
            for k in range(2):
                neighbour = before[i] if k == 0 else after[i]
                if neighbour >= 0:
                    around[c, 1 + 2 * s + k] = node_point[neighbour]
            _tangent_slopes(i, before, after, node_point, x, t[s], of_neighbours[s])
        length = 0.0
        for k in range(3):
            n[k] = t[0, (k + 1) % 3] * t[1, (k + 2) % 3] - t[0, (k + 2) % 3] * t[1, (k + 1) % 3]
            length += n[k] * n[k]
        length = np.sqrt(length)
        if not length > 1e-12:  # parallel yarns have no normal
            continue
        for k in range(3):
            n[k] /= length
        for s in range(2):
            # n = side t_0 x t_1 / |t_0 x t_1|: what a change of t_s does to it
            other, sign = t[1 - s], side[p] * (-1.0 if s == 0 else 1.0) / length
            for k in range(3):
                a, b = (k + 1) % 3, (k + 2) % 3
                for m in range(3):
                    crossed = sign * ((other[a] if m == b else 0.0) - (other[b] if m == a else 0.0))
                    half[k, m] = crossed
            for m in range(3):
                along = n[0] * half[0, m] + n[1] * half[1, m] + n[2] * half[2, m]
                for k in range(3):
                    half[k, m] -= along * n[k]
            for q in range(2):
                for k in range(3):
                    for m in range(3):
                        value = 0.0
                        for r in range(3):
                            value += half[k, r] * of_neighbours[s, q, r, m]
                        slope[c, 1 + 2 * s + q, k, m] = value
                        slope[c, 0, k, m] -= value


@njit(cache=True, error_model="numpy")
def _tangent_slopes(i, before, after, node_point, x, t, of_neighbours):
    """Write the unit tangent at node i and its derivatives in the points before and behind; that in its own is minus both."""
    d, length = np.zeros((2, 3)), np.ones(2)
    t[:] = 0.0
    of_neighbours[:] = 0.0
    for q in range(2):
        a, b = (before[i], i) if q == 0 else (i, after[i])
        if a >= 0 and b >= 0:
            square = 0.0
            for k in range(3):
                d[q, k] = x[node_point[b], k] - x[node_point[a], k]
                square += d[q, k] ** 2
            if square == 0.0:  # it has no direction, as for the tangent
                continue
            length[q] = np.sqrt(square)
            for k in range(3):
                d[q, k] /= length[q]
                t[k] += d[q, k]
    total = max(np.sqrt(t[0] ** 2 + t[1] ** 2 + t[2] ** 2), 1e-300)
    for k in range(3):
        t[k] /= total
    for q in range(2):
        if not d[q].any():
            continue
        sign = (-1.0 if q == 0 else 1.0) / (total * length[q])
        for k in range(3):
            for m in range(3):
                # (1 - t t^T) (1 - d d^T)
                both = t[0] * d[q, 0] + t[1] * d[q, 1] + t[2] * d[q, 2]
                value = (1.0 if k == m else 0.0) - t[k] * t[m] - d[q, k] * d[q, m] + t[k] * both * d[q, m]
                of_neighbours[q, k, m] = sign * value
