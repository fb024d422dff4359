"""The contact constraint at EIL nodes, as a soft one (Sánchez-Banderas 2020, secs. 3.3 and 4.2).

An EIL node b between its EoL neighbours a and c stands at X = (1 - s) x_a + s x_c, s = (u_b - u_a) / (u_c - u_a).
With g = X - X_partner the energy is m.g + k_c g.W g / 2, where W is the identity but beside held points
(`engine.yarns.leverage`); the partner is the EoL node or the fixed object at the same point, or another EIL node. The
force on X reaches the free coordinates through the Jacobian of the interpolation.

k_c makes the linear systems hard when it is large. So it is moderate, and where the gap that is left exceeds its
tolerance the multiplier m takes over the force, m <- m + k_c W g, and Newton goes on (augmented Lagrangian).

Where a node of a bent yarn becomes EIL, its yarn is straightened and leaves its partners: the gap closes within the step. m
starts as the force of the contact before.
"""

import numpy as np
from numba import njit, prange

from engine.linalg.block_matrix import BLOCK, locate


@njit(cache=True, error_model="numpy")
def add_gradient(
    points, point_nodes, eil, before, after, node_point, stiffness, shape, multiplier, x, u, gradient, gap
):
    """Add the gradient to `gradient` [N, 4], write g to `gap` [P, 3] and return the energy [J].

    `points` are the points with at least one EIL node; `stiffness` [P] is k_c, `shape` [P, 3, 3] is W,
    `multiplier` [P, 3] is m [N]. A partner that is EoL takes its share on its own node, a fixed object on the EIL node's:
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
            gap[p, k] = place[0, k] - place[1, k]
        _resist(multiplier[p], stiffness[p], shape[p], gap[p], force)
        for k in range(3):
            energy += 0.5 * (multiplier[p, k] + force[k]) * gap[p, k]
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


@njit(cache=True, error_model="numpy")
def add_hessian(
    points, point_nodes, eil, before, after, node_point, node_slot, stiffness, shape, multiplier, x, u, convex,
    sliding, row, condensed, start, column, block, inverse, coupling,
):
    """Add k_c J^T W J and, where no point of it is `convex` [P], the force times d2X.

    J is the Jacobian of g in the unknowns of up to five points.

    A point with `condensed` >= 0 has no row: its two unknowns u are eliminated, with the second derivatives `sliding`
    [P, 2, 2] of friction in them. condensed[p] is where the inverse [2, 2] of their own block and their `coupling` [2, 4, 5]
    to the four other points are kept. Returns whether those blocks are positive definite.
    """
    index, value = np.empty((3, 12), np.int64), np.empty((3, 12))
    local = np.empty((25, 25))
    point = np.empty(5, np.int64)
    place, w = np.empty((2, 3)), np.empty((2, 3))
    gap, force = np.empty(3), np.empty(3)
    positive = True
    for p in points:
        count, entries = 1, 0
        point[0] = p
        for side in range(2):
            n = point_nodes[p, side]
            sign = 1.0 if side == 0 else -1.0
            if n >= 0 and eil[n]:
                a, c = before[n], after[n]
                _interpolate(a, c, n, node_point, x, u, place[side], w[side])
                s = (u[n] - u[a]) / (u[c] - u[a])
                point[count], point[count + 1] = node_point[a], node_point[c]
                for k in range(3):
                    index[k, entries], value[k, entries] = 3 + side, sign * w[side, k]
                    index[k, entries + 1], value[k, entries + 1] = 5 * count + k, sign * (1.0 - s)
                    index[k, entries + 2], value[k, entries + 2] = 5 * (count + 1) + k, sign * s
                    index[k, entries + 3] = 5 * count + 3 + node_slot[a]
                    value[k, entries + 3] = -sign * (1.0 - s) * w[side, k]
                    index[k, entries + 4] = 5 * (count + 1) + 3 + node_slot[c]
                    value[k, entries + 4] = -sign * s * w[side, k]
                count += 2
                entries += 5
            else:
                for k in range(3):
                    index[k, entries], value[k, entries] = k, sign
                    place[side, k] = x[p, k]
                entries += 1
        size = 5 * count
        local[:size, :size] = 0.0
        for k in range(3):
            for m in range(3):
                resistance = stiffness[p] * shape[p, k, m]
                if resistance != 0.0:
                    for a in range(entries):
                        for b in range(entries):
                            local[index[k, a], index[m, b]] += resistance * value[k, a] * value[m, b]
        for k in range(3):
            gap[k] = place[0, k] - place[1, k]
        _resist(multiplier[p], stiffness[p], shape[p], gap, force)
        first = 1
        for side in range(2):
            n = point_nodes[p, side]
            if n >= 0 and eil[n]:
                a, c = before[n], after[n]
                if not (convex[p] or convex[node_point[a]] or convex[node_point[c]]):
                    sign = 1.0 if side == 0 else -1.0
                    _add_curvature(5 * first, 3 + node_slot[a], 3 + side, 3 + node_slot[c],
                                   (u[n] - u[a]) / (u[c] - u[a]), u[c] - u[a], sign, force, w[side], local)
                first += 2
        if condensed[p] >= 0:
            for r in range(2):
                for c in range(2):
                    local[3 + r, 3 + c] += sliding[p, r, c]
            positive &= _condense(local, inverse[condensed[p]], coupling[condensed[p]])
            _add_points(local, 1, count, point, row, start, column, block)
        else:
            _add_points(local, 0, count, point, row, start, column, block)
    return positive


@njit(cache=True, parallel=True, error_model="numpy")
def add_gradient_in_parts(
    points, part, point_nodes, eil, before, after, node_point, stiffness, shape, multiplier, x, u, gradient, gap
):
    """As `add_gradient`, with the parts points[part[s]:part[s+1]], which share no node, at once and the rest after them."""
    parts = len(part) - 1
    energy = np.zeros(parts)
    for s in prange(parts):
        energy[s] = add_gradient(points[part[s] : part[s + 1]], point_nodes, eil, before, after, node_point, stiffness,
                                 shape, multiplier, x, u, gradient, gap)
    total = add_gradient(points[part[parts] :], point_nodes, eil, before, after, node_point, stiffness, shape, multiplier,
                         x, u, gradient, gap)
    for s in range(parts):
        total += energy[s]
    return total


@njit(cache=True, parallel=True, error_model="numpy")
def add_hessian_in_parts(
    points, part, point_nodes, eil, before, after, node_point, node_slot, stiffness, shape, multiplier, x, u, convex,
    sliding, row, condensed, start, column, block, inverse, coupling,
):
    """As `add_hessian`, with the parts points[part[s]:part[s+1]], which share no row, at once and the rest after them."""
    parts = len(part) - 1
    positive = np.ones(parts + 1, np.bool_)
    for s in prange(parts):
        positive[s] = add_hessian(
            points[part[s] : part[s + 1]], point_nodes, eil, before, after, node_point, node_slot, stiffness, shape,
            multiplier, x, u, convex, sliding, row, condensed, start, column, block, inverse, coupling)
    positive[parts] = add_hessian(
        points[part[parts] :], point_nodes, eil, before, after, node_point, node_slot, stiffness, shape, multiplier,
        x, u, convex, sliding, row, condensed, start, column, block, inverse, coupling)
    return positive.all()


@njit(cache=True)
def _resist(multiplier, stiffness, shape, gap, force):
    """Write m + k_c W g of one contact to `force` [3] [N]."""
    for k in range(3):
        force[k] = multiplier[k] + stiffness * (shape[k, 0] * gap[0] + shape[k, 1] * gap[1] + shape[k, 2] * gap[2])


@njit(cache=True, error_model="numpy")
def _add_points(local, first, count, point, row, start, column, block):
    for a in range(first, count):
        for b in range(first, count):
            k = locate(start, column, row[point[a]], row[point[b]])
            for r in range(BLOCK):
                for c in range(BLOCK):
                    block[k, r, c] += local[5 * a + r, 5 * b + c]


@njit(cache=True, error_model="numpy")
def _condense(local, inverse, coupling):
    """Eliminate the unknowns 3 and 4 of a local matrix from those of the other four points."""
    a, b, d = local[3, 3], local[3, 4], local[4, 4]
    determinant = a * d - b * b
    if not (a > 0.0 and determinant > 1e-12 * a * d):
        return False
    inverse[0, 0], inverse[0, 1], inverse[1, 0], inverse[1, 1] = (
        d / determinant, -b / determinant, -b / determinant, a / determinant)
    for j in range(5, 25):
        q, c = j // 5 - 1, j % 5
        coupling[0, q, c], coupling[1, q, c] = local[3, j], local[4, j]
    for j in range(5, 25):
        v0, v1 = local[3, j], local[4, j]
        if v0 == 0.0 and v1 == 0.0:
            continue
        f0, f1 = inverse[0, 0] * v0 + inverse[0, 1] * v1, inverse[1, 0] * v0 + inverse[1, 1] * v1
        for i in range(5, 25):
            local[i, j] -= local[3, i] * f0 + local[4, i] * f1
    return True


@njit(cache=True, error_model="numpy")
def condense_load(points, condensed, others, row, inverse, coupling, load, reduced):
    """Take the load [P, 5] on the eliminated unknowns of `points` over to the rows of their `others` [C, 4]: `reduced` [R, 5]."""
    for p in points:
        e = condensed[p]
        if e < 0:
            continue
        l0, l1 = load[p, 3], load[p, 4]
        f0, f1 = inverse[e, 0, 0] * l0 + inverse[e, 0, 1] * l1, inverse[e, 1, 0] * l0 + inverse[e, 1, 1] * l1
        for q in range(4):
            i = row[others[e, q]]
            for c in range(BLOCK):
                reduced[i, c] -= coupling[e, 0, q, c] * f0 + coupling[e, 1, q, c] * f1


@njit(cache=True, error_model="numpy")
def expand(points, condensed, others, inverse, coupling, load, solution):
    """Write the eliminated unknowns of `points` to the solution [P, 5], whose other points are known."""
    for p in points:
        e = condensed[p]
        if e < 0:
            continue
        l0, l1 = load[p, 3], load[p, 4]
        for q in range(4):
            for c in range(BLOCK):
                l0 -= coupling[e, 0, q, c] * solution[others[e, q], c]
                l1 -= coupling[e, 1, q, c] * solution[others[e, q], c]
        solution[p, 3] = inverse[e, 0, 0] * l0 + inverse[e, 0, 1] * l1
        solution[p, 4] = inverse[e, 1, 0] * l0 + inverse[e, 1, 1] * l1


@njit(cache=True, error_model="numpy")
def _add_curvature(first, u_a, u_b, u_c, s, du, sign, force, w, local):
    """Add sign force . d2X for X = (1 - s) x_a + s x_c, s = (u_b - u_a) / (u_c - u_a), to the local matrix.

    `first` is the first unknown of the point of a; the point of c comes behind it. u_a and u_c are the slots of their u.
    """
    along = 0.0
    for k in range(3):
        along += sign * force[k] * w[k]
    place = (first + u_a, u_b, first + BLOCK + u_c)
    towards_c = (-(1.0 - s) / du, 1.0 / du, -s / du)  # ds / du of each node
    for m in range(3):
        # d2X / (dx du): s moves from x_a to x_c
        for k in range(3):
            for x_k, weight in ((first + k, -towards_c[m]), (first + BLOCK + k, towards_c[m])):
                local[x_k, place[m]] += weight * sign * force[k]
                local[place[m], x_k] += weight * sign * force[k]
    # d2X / (du du) = w times the second derivatives of (u_c - u_a) s at fixed ends
    second = (
        (-2.0 * (1.0 - s) / du, 1.0 / du, (1.0 - 2.0 * s) / du),
        (1.0 / du, 0.0, -1.0 / du),
        ((1.0 - 2.0 * s) / du, -1.0 / du, 2.0 * s / du),
    )
    for m in range(3):
        for q in range(3):
            local[place[m], place[q]] += along * second[m][q]


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def _interpolate(a, c, b, node_point, x, u, place, w):
    """Write X at u_b and w = dX/du between the EoL neighbours a and c."""
    p, q = node_point[a], node_point[c]
    du = u[c] - u[a]
    for k in range(3):
        w[k] = (x[q, k] - x[p, k]) / du
        place[k] = x[p, k] + (u[b] - u[a]) * w[k]
