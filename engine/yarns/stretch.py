"""Stretch of rod segments between consecutive EoL nodes, and its damping (Sánchez-Banderas 2020, eq. 2).

V = k_s Du (lambda - 1)^2 / 2 with lambda = l / Du. The damping potential of a step h is
beta k_s Du0 (lambda - lambda0)^2 / (2 h), 0 marking the start of the step: it vanishes in rigid motion and when nodes
slide along a straight yarn.
"""

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def add_gradient(chain, node_point, stiffness, damping, h, x0, u0, x, u, gradient):
    """Add the gradient of one yarn to `gradient` [N, 4] (x, u of each node) and return its energy [J].

    `chain` are the yarn's EoL nodes in order; `stiffness` is its k_s [N], `damping` its beta [s].
    """
    energy = 0.0
    d = np.empty(3)
    for e in range(len(chain) - 1):
        i, j = chain[e], chain[e + 1]
        length, du = _segment(x, u, node_point, i, j, d)
        lam = length / du
        tension = stiffness * (lam - 1.0)
        energy += 0.5 * stiffness * du * (lam - 1.0) ** 2
        f_x = tension
        f_u = 0.5 * stiffness * (lam * lam - 1.0)
        if damping > 0.0:
            length0, du0 = _rest(x0, u0, node_point, i, j)
            rate = damping * stiffness * du0 / h * (lam - length0 / du0)
            energy += 0.5 * rate * (lam - length0 / du0)
            f_x += rate / du
            f_u += rate * lam / du
        for k in range(3):
            gradient[i, k] -= f_x * d[k]
            gradient[j, k] += f_x * d[k]
        gradient[i, 3] += f_u
        gradient[j, 3] -= f_u
    return energy


@njit(cache=True, error_model="numpy")
def add_hessian(chain, node_point, stiffness, damping, h, x0, u0, x, u, convex, band):
    """Add the Hessian of one yarn to its `band` [E, 3, 4, 4], blocks of each node with itself and the next two.

    Where `convex` [N], without the terms that compression and damping can make negative.
    """
    d = np.empty(3)
    z = np.empty((2, 4))
    for e in range(len(chain) - 1):
        i, j = chain[e], chain[e + 1]
        length, du = _segment(x, u, node_point, i, j, d)
        lam = length / du
        along = stiffness / du
        tension = stiffness * (lam - 1.0)
        damped = 0.0
        if damping > 0.0:
            length0, du0 = _rest(x0, u0, node_point, i, j)
            rate = damping * stiffness * du0 / h
            along += rate / (du * du)
            damped = rate * (lam - length0 / du0) / du
        across = (tension + damped) / length
        if convex[i] or convex[j]:
            across, damped = max(across, 0.0), 0.0
        for k in range(3):
            z[0, k] = -d[k]
            z[1, k] = d[k]
        z[0, 3] = lam
        z[1, 3] = -lam
        for a in range(2):
            for b in range(a, 2):
                block = band[e + a, b - a]
                sign = 1.0 if a == b else -1.0
                for r in range(3):
                    for c in range(3):
                        block[r, c] += along * z[a, r] * z[b, c] - sign * across * d[r] * d[c]
                    block[r, r] += sign * across
                    block[r, 3] += along * z[a, r] * z[b, 3] - sign * damped / du * d[r]
                    block[3, r] += along * z[a, 3] * z[b, r] - sign * damped / du * d[r]
                block[3, 3] += along * z[a, 3] * z[b, 3] + sign * 2.0 * damped / du * lam


@njit(cache=True, error_model="numpy")
def _segment(x, u, node_point, i, j, d):
    """Length and material length of segment (i, j); its direction is written to d."""
    p, q = node_point[i], node_point[j]
    length = 0.0
    for k in range(3):
        d[k] = x[q, k] - x[p, k]
        length += d[k] * d[k]
    length = max(np.sqrt(length), 1e-100)
    for k in range(3):
        d[k] /= length
    return length, u[j] - u[i]


@njit(cache=True, error_model="numpy")
def _rest(x0, u0, node_point, i, j):
    p, q = node_point[i], node_point[j]
    length = 0.0
    for k in range(3):
        length += (x0[q, k] - x0[p, k]) ** 2
    return np.sqrt(length), u0[j] - u0[i]
