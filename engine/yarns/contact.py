"""The contact constraint at EIL nodes, as a soft one (Sánchez-Banderas 2020, secs. 3.3 and 4.2).

An EIL node b between its EoL neighbours a and c stands at X = (1 - s) x_a + s x_c, s = (u_b - u_a) / (u_c - u_a).
With g = X - X_partner - o the energy is m.g + k_c |g|^2 / 2; the partner is the EoL node or the fixed object at
the same point, or another EIL node. The force on X reaches the free coordinates through the Jacobian of the interpolation.

k_c makes the linear systems hard when it is large. So it is moderate, and where the gap that is left exceeds its
tolerance the multiplier m takes over the force, m <- m + k_c g, and Newton goes on (augmented Lagrangian).

Where a node of a bent yarn becomes EIL, its yarn is straightened and leaves its partners. The offset o takes up that jump
of the gap, and m starts as the force of the contact before, so that neither the constraint's force nor its energy jumps;
o then fades.
"""

import numpy as np
from numba import njit

from engine.linalg.block_matrix import BLOCK, locate
from engine.yarns.model import PointKind, YarnModel, YarnState
from engine.yarns.topology import Chain


def absorb_jumps(model: YarnModel, state: YarnState, chain: Chain) -> None:
    """Add to the offsets what a new assignment, whose chain is given, has changed in the gaps of EIL contacts."""
    first, second = model.point_nodes.T
    has_eil = (state.eil[first] | ((second >= 0) & state.eil[second])) & (model.point_kind != PointKind.LAGRANGIAN)
    points = np.flatnonzero(has_eil & state.active)
    gap = np.zeros((model.point_count, 3))
    add_gradient(points, model.point_nodes, state.eil, chain.before, chain.after, model.node_point,
                 np.zeros(model.point_count), np.zeros_like(gap), np.zeros_like(gap), state.x, state.u,
                 np.zeros((model.node_count, 4)), gap)
    jump = gap[points] - state.gap[points]
    offset = state.gap_offset[points] + jump
    state.gap_offset[:] = 0.0
    state.gap_offset[points] = offset


@njit(cache=True)
def add_gradient(points, point_nodes, eil, before, after, node_point, stiffness, multiplier, offset, x, u, gradient, gap):
    """Add the gradient to `gradient` [N, 4], write g to `gap` [P, 3] and return the energy [J].

    `points` are the points with at least one EIL node; `stiffness` [P] is k_c, `multiplier` [P, 3] is m [N],
    `offset` [P, 3] is o [m]. A partner that is EoL takes its share on its own node, a fixed object on the EIL node's:
    both end up on the point.
    """
    energy = 0.0
    place, w = np.empty((2, 3)), np.empty((2, 3))
    force = np.empty(3)
    for p in points:
        n0, n1 = point_nodes[p, 0], point_nodes[p, 1]
        e0, e1 = eil[n0], n1 >= 0 and eil[n1]
        for side in range(2):
            n = n0 if side == 0 else n1
            if n >= 0 and eil[n]:
                _interpolate(before[n], after[n], n, node_point, x, u, place[side], w[side])
            else:
                for k in range(3):
                    place[side, k] = x[p, k]
        for k in range(3):
            gap[p, k] = place[0, k] - place[1, k] - offset[p, k]
            force[k] = multiplier[p, k] + stiffness[p] * gap[p, k]
            energy += (multiplier[p, k] + 0.5 * stiffness[p] * gap[p, k]) * gap[p, k]
        for side in range(2):
            sign = 1.0 if side == 0 else -1.0
            if (e0 if side == 0 else e1):
                n = n0 if side == 0 else n1
                a, c = before[n], after[n]
                s = (u[n] - u[a]) / (u[c] - u[a])
                for k in range(3):
                    f = sign * force[k]
                    gradient[a, k] += (1.0 - s) * f
                    gradient[c, k] += s * f
                    gradient[a, 3] -= (1.0 - s) * f * w[side, k]
                    gradient[c, 3] -= s * f * w[side, k]
                    gradient[n, 3] += f * w[side, k]
            else:
                n = n1 if side == 1 and n1 >= 0 else n0
                for k in range(3):
                    gradient[n, k] += sign * force[k]
    return energy


@njit(cache=True)
def add_hessian(
    points, point_nodes, eil, before, after, node_point, node_slot, stiffness, multiplier, offset, x, u, convex,
    start, column, block,
):
    """Add k_c J^T J and, unless `convex`, (m + k_c g).d2X; J is the Jacobian of g in the unknowns of up to five points."""
    jacobian = np.empty((5, 3, BLOCK))
    point = np.empty(5, np.int64)
    place, w = np.empty((2, 3)), np.empty((2, 3))
    force = np.empty(3)
    for p in points:
        count = 1
        point[0] = p
        jacobian[:] = 0.0
        for side in range(2):
            n = point_nodes[p, side]
            sign = 1.0 if side == 0 else -1.0
            if n >= 0 and eil[n]:
                a, c = before[n], after[n]
                _interpolate(a, c, n, node_point, x, u, place[side], w[side])
                s = (u[n] - u[a]) / (u[c] - u[a])
                point[count], point[count + 1] = node_point[a], node_point[c]
                for k in range(3):
                    jacobian[0, k, 3 + side] = sign * w[side, k]
                    jacobian[count, k, k] = sign * (1.0 - s)
                    jacobian[count + 1, k, k] = sign * s
                    jacobian[count, k, 3 + node_slot[a]] = -sign * (1.0 - s) * w[side, k]
                    jacobian[count + 1, k, 3 + node_slot[c]] = -sign * s * w[side, k]
                count += 2
            else:
                for k in range(3):
                    jacobian[0, k, k] = sign
                    place[side, k] = x[p, k]
        for a in range(count):
            for b in range(count):
                k = locate(start, column, point[a], point[b])
                for r in range(BLOCK):
                    for c in range(BLOCK):
                        product = 0.0
                        for m in range(3):
                            product += jacobian[a, m, r] * jacobian[b, m, c]
                        block[k, r, c] += stiffness[p] * product
        for side in range(2):
            n = point_nodes[p, side]
            if n >= 0 and eil[n] and not convex:
                sign = 1.0 if side == 0 else -1.0
                for k in range(3):
                    force[k] = sign * (multiplier[p, k] + stiffness[p] * (place[0, k] - place[1, k] - offset[p, k]))
                _add_curvature(n, before[n], after[n], force, w[side], node_point, node_slot, u, start, column, block)


@njit(cache=True)
def _add_curvature(b, a, c, force, w, node_point, node_slot, u, start, column, block):
    """Add force . d2X for X = (1 - s) x_a + s x_c, s = (u_b - u_a) / (u_c - u_a)."""
    du = u[c] - u[a]
    s = (u[b] - u[a]) / du
    along = 0.0
    for k in range(3):
        along += force[k] * w[k]
    nodes = (a, b, c)
    towards_c = (-(1.0 - s) / du, 1.0 / du, -s / du)  # ds / du of each node
    for m in range(3):
        # d2X / (dx du): s moves from x_a to x_c
        for q, weight in ((a, -towards_c[m]), (c, towards_c[m])):
            k = locate(start, column, node_point[q], node_point[nodes[m]])
            mirrored = locate(start, column, node_point[nodes[m]], node_point[q])
            column_u = 3 + node_slot[nodes[m]]
            for r in range(3):
                block[k, r, column_u] += weight * force[r]
                block[mirrored, column_u, r] += weight * force[r]
    # d2X / (du du) = w times the second derivatives of (u_c - u_a) s at fixed ends
    second = (
        (-2.0 * (1.0 - s) / du, 1.0 / du, (1.0 - 2.0 * s) / du),
        (1.0 / du, 0.0, -1.0 / du),
        ((1.0 - 2.0 * s) / du, -1.0 / du, 2.0 * s / du),
    )
    for m in range(3):
        for q in range(3):
            k = locate(start, column, node_point[nodes[m]], node_point[nodes[q]])
            block[k, 3 + node_slot[nodes[m]], 3 + node_slot[nodes[q]]] += along * second[m][q]


@njit(cache=True)
def place_eil(points, point_nodes, before, after, node_point, x, u):
    """Move the cancelled x of `points`, which have EIL nodes only, to the middle of what their yarns interpolate there."""
    place, w = np.empty(3), np.empty(3)
    for p in points:
        x[p] = 0.0
        share = 1.0 if point_nodes[p, 1] < 0 else 0.5
        for n in point_nodes[p]:
            if n >= 0:
                _interpolate(before[n], after[n], n, node_point, x, u, place, w)
                for k in range(3):
                    x[p, k] += share * place[k]


@njit(cache=True)
def _interpolate(a, c, b, node_point, x, u, place, w):
    """Write X at u_b and w = dX/du between the EoL neighbours a and c."""
    p, q = node_point[a], node_point[c]
    du = u[c] - u[a]
    for k in range(3):
        w[k] = (x[q, k] - x[p, k]) / du
        place[k] = x[p, k] + (u[b] - u[a]) * w[k]
