"""Unknowns that take no part in a step: pinned, fixed, interpolated or removed.

Each point has a projector S on its five unknowns. The gradient becomes S g and the Hessian S H S + (I - S): rows and
columns of cancelled coordinates stay as identity (Sánchez-Banderas 2020, sec. 4.3).
"""

import numpy as np
from numba import njit, prange

from engine.arrays import Flags, Floats
from engine.linalg.block_matrix import BLOCK
from engine.yarns.model import PointKind, YarnModel, YarnState


def projectors(model: YarnModel, state: YarnState) -> Floats:
    """Return S of every point for the current assignment, shape [P, 5, 5]."""
    s = np.zeros((model.point_count, BLOCK, BLOCK))
    first, second = model.point_nodes.T
    paired = second >= 0
    s[:, :3, :3] = model.free_directions
    s[interpolated(model, state) | ~state.active, :3, :3] = 0.0
    s[:, 3, 3] = state.active & ~model.u_fixed[first]
    s[paired, 4, 4] = (state.active & ~model.u_fixed[second])[paired]
    return s


def interpolated(model: YarnModel, state: YarnState) -> Flags:
    """Return the points whose x is no unknown because all their nodes are EIL, shape [P].

    One EIL node alone leaves x to its partner: the other yarn, an eyelet, an edge. A discretisation point has none.
    """
    first, second = model.point_nodes.T
    alone = model.point_kind == PointKind.LAGRANGIAN
    return state.eil[first] & (alone | ((second >= 0) & state.eil[second]))


@njit(cache=True)
def gather(node_point, node_slot, of_node, of_point):
    """Add a gradient by nodes [N, 4] to one by points [P, 5]."""
    for i in range(len(node_point)):
        p = node_point[i]
        for k in range(3):
            of_point[p, k] += of_node[i, k]
        of_point[p, 3 + node_slot[i]] += of_node[i, 3]


@njit(cache=True)
def project_gradient(points, s, gradient):
    """Apply S to a gradient or a direction [P, 5] at the constrained `points`, in place."""
    g = np.empty(BLOCK)
    for p in points:
        for r in range(BLOCK):  # entry by entry, which numba compiles faster than rows at once
            g[r], gradient[p, r] = gradient[p, r], 0.0
        for r in range(BLOCK):
            for c in range(BLOCK):
                gradient[p, r] += s[p, r, c] * g[c]


@njit(cache=True, parallel=True)
def project_hessian(constrained, s, point, start, column, diagonal, block):
    """Apply S from both sides to every block that touches a constrained point (flags [P]), in place; `point` [R] has rows."""
    for i in prange(len(point)):
        p = point[i]
        for k in range(start[i], start[i + 1]):
            q = point[column[k]]
            if constrained[p] or constrained[q]:
                _project_block(s[p], s[q], block[k])
        if constrained[p]:
            own = block[diagonal[i]]
            scale = 0.0  # a cancelled unknown gets the size of its neighbours' diagonal
            for r in range(BLOCK):
                scale = max(scale, own[r, r])
            for r in range(BLOCK):
                for c in range(BLOCK):
                    identity = 1.0 if r == c else 0.0
                    own[r, c] += max(scale, 1e-30) * (identity - s[p, r, c])


@njit(cache=True)
def project_coupling(others, s, coupling):
    """Apply S to the coupling [C, 2, 4, 5] of eliminated unknowns to the points `others` [C, 4], in place."""
    row = np.empty(BLOCK)
    for e in range(len(others)):
        for r in range(2):
            for q in range(others.shape[1]):
                for c in range(BLOCK):
                    row[c], coupling[e, r, q, c] = coupling[e, r, q, c], 0.0
                for c in range(BLOCK):
                    for m in range(BLOCK):
                        coupling[e, r, q, c] += row[m] * s[others[e, q], m, c]


@njit(cache=True)
def _project_block(left, right, block):
    half = np.empty((BLOCK, BLOCK))
    for r in range(BLOCK):
        for c in range(BLOCK):
            half[r, c] = 0.0
            for m in range(BLOCK):
                half[r, c] += left[r, m] * block[m, c]
    for r in range(BLOCK):
        for c in range(BLOCK):
            total = 0.0
            for m in range(BLOCK):
                total += half[r, m] * right[m, c]
            block[r, c] = total
