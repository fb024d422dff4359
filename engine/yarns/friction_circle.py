"""Isotropic friction between two yarns: one limit on how far they have slid on each other, in every direction.

With u and v the Eulerian coordinates of both yarns at a point, ubar and vbar their anchors and w = dx/du along each yarn,

    s = w_A (u - ubar) - w_B (v - vbar)

is the slip of the material of one yarn on the other. Two independent laws for u and v (`friction.py`) form a box instead, up to
sqrt 2 too strong on its diagonal. Of two parallel yarns both anchors act in series, with mu F_n in total.

F_n, w and the anchors stay those of the start of the step. Newton follows the force as `coulomb` has it.
"""

import numpy as np
from numba import njit

from engine.yarns.coulomb import follow, huber
from engine.yarns.normal_force import stretch, tangent


@njit(cache=True)
def slopes(points, point_nodes, eil, before, after, node_point, x, u, slope):
    """Write w of both nodes of `points` to `slope` [N, 3]: an EIL node's of its segment, the mean of both at an EoL node."""
    for p in points:
        for i in point_nodes[p]:
            if eil[i]:
                a, b = before[i], after[i]
                for k in range(3):
                    slope[i, k] = (x[node_point[b], k] - x[node_point[a], k]) / (u[b] - u[a])
            else:
                tangent(i, before, after, node_point, x, u, slope[i])
                scale = stretch(i, before, after, node_point, x, u)
                for k in range(3):
                    slope[i, k] *= scale


@njit(cache=True)
def add_gradient(points, point_nodes, spring, limit, slope, anchor, u, gradient):
    """Add the gradient to `gradient` [N, 4] and return the energy [J].

    `points` have two yarns that slide; `spring` k_f [N/m] and `limit` mu F_n [N] are [P], `slope` w [N, 3], `anchor`, u [N].
    """
    energy = 0.0
    s = np.empty(3)
    for p in points:
        i, j = point_nodes[p, 0], point_nodes[p, 1]
        slip = _slip(i, j, slope, anchor, u, s)
        added, force = huber(slip, spring[p], limit[p])
        energy += added
        for k in range(3):
            gradient[i, 3] += force * s[k] * slope[i, k]
            gradient[j, 3] -= force * s[k] * slope[j, k]
    return energy


@njit(cache=True)
def add_hessian(points, point_nodes, spring, limit, slope, anchor, pull, u, sliding):
    """Add the second derivatives to `sliding` [P, 2, 2], nowhere negative; `pull` [P, 3] is f of `update_pull`."""
    s = np.empty(3)
    for p in points:
        i, j = point_nodes[p, 0], point_nodes[p, 1]
        slip = _slip(i, j, slope, anchor, u, s)
        sticks = slip < limit[p] / spring[p]
        rigidity = spring[p] if sticks else limit[p] / max(slip, 1e-300)
        along_i = along_j = pull_i = pull_j = ii = ij = jj = 0.0
        for k in range(3):
            along_i += slope[i, k] * s[k] / max(slip, 1e-300)
            along_j -= slope[j, k] * s[k] / max(slip, 1e-300)
            pull_i += slope[i, k] * pull[p, k]
            pull_j -= slope[j, k] * pull[p, k]
            ii += slope[i, k] * slope[i, k]
            ij -= slope[i, k] * slope[j, k]
            jj += slope[j, k] * slope[j, k]
        if not sticks:
            ii -= along_i * pull_i
            ij -= 0.5 * (along_i * pull_j + along_j * pull_i)
            jj -= along_j * pull_j
        sliding[p, 0, 0] += rigidity * ii
        sliding[p, 0, 1] += rigidity * ij
        sliding[p, 1, 0] += rigidity * ij
        sliding[p, 1, 1] += rigidity * jj


@njit(cache=True)
def update_pull(points, point_nodes, spring, limit, slope, anchor, u, du, pull):
    """Let the `pull` f [P, 3] follow an update du [N] of u; with du = 0 it is the friction at u over its limit."""
    s, ds = np.empty(3), np.empty(3)
    for p in points:
        i, j = point_nodes[p, 0], point_nodes[p, 1]
        slip = _slip(i, j, slope, anchor, u, s)
        for k in range(3):
            ds[k] = slope[i, k] * du[i] - slope[j, k] * du[j]
        follow(s, ds, slip, limit[p] / spring[p], pull[p])


@njit(cache=True)
def drag_anchors(points, point_nodes, spring, limit, slope, u, anchor):
    """Move the anchors of what slid, along s, so that their springs pull with the limit."""
    s = np.empty(3)
    for p in points:
        i, j = point_nodes[p, 0], point_nodes[p, 1]
        slip = _slip(i, j, slope, anchor, u, s)
        reach = limit[p] / spring[p]
        if slip > reach:
            anchor[i] = u[i] - reach / slip * (u[i] - anchor[i])
            anchor[j] = u[j] - reach / slip * (u[j] - anchor[j])


@njit(cache=True)
def _slip(i, j, slope, anchor, u, s):
    """Write s and return its length."""
    square = 0.0
    for k in range(3):
        s[k] = slope[i, k] * (u[i] - anchor[i]) - slope[j, k] * (u[j] - anchor[j])
        square += s[k] * s[k]
    return np.sqrt(square)
