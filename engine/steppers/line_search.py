"""Backtracking along a Newton direction that keeps EoL nodes in order."""

import numpy as np
from numba import njit

from engine.arrays import Floats
from engine.steppers.incremental_potential import IncrementalPotential
from engine.yarns.topology import Chain

SUFFICIENT_DECREASE = 1e-4
SHORTEST = 2.0**-14
KEPT_APART = 0.2  # share of a segment's material length that is left after one update


def line_search(
    potential: IncrementalPotential, x: Floats, u: Floats, energy: float, gradient: Floats, direction: Floats
) -> tuple[Floats, Floats, float, Floats] | None:
    """Return the first accepted (x, u, energy, gradient) along `direction` [P, 5], or None.

    x has shape [P, 3], u [N]. A step is accepted for a sufficient decrease of the energy, or for one of the gradient:
    close to the solution, changes of the energy drown in round-off.
    """
    model = potential.model
    dx, du = direction[:, :3], direction[model.node_point, 3 + model.node_slot]
    slope = float(np.sum(gradient * direction))
    alpha = longest_update(potential.chain, u, du)
    norm = np.abs(gradient).max()
    while alpha > SHORTEST:
        x_new, u_new = x + alpha * dx, u + alpha * du
        energy_new, gradient_new = potential.gradient(x_new, u_new)
        if energy_new <= energy + SUFFICIENT_DECREASE * alpha * slope:
            return x_new, u_new, energy_new, gradient_new
        if np.abs(gradient_new).max() <= (1.0 - 0.5 * alpha) * norm:
            return x_new, u_new, energy_new, gradient_new
        alpha *= 0.5
    return None


def longest_update(chain: Chain, u: Floats, du: Floats) -> float:
    """Return the largest share, at most 1, of du [N] that leaves every segment some of its material length."""
    return _longest_update(chain.node, chain.after, u, du)


@njit(cache=True)
def _longest_update(chain, after, u, du):
    alpha = 1.0
    for i in chain:
        j = after[i]
        if j >= 0:
            shrinks = du[i] - du[j]
            room = (1.0 - KEPT_APART) * (u[j] - u[i])
            if alpha * shrinks > room:
                alpha = room / shrinks
    return alpha
