"""Newton's iteration of one implicit step, for every strand by itself (Fei 2019, sec. 14.1)."""

import numpy as np
from numba import njit, prange

from engine.linalg import banded
from engine.strands import potential
from engine.strands import springs as held

PIECES = 64  # of work; a strand's result does not depend on them
ARMIJO = 1e-4  # share of the slope's promise that a step along the direction must keep
ROUND_OFF = 1e-13  # of the potential, that passes for no change, like what rounding the places makes of it
MOST = 1e-6  # of the positive form's largest diagonal entry, that is added to it before there is no descent
SHORTEST = 1e-6  # share of the longest step below which there is no descent
EDGE_CHANGE = 0.8  # of its length, at most, that an edge changes in an iteration: so it has a direction and turns by 53 degrees


@njit(cache=True, parallel=True, error_model="numpy")
def advance(
    model, inertia, springs, which, x0, m1_0, twist0, tolerance, max_newton, x, m1, turned, twist, converged, iterations,
    residual,
):
    """Solve the step from (x0, m1_0, twist0) into (x, m1, turned, twist) of every strand that is among `which` [S].

    Before, x and `turned` hold a first guess of the places and turns, which for those that are held is the last. `iterations` are
    added to.
    """
    start = model.start
    strands = len(start) - 1
    longest = (start[1:] - start[:-1]).max()
    for piece in prange(PIECES):
        step, now, other = potential.step_of(longest), potential.geometry(longest), potential.geometry(longest)
        band, local = np.empty((4 * longest, banded.WIDTH + 1)), np.empty((12, 8))
        g, direction, x_trial = np.empty((longest, 4)), np.empty((longest, 4)), np.empty((longest, 3))
        turn, turned_trial = np.empty(longest), np.empty(longest)
        for s in range(piece * strands // PIECES, (piece + 1) * strands // PIECES):
            if not which[s]:
                continue
            a, b = start[s], start[s + 1]
            n = b - a
            own, shape = potential.first_of_step(step, n), potential.first_of_geometry(now, n)
            shape_tried = potential.first_of_geometry(other, n)
            potential.begin(model, inertia, s, x0[a:b], m1_0[a:b], twist0[a:b], own, shape, shape_tried)
            vectors = (g[:n], direction[:n], x_trial[:n], turn[:n], turned_trial[:n])
            converged[s], made, residual[s] = newton(
                own, springs, s, a, shape, shape_tried, vectors, band[: 4 * n], local, inertia.effective[a], tolerance,
                max_newton, x[a:b], m1[a:b], turned[a:b], twist[a:b])
            iterations[s] += made


@njit(cache=True, error_model="numpy")
def newton(step, springs, s, start, now, trial, vectors, band, local, h, tolerance, max_newton, x, m1, turned, twist):
    """Solve the step of strand s; returns whether it converged, the iterations, and the residual force over the scale of forces.

    x and `turned` are as in `advance`. `start` is its first vertex, `now` its shape at the start; `trial`, `vectors`, `band`
    [4V, 11] and `local` [12, 8] are memory.
    """
    g, direction, x_trial, turn, turned_trial = vectors
    potential.follow(x, turned, now, trial)
    now, trial = trial, now
    value = potential.energy(x, turned, now, step, h) + held.energy(springs, s, start, x)
    if not np.isfinite(value):
        return False, 0, np.inf
    iteration = 0
    while True:
        potential.gradient(x, turned, now, step, h, local[0], g)
        pull = held.add_gradient(springs, s, start, x, step.held, g)
        scale = max(potential.force_scale(now, step), pull, potential.round_off(x, step, h) / tolerance)
        residual = largest_force(g, now.length) / scale
        if residual == 0.0 or (residual <= tolerance and iteration > 0) or iteration == max_newton:  # a small step is one, too
            break
        noise = ROUND_OFF * abs(value) + potential.rounding(x) * scale
        slope = descent(now, step, springs, s, start, h, g, local, band, direction)
        alpha = longest = longest_step(x, direction)
        if not slope < 0.0:
            return False, iteration, residual
        while True:
            for i in range(len(x)):
                for k in range(3):
                    x_trial[i, k] = x[i, k] + alpha * direction[i, k]
                turn[i] = alpha * direction[i, 3]
                turned_trial[i] = turned[i] + turn[i]
            potential.follow(x_trial, turn, now, trial)
            reached = potential.energy(x_trial, turned_trial, trial, step, h) + held.energy(springs, s, start, x_trial)
            if reached <= value + ARMIJO * alpha * slope + noise:
                break
            alpha *= 0.5
            if alpha < SHORTEST * longest:
                return False, iteration, residual
        x[:], turned[:] = x_trial, turned_trial
        now, trial, value = trial, now, reached
        iteration += 1
    m1[:-1], twist[1:-1] = now.m1[:-1], now.twist[1:-1]
    turned[-1] = 0.0
    return residual <= tolerance, iteration, residual


@njit(cache=True, error_model="numpy")
def descent(now, step, springs, s, start, h, g, local, band, direction):
    """Write Newton's direction [V, 4], with the positive form of the Hessian where the true one is not; returns its slope.

    The slope is infinite where not even the positive form can be factorised.
    """
    if not factorise(now, step, springs, s, start, h, local, band):
        return np.inf
    for i in range(len(g)):
        for k in range(4):
            direction[i, k] = -g[i, k]
    banded.solve(band, direction.reshape(-1))
    slope = 0.0
    for i in range(len(g)):
        for k in range(4):
            slope += g[i, k] * direction[i, k]
    return slope


@njit(cache=True, error_model="numpy")
def factorise(now, step, springs, s, start, h, local, band):
    """Write the factor of the Hessian, or of its positive form where that has none; returns whether there is one."""
    potential.hessian(now, step, h, False, local, band)
    held.add_hessian(springs, s, start, step.held, band)
    if banded.factorise(band):
        return True
    potential.hessian(now, step, h, True, local, band)
    held.add_hessian(springs, s, start, step.held, band)
    shift = potential.EPSILON * band[:, 0].max()
    while not banded.factorise(band):  # rounding makes it indefinite where an edge is folded
        potential.hessian(now, step, h, True, local, band)
        held.add_hessian(springs, s, start, step.held, band)
        band[:, 0] += shift
        shift *= 10.0
        if not shift < MOST * band[:, 0].max():
            return False
    return True


@njit(cache=True, error_model="numpy")
def longest_step(x, direction):
    """Share of the direction, 1 at most, within which no edge changes by more than EDGE_CHANGE of its length."""
    share = 1.0
    for i in range(len(x) - 1):
        square, change = 0.0, 0.0
        for k in range(3):
            square += (x[i + 1, k] - x[i, k]) ** 2
            change += (direction[i + 1, k] - direction[i, k]) ** 2
        if share * share * change > EDGE_CHANGE * EDGE_CHANGE * square:
            share = EDGE_CHANGE * np.sqrt(square / change)
    return share


@njit(cache=True, error_model="numpy")
def largest_force(g, length):
    """Largest component of the gradient [V, 4] [N], couples as forces at the edge's length."""
    largest = 0.0
    for i in range(len(g)):
        for k in range(3):
            largest = max(largest, abs(g[i, k]))
        if i < len(g) - 1:
            largest = max(largest, abs(g[i, 3]) / length[i])
    return largest
