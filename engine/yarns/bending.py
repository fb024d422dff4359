"""Bending at EoL nodes (Sánchez-Banderas 2020, eq. 4).

V = k_b theta^2 / D with D = u_+ - u_-, over triples of consecutive EoL nodes. With k_b = EI a ring stores pi EI / R
for every number of segments.
"""

import numpy as np
from numba import njit

from engine.geometry.edge_angle import edge_angle

STRAIGHT = 1e-13  # sine of the angle below which the plane of bending is arbitrary: what force that turns is round-off

# how the edges a = x0 - x-, b = x+ - x0 and the span D = u+ - u- depend on the three nodes
EDGE_A = (-1.0, 1.0, 0.0)
EDGE_B = (0.0, -1.0, 1.0)
SPAN = (-1.0, 0.0, 1.0)


@njit(cache=True, error_model="numpy")
def add_gradient(chain, node_point, stiffness, x, u, gradient):
    """Add the gradient of one yarn to `gradient` [N, 4] and return its energy [J].

    `chain` are the yarn's EoL nodes in order, `stiffness` is its k_b [N m^2].
    """
    energy = 0.0
    t, s, n, m = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for e in range(1, len(chain) - 1):
        a, i, b = chain[e - 1], chain[e], chain[e + 1]
        la, lb, theta = _bend(x, node_point[a], node_point[i], node_point[b], t, s, n, m)
        span = u[b] - u[a]
        energy += stiffness * theta * theta / span
        f = 2.0 * stiffness * theta / span
        for k in range(3):
            gradient[a, k] += f / la * n[k]
            gradient[b, k] += f / lb * m[k]
            gradient[i, k] -= f * (n[k] / la + m[k] / lb)
        gradient[a, 3] += stiffness * theta * theta / (span * span)
        gradient[b, 3] -= stiffness * theta * theta / (span * span)
    return energy


@njit(cache=True, error_model="numpy")
def add_hessian(chain, node_point, stiffness, x, u, convex, band):
    """Add the Hessian of one yarn to its `band` [E, 3, 4, 4], blocks of each node with itself and the next two.

    It is exact but for the unstable mode across the plane of bending; where `convex` [N], its positive part.

    With a and b the two edges, dtheta = m.db/|b| - n.da/|a|; theta also turns at second order with the stretch of an edge.
    Across the plane, tilts alpha of t and beta of s cost F (cos(theta) (alpha^2 + beta^2) / 2 - alpha beta) with
    F = 2 k_b theta / (D sin theta); its positive part is F (1 + cos theta) (alpha - beta)^2 / 4. In the plane, the
    Gauss-Newton form k_b grad(theta / D^1/2)^2 is the positive part.
    """
    t, s, n, m = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    aa, ab, bb = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    a_span, b_span = np.empty(3), np.empty(3)
    for e in range(1, len(chain) - 1):
        first, i, last = chain[e - 1], chain[e], chain[e + 1]
        share = 0.5 if convex[i] else 1.0
        la, lb, theta = _bend(x, node_point[first], node_point[i], node_point[last], t, s, n, m)
        span = u[last] - u[first]
        along = 2.0 * stiffness / span
        turn = along * theta
        tilt = 0.5 * along * (theta / np.sin(theta) if theta > STRAIGHT else 1.0) * (1.0 + np.cos(theta))
        for r in range(3):
            binormal_r = t[(r + 1) % 3] * n[(r + 2) % 3] - t[(r + 2) % 3] * n[(r + 1) % 3]
            a_span[r] = share * turn * n[r] / (la * span)
            b_span[r] = -share * turn * m[r] / (lb * span)
            for c in range(3):
                across = tilt * binormal_r * (t[(c + 1) % 3] * n[(c + 2) % 3] - t[(c + 2) % 3] * n[(c + 1) % 3])
                aa[r, c] = (along * n[r] * n[c] + across) / (la * la)
                bb[r, c] = (along * m[r] * m[c] + across) / (lb * lb)
                if not convex[i]:
                    aa[r, c] += turn * (n[r] * t[c] + t[r] * n[c]) / (la * la)
                    bb[r, c] -= turn * (m[r] * s[c] + s[r] * m[c]) / (lb * lb)
                ab[r, c] = -(along * n[r] * m[c] + across) / (la * lb)
        span_span = share * share * turn * theta / (span * span)
        for p in range(3):
            ap, bp, dp = EDGE_A[p], EDGE_B[p], SPAN[p]
            for q in range(p, 3):
                aq, bq, dq = EDGE_A[q], EDGE_B[q], SPAN[q]
                block = band[e - 1 + p, q - p]
                for r in range(3):
                    for c in range(3):
                        block[r, c] += (
                            ap * aq * aa[r, c] + ap * bq * ab[r, c] + bp * aq * ab[c, r] + bp * bq * bb[r, c])
                    block[r, 3] += (ap * a_span[r] + bp * b_span[r]) * dq
                    block[3, r] += (aq * a_span[r] + bq * b_span[r]) * dp
                block[3, 3] += dp * dq * span_span


@njit(cache=True, error_model="numpy")
def _bend(x, a, i, b, t, s, n, m):
    """Lengths of both segments and the angle theta between them.

    Writes the unit tangents t and s, and the unit directions n and m in the plane of bending in which theta grows when
    the first point (n) or the last (m) moves.
    """
    la, lb, cosine, sine = edge_angle(x, a, i, i, b, t, s)
    if sine > STRAIGHT:
        for k in range(3):
            n[k] = (s[k] - cosine * t[k]) / sine
            m[k] = (cosine * s[k] - t[k]) / sine
    else:
        _perpendicular(t, n)
        for k in range(3):
            m[k] = n[k]
    return la, lb, np.arctan2(sine, cosine)


@njit(cache=True, error_model="numpy")
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
