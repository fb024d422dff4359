"""Newton's direction of strands in contact: conjugate gradients, preconditioned by the factor of every strand by itself.

The Hessian is M + B, where M has each strand with its own ends of contacts, as if the other side of these stood still, and B
what couples the two sides. M is banded and is factorised; with M z = r the products M p follow from the residuals, as p follows
from z, so that only B is ever multiplied with anything. Without contacts between strands B is nothing, and M is exact.
"""

import numpy as np
from numba import njit, prange

from engine.linalg import banded

INEXACT = 0.03  # residual of conjugate gradients, over that at their start
MOST = 200  # iterations


@njit(cache=True, parallel=True, error_model="numpy")
def stiffness_in_space(problem, slope, stiffness):
    """Write what forces fall by in space, `stiffness` [C, 3, 3] [N/m]: `slope` [C, 4] [N/m] in their frames, turned."""
    for c in prange(len(slope)):
        frame, along, across_11, across_12, across_22 = problem.frame[c], slope[c, 0], slope[c, 1], slope[c, 2], slope[c, 3]
        for a in range(3):
            first = across_11 * frame[1, a] + across_12 * frame[2, a]
            second = across_12 * frame[1, a] + across_22 * frame[2, a]
            for b in range(3):
                stiffness[c, a, b] = along * frame[0, a] * frame[0, b] + first * frame[1, b] + second * frame[2, b]


@njit(cache=True, parallel=True, error_model="numpy")
def factorise(strands, problem, stiffness, factor):
    """Write the factor of M [4V, 11], with contacts of a `stiffness` [C, 3, 3] [N/m]; returns whether there is one."""
    good = np.ones(len(problem.strand), np.bool_)
    for i in prange(len(problem.strand)):
        first, last = strands.start[problem.strand[i]], strands.start[problem.strand[i] + 1]
        for row in range(4 * first, 4 * last):
            for d in range(banded.WIDTH + 1):
                factor[row, d] = strands.band[row, d]
        for p in range(problem.first[i], problem.first[i + 1]):
            c, e = problem.place[p, 0], problem.place[p, 1]
            if not acts(stiffness[c]):
                continue
            for f in range(e // 2 * 2, e + 1):
                v, u = problem.vertex[c, e], problem.vertex[c, f]
                weight = problem.weight[c, e] * problem.weight[c, f]
                for a in range(3):
                    for b in range(3):
                        row, column = 4 * v + a, 4 * u + b
                        if column <= row and not strands.held[v, a] and not strands.held[u, b]:
                            factor[column, row - column] += weight * stiffness[c, a, b]
        good[i] = banded.factorise(factor[4 * first : 4 * last])
    return good.all()


@njit(cache=True, parallel=True, error_model="numpy")
def conjugate_gradients(strands, problem, stiffness, factor, b, x):
    """Write the solution x [V, 4] [m, rad] for the right-hand side b [V, 4] [N, N m]; returns the iterations.

    `factor` is that of M. Sums are made in the order of strands, so that they are the same on any number of threads.
    """
    r, z, p = np.empty_like(b), np.empty_like(b), np.empty_like(b)
    m, q = np.empty_like(b), np.empty_like(b)  # M p, and (M + B) p
    part, force = np.empty(len(problem.strand)), np.empty((len(stiffness), 2, 3))
    for i in prange(len(problem.strand)):
        first, last = strands.start[problem.strand[i]], strands.start[problem.strand[i] + 1]
        part[i] = 0.0
        x[first:last], r[first:last], m[first:last], z[first:last] = 0.0, b[first:last], b[first:last], b[first:last]
        banded.solve(factor[4 * first : 4 * last], z[first:last].reshape(-1))
        p[first:last] = z[first:last]
        part[i] = _product(r, z, first, last)
    rz = in_order(part)
    goal = INEXACT * INEXACT * rz
    for iteration in range(MOST):
        if not rz > goal:
            return iteration
        for c in prange(len(stiffness)):
            _couple(problem, stiffness, c, p, force)
        for i in prange(len(problem.strand)):
            first, last = strands.start[problem.strand[i]], strands.start[problem.strand[i] + 1]
            q[first:last] = m[first:last]
            _add_coupling(strands, problem, stiffness, i, force, q)
            part[i] = _product(p, q, first, last)
        curvature = in_order(part)
        if not curvature > 0.0:  # rounding
            return iteration
        alpha = rz / curvature
        for i in prange(len(problem.strand)):
            first, last = strands.start[problem.strand[i]], strands.start[problem.strand[i] + 1]
            for v in range(first, last):
                for k in range(4):
                    x[v, k] += alpha * p[v, k]
                    r[v, k] -= alpha * q[v, k]
                    z[v, k] = r[v, k]
            banded.solve(factor[4 * first : 4 * last], z[first:last].reshape(-1))
            part[i] = _product(r, z, first, last)
        beta = in_order(part) / rz
        rz *= beta
        for i in prange(len(problem.strand)):
            first, last = strands.start[problem.strand[i]], strands.start[problem.strand[i] + 1]
            for v in range(first, last):
                for k in range(4):
                    p[v, k] = z[v, k] + beta * p[v, k]
                    m[v, k] = r[v, k] + beta * m[v, k]
    return MOST


@njit(cache=True, error_model="numpy")
def in_order(values):
    """Sum of values [n] one after the other: within a parallel function `sum` would depend on the number of threads."""
    total = 0.0
    for value in values:
        total += value
    return total


@njit(cache=True, error_model="numpy")
def acts(stiffness):
    """Whether a contact's stiffness [3, 3] is more than nothing."""
    return stiffness[0, 0] + stiffness[1, 1] + stiffness[2, 2] > 0.0


@njit(cache=True, error_model="numpy")
def _product(a, b, first, last):
    total = 0.0
    for v in range(first, last):
        for k in range(4):
            total += a[v, k] * b[v, k]
    return total


@njit(cache=True, error_model="numpy")
def _couple(problem, stiffness, c, p, force):
    """Write the `force` [C, 2, 3] on each side of contact c that comes from the other side, for vertices at p."""
    if not acts(stiffness[c]):
        return
    for side in range(2):
        v, u = problem.vertex[c, 2 * side], problem.vertex[c, 2 * side + 1]
        w, t = problem.weight[c, 2 * side], problem.weight[c, 2 * side + 1]
        y0, y1, y2 = w * p[v, 0] + t * p[u, 0], w * p[v, 1] + t * p[u, 1], w * p[v, 2] + t * p[u, 2]
        for a in range(3):
            force[c, 1 - side, a] = stiffness[c, a, 0] * y0 + stiffness[c, a, 1] * y1 + stiffness[c, a, 2] * y2


@njit(cache=True, error_model="numpy")
def _add_coupling(strands, problem, stiffness, i, force, q):
    """Add what the forces of `_couple` do to strand number i of those in contact to q [V, 4]."""
    for at in range(problem.first[i], problem.first[i + 1]):
        c, e = problem.place[at, 0], problem.place[at, 1]
        if acts(stiffness[c]):
            v, weight = problem.vertex[c, e], problem.weight[c, e]
            for k in range(3):
                if not strands.held[v, k]:
                    q[v, k] += weight * force[c, e // 2, k]
