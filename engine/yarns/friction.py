"""Friction of sliding contacts: anchored springs on Eulerian coordinates with Coulomb's limit.

The normal force F_n and the anchor stay those of the start of the step, so the step sees a Huber potential in u:
a spring k_f (u - anchor)^2 / 2 up to the limit, a constant force behind it. Sliding by du moves lambda du of material
through the contact, so the force that works on u is limited by lambda mu F_n.

Springs as stiff as yarns would reach the limit of a light contact within a millionth of a segment, far below what a step
moves: Newton then finds out one by one which contacts stick. A contact sticks on a ten-thousandth of a segment instead, a
displacement that stays and does not add up, as only what slides drags its anchor.

Parallel contacts leave one combination of Eulerian coordinates without any stiffness; a weak viscous hold of every u at
its value at the start of the step keeps the step well posed and vanishes at rest.
"""

import numpy as np
from numba import njit

from engine.arrays import Floats

LEAST_REACH = 1e-4  # rest segments that material moves at least before friction is at its limit


def springs(stiffest: Floats, limit: Floats, rest_segment: Floats) -> Floats:
    """Return k_f [N/m]: at most `stiffest` [N/m], and such that mu F_n, the `limit` [N], is not reached too soon; all [N]."""
    return np.where(limit > 0.0, np.minimum(stiffest, limit / (LEAST_REACH * rest_segment)), stiffest)


@njit(cache=True)
def add_gradient(nodes, spring, limit, anchor, hold, u0, u, gradient):
    """Add the gradient to `gradient` [N, 4] and return the energy [J]; `nodes` are those whose u is an unknown.

    `spring` k_f [N/m], `limit` lambda mu F_n [N], `hold` [N/m] and `anchor`, u0, u [m] are given for every node.
    """
    energy = 0.0
    for i in nodes:
        slip = u[i] - anchor[i]
        reach = limit[i] / spring[i]
        if abs(slip) <= reach:
            energy += 0.5 * spring[i] * slip * slip
            gradient[i, 3] += spring[i] * slip
        else:
            energy += limit[i] * (abs(slip) - 0.5 * reach)
            gradient[i, 3] += np.sign(slip) * limit[i]
        energy += 0.5 * hold[i] * (u[i] - u0[i]) ** 2
        gradient[i, 3] += hold[i] * (u[i] - u0[i])
    return energy


@njit(cache=True)
def add_hessian(nodes, node_point, node_slot, spring, limit, anchor, hold, u, sliding):
    """Add the second derivatives to `sliding` [P, 2, 2], those in both u of each point."""
    for i in nodes:
        p, s = node_point[i], node_slot[i]
        sliding[p, s, s] += hold[i]
        if abs(u[i] - anchor[i]) < limit[i] / spring[i]:
            sliding[p, s, s] += spring[i]


@njit(cache=True)
def drag_anchors(nodes, spring, limit, u, anchor):
    """Move the anchors that slid so that their springs pull with the limit."""
    for i in nodes:
        reach = limit[i] / spring[i]
        anchor[i] = min(max(anchor[i], u[i] - reach), u[i] + reach)
