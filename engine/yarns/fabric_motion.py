"""How points follow when their fabrics move as a whole: the smooth motions that a local preconditioner is slow to see.

Where the material of fabric A moves by d_A and that of fabric B by d_B, a point of two of their yarns must move along both:

    dx = d_A + w_A du = d_B + w_B dv,    w = dx/du along each yarn.

Fabrics can thus slide on each other for the price of friction; in the normal direction dx is the mean of both.
"""

import numpy as np
from numba import njit, prange

from engine.arrays import Floats, Ints, Singles
from engine.linalg.block_matrix import BLOCK
from engine.yarns.friction_circle import slopes
from engine.yarns.model import YarnModel, YarnState
from engine.yarns.topology import Chain

RIDGE = 1e-2  # of w^2, so that parallel yarns do not slide without bounds


def fabrics_at(model: YarnModel) -> Ints:
    """Return the fabrics of both yarns of every point, the second -1 where it is the same or there is none, shape [P, 2]."""
    first, second = model.point_nodes.T
    fabric = model.fabric - min(model.fabric.min(initial=0), 0)
    of_first, of_second = fabric[model.node_yarn[first]], fabric[model.node_yarn[second]]
    return np.column_stack([of_first, np.where((second >= 0) & (of_second != of_first), of_second, -1)])


def responses(model: YarnModel, state: YarnState, chain: Chain, fabrics: Ints, projector: Floats, points: Ints) -> Singles:
    """Return how the five unknowns of `points` [n] follow the displacements of both `fabrics` [P, 2], shape [n, 2, 5, 3].

    `projector` [P, 5, 5] takes away those that are held.
    """
    slope = np.zeros((model.node_count, 3))
    slopes(points[fabrics[points, 1] >= 0], model.point_nodes, state.eil, chain.before, chain.after, model.node_point, state.x,
           state.u, slope)
    response = np.zeros((len(points), 2, BLOCK, 3), np.float32)
    _responses(points, fabrics, model.point_nodes, slope, projector, response)
    return response


@njit(cache=True, parallel=True)
def _responses(points, fabrics, point_nodes, slope, projector, response):
    for a in prange(len(points)):
        p = points[a]
        free = projector[p]
        if fabrics[p, 1] < 0:
            for r in range(BLOCK):
                for c in range(3):
                    response[a, 0, r, c] = free[r, c]
            continue
        w_a, w_b = free[3, 3] * slope[point_nodes[p, 0]], -free[4, 4] * slope[point_nodes[p, 1]]
        aa, ab, bb = np.dot(w_a, w_a), np.dot(w_a, w_b), np.dot(w_b, w_b)
        ridge = RIDGE * (aa + bb) + 1e-30
        aa, bb = aa + ridge, bb + ridge
        slid = np.zeros((2, 3))  # (du, dv) from d_B - d_A by least squares
        for c in range(3):
            slid[0, c] = (bb * w_a[c] - ab * w_b[c]) / (aa * bb - ab * ab)
            slid[1, c] = (aa * w_b[c] - ab * w_a[c]) / (aa * bb - ab * ab)
        follow = np.zeros((2, BLOCK, 3))
        for side in range(2):
            sign = 1.0 if side == 1 else -1.0
            for c in range(3):
                follow[side, c, c] = 0.5
                for r in range(3):
                    follow[side, r, c] += 0.5 * sign * (w_a[r] * slid[0, c] - w_b[r] * slid[1, c])
                follow[side, 3, c], follow[side, 4, c] = sign * slid[0, c], sign * slid[1, c]
            for r in range(BLOCK):
                for c in range(3):
                    s = 0.0
                    for k in range(BLOCK):
                        s += free[r, k] * follow[side, k, c]
                    response[a, side, r, c] = s
