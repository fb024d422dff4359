"""Bending at EoL nodes (Sánchez-Banderas 2020, eq. 4).

V = k_b theta^2 / D with D = u_+ - u_-, over triples of consecutive EoL nodes. With k_b = EI a ring stores pi EI / R
for every number of segments.
"""

import numpy as np
from numba import njit

from engine.linalg.block_matrix import locate

STRAIGHT = 1e-9  # sine of the angle below which the plane of bending is arbitrary


@njit(cache=True)
def add_gradient(chain, before, after, node_yarn, node_point, stiffness, x, u, gradient):
    """Add the gradient to `gradient` [N, 4] and return the energy [J]."""
    energy = 0.0
    t, s, n, m = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in chain:
        a, b = before[i], after[i]
        k_b = stiffness[node_yarn[i]]
        if a < 0 or b < 0 or k_b == 0.0:
            continue
        la, lb, theta = _bend(x, node_point[a], node_point[i], node_point[b], t, s, n, m)
        span = u[b] - u[a]
        energy += k_b * theta * theta / span
        f = 2.0 * k_b * theta / span
        for k in range(3):
            gradient[a, k] += f / la * n[k]
            gradient[b, k] += f / lb * m[k]
            gradient[i, k] -= f * (n[k] / la + m[k] / lb)
        gradient[a, 3] += k_b * theta * theta / (span * span)
        gradient[b, 3] -= k_b * theta * theta / (span * span)
    return energy


@njit(cache=True)
def add_hessian(chain, before, after, node_yarn, node_point, node_slot, stiffness, x, u, start, column, block):
    """Add a positive semidefinite Hessian: Gauss-Newton in the plane of bending, the stable mode across it.

    Across the plane, tilts alpha of t and beta of s cost f ((cos theta)(alpha^2 + beta^2)/2 - alpha beta) with
    f = 2 k_b theta / (D sin theta); its positive part is f (1 + cos theta) (alpha - beta)^2 / 4.
    """
    t, s, n, m = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    nodes = np.empty(3, np.int64)
    inside = np.empty((3, 4))
    across = np.empty((3, 4))
    for i in chain:
        a, b = before[i], after[i]
        k_b = stiffness[node_yarn[i]]
        if a < 0 or b < 0 or k_b == 0.0:
            continue
        la, lb, theta = _bend(x, node_point[a], node_point[i], node_point[b], t, s, n, m)
        span = u[b] - u[a]
        ratio = theta / np.sin(theta) if theta > STRAIGHT else 1.0
        root = np.sqrt(2.0 * k_b / span)
        side = np.sqrt(k_b / span * ratio * (1.0 + np.cos(theta)))
        nodes[0], nodes[1], nodes[2] = a, i, b
        for k in range(3):
            binormal = t[(k + 1) % 3] * n[(k + 2) % 3] - t[(k + 2) % 3] * n[(k + 1) % 3]
            inside[0, k] = root * n[k] / la
            inside[2, k] = root * m[k] / lb
            inside[1, k] = -inside[0, k] - inside[2, k]
            across[0, k] = side * binormal / la
            across[2, k] = side * binormal / lb
            across[1, k] = -across[0, k] - across[2, k]
        inside[0, 3] = 0.5 * root * theta / span
        inside[1, 3] = 0.0
        inside[2, 3] = -inside[0, 3]
        across[:, 3] = 0.0
        add_outer(nodes, inside, node_point, node_slot, start, column, block)
        add_outer(nodes, across, node_point, node_slot, start, column, block)


@njit(cache=True)
def add_outer(nodes, v, node_point, node_slot, start, column, block):
    """Add v v^T, v [nodes, 4] holding (x, u) of each node, to the blocks of the nodes' points."""
    for a in range(len(nodes)):
        p, sa = node_point[nodes[a]], 3 + node_slot[nodes[a]]
        for b in range(len(nodes)):
            sb = 3 + node_slot[nodes[b]]
            k = locate(start, column, p, node_point[nodes[b]])
            for r in range(3):
                for c in range(3):
                    block[k, r, c] += v[a, r] * v[b, c]
                block[k, r, sb] += v[a, r] * v[b, 3]
                block[k, sa, r] += v[a, 3] * v[b, r]
            block[k, sa, sb] += v[a, 3] * v[b, 3]


@njit(cache=True)
def _bend(x, a, i, b, t, s, n, m):
    """Lengths of both segments and the angle theta between them.

    Writes the unit tangents t and s, and the unit directions n and m in the plane of bending in which theta grows when
    the first point (n) or the last (m) moves.
    """
    la = lb = 0.0
    for k in range(3):
        t[k] = x[i, k] - x[a, k]
        s[k] = x[b, k] - x[i, k]
        la += t[k] * t[k]
        lb += s[k] * s[k]
    la, lb = max(np.sqrt(la), 1e-300), max(np.sqrt(lb), 1e-300)
    cosine = sine = 0.0
    for k in range(3):
        t[k] /= la
        s[k] /= lb
        cosine += t[k] * s[k]
    for k in range(3):
        c = t[(k + 1) % 3] * s[(k + 2) % 3] - t[(k + 2) % 3] * s[(k + 1) % 3]
        sine += c * c
    sine = np.sqrt(sine)
    if sine > STRAIGHT:
        for k in range(3):
            n[k] = (s[k] - cosine * t[k]) / sine
            m[k] = (cosine * s[k] - t[k]) / sine
    else:
        _perpendicular(t, n)
        for k in range(3):
            m[k] = n[k]
    return la, lb, np.arctan2(sine, cosine)


@njit(cache=True)
def _perpendicular(t, n):
    """Write to n a unit vector perpendicular to the unit vector t."""
    least = 0
    for k in range(1, 3):
        if abs(t[k]) < abs(t[least]):
            least = k
    length = 0.0
    for k in range(3):
        n[k] = (1.0 if k == least else 0.0) - t[least] * t[k]
        length += n[k] * n[k]
    for k in range(3):
        n[k] /= np.sqrt(length)
