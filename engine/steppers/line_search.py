"""Backtracking along a Newton direction that keeps EoL nodes in order."""

import numpy as np
from numba import njit

from engine.arrays import Floats
from engine.steppers.incremental_potential import IncrementalPotential
from engine.yarns.topology import Chain

SUFFICIENT_DECREASE = 1e-4
SHORTEST = 2.0**-14
ON_TREND = 0.1  # of the slope at the start: what a doubled step must at least gain for its way
KEPT_APART = 0.2  # share of a segment's material length that is left after one update


def line_search(
    potential: IncrementalPotential, x: Floats, u: Floats, energy: float, gradient: Floats, direction: Floats,
    further: bool = False,
) -> tuple[Floats, Floats, float, Floats] | None:
    """Return the first accepted (x, u, energy, gradient) along `direction` [P, 5], or None.

    x has shape [P, 3], u [N]. A step is accepted for a sufficient decrease of the energy, or for one of the gradient:
    close to the solution, changes of the energy drown in round-off. With `further` a step that is accepted at once is
    doubled for as long as the energy falls as without curvature: where that is negative, its positive form makes steps far
    too short.
    """
    model = potential.model
    dx, du = direction[:, :3], direction[model.node_point, 3 + model.node_slot]
    slope = float(np.sum(gradient * direction))
    alpha = longest = longest_update(potential.chain, u, du)
    norm = np.abs(gradient).max()
    while alpha > SHORTEST:
        x_new, u_new = x + alpha * dx, u + alpha * du
        energy_new, gradient_new = potential.gradient(x_new, u_new)
        decreases = energy_new <= energy + SUFFICIENT_DECREASE * alpha * slope
        if decreases and further and alpha == longest == 1.0:
            return _furthest(potential, x, u, dx, du, slope, (x_new, u_new, energy_new, gradient_new))
        if decreases or np.abs(gradient_new).max() <= (1.0 - 0.5 * alpha) * norm:
            return x_new, u_new, energy_new, gradient_new
        alpha *= 0.5
    return None


def _furthest(
    potential: IncrementalPotential, x: Floats, u: Floats, dx: Floats, du: Floats, slope: float,
    found: tuple[Floats, Floats, float, Floats],
) -> tuple[Floats, Floats, float, Floats]:
    """Return what is found by doubling the update (dx, du) from (x, u), of which `found` is the end, while the energy falls."""
    alpha = 2.0
    while longest_update(potential.chain, u, alpha * du) == 1.0:
        x_new, u_new = x + alpha * dx, u + alpha * du
        energy_new, gradient_new = potential.gradient(x_new, u_new)
        if not energy_new <= found[2] + ON_TREND * 0.5 * alpha * slope:
            x_new, u_new = found[:2]
            return x_new, u_new, *potential.gradient(x_new, u_new)  # anew, for what the potential keeps of it
        found, alpha = (x_new, u_new, energy_new, gradient_new), 2.0 * alpha
    return found


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
