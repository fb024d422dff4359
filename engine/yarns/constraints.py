"""Unknowns that take no part in a step: pinned, fixed, interpolated or removed.

Each point has a projector S on its five unknowns. The gradient becomes S g and the Hessian S H S + (I - S): rows and
columns of cancelled coordinates stay as identity and the system keeps its size (Sánchez-Banderas 2020, sec. 4.3).
"""

import numpy as np
from numba import njit

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
    """Apply S to the gradient of the constrained `points`, in place."""
    g = np.empty(BLOCK)
    for p in points:
        g[:] = gradient[p]
        for r in range(BLOCK):
            gradient[p, r] = 0.0
            for c in range(BLOCK):
                gradient[p, r] += s[p, r, c] * g[c]


@njit(cache=True)
def project_hessian(constrained, s, start, column, diagonal, block):
    """Apply S from both sides to every block that touches a constrained point (flags [P]), in place."""
    left = np.empty((BLOCK, BLOCK))
    for p in range(len(constrained)):
        for k in range(start[p], start[p + 1]):
            q = column[k]
            if not (constrained[p] or constrained[q]):
                continue
            for r in range(BLOCK):
                for c in range(BLOCK):
                    left[r, c] = 0.0
                    for m in range(BLOCK):
                        left[r, c] += s[p, r, m] * block[k, m, c]
            for r in range(BLOCK):
                for c in range(BLOCK):
                    total = 0.0
                    for m in range(BLOCK):
                        total += left[r, m] * s[q, m, c]
                    block[k, r, c] = total
        if constrained[p]:
            scale = 0.0  # a cancelled unknown gets the size of its neighbours' diagonal
            for r in range(BLOCK):
                scale = max(scale, block[diagonal[p], r, r])
            for r in range(BLOCK):
                for c in range(BLOCK):
                    identity = 1.0 if r == c else 0.0
                    block[diagonal[p], r, c] += max(scale, 1e-300) * (identity - s[p, r, c])
