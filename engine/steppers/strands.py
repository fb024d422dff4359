"""One implicit Euler step of discrete elastic rods, every strand by a Newton iteration of its own (Fei 2019, sec. 14.1)."""

import numpy as np
from numba import njit, prange

from engine.arrays import Floats
from engine.linalg import banded
from engine.steppers.step_report import StepReport, Stopwatch
from engine.strands import potential
from engine.strands.loads import StrandLoads, inertia
from engine.strands.model import StrandModel, StrandState

PIECES = 64  # of work; a strand's result does not depend on them
ARMIJO = 1e-4  # share of the slope's promise that a step along the direction must keep
ROUND_OFF = 1e-13  # of the potential, that passes for no change
MOST = 1e-6  # of the positive form's largest diagonal entry, that is added to it before there is no descent
SHORTEST = 1e-6  # share of the longest step below which there is no descent
EDGE_CHANGE = 0.8  # of its length, at most, that an edge changes in an iteration: so it has a direction and turns by 53 degrees


class StrandStepper:
    """Advances strands, one step at a time."""

    def __init__(self, model: StrandModel, gravity: Floats, tolerance: float = 1e-6, max_newton: int = 50):
        """Keep what does not change between steps; `gravity` [3] in m/s^2.

        Newton ends where no residual force is more than `tolerance` of the largest weight or force within the strand, or than
        rounding its places makes; where this takes more than `max_newton` iterations, the step is rejected.
        """
        self.model, self.tolerance, self.max_newton = model, tolerance, max_newton
        self.gravity = np.asarray(gravity, np.float64)
        self.iterations = np.zeros(len(model.start) - 1, np.int64)  # of every strand in the last step

    def step(
        self, state: StrandState, h: float, loads: StrandLoads | None = None, given: tuple[Floats, Floats] | None = None
    ) -> StepReport:
        """Advance `state` by `h` [s]; a rejected step leaves it as it was.

        `given` are the places [V, 3] [m] at which held vertices end, and the angles [V] [rad] by which held edges turn about
        themselves beyond what being carried along does; without it they stay.
        """
        report, watch = StepReport(), Stopwatch()
        strands = len(self.model.start) - 1
        moved = inertia(self.model, state, loads or StrandLoads(), self.gravity, h)
        x, turn = (state.x, np.zeros(len(state.x))) if given is None else given
        after = StrandState(x.copy(), np.zeros_like(x), np.zeros_like(x), turn.copy(), np.zeros_like(turn))
        converged, residual = np.zeros(strands, np.bool_), np.full(strands, np.inf)
        watch.lap("predict")
        advance(self.model, moved, state.x, state.m1, state.spin, state.twist, h, self.tolerance, self.max_newton,
                after.x, after.m1, after.spin, after.twist, converged, self.iterations, residual)
        watch.lap("solve")
        report.newton_iterations, report.stages = int(self.iterations.max(initial=0)), watch.laps
        report.residual = float(residual.max(initial=0.0))
        if not converged.all():
            most = report.newton_iterations == self.max_newton
            report.reason = "Newton did not converge" if most else "the line search found no descent"
            return report
        after.velocity = (after.x - state.x) / h
        vars(state).update(vars(after))
        report.accepted = True
        return report


@njit(cache=True, parallel=True, error_model="numpy")
def advance(
    model, inertia, x0, m1_0, spin0, twist0, h, tolerance, max_newton, x, m1, spin, twist, converged, iterations, residual
):
    """Solve every strand's step from (x0, m1_0, spin0, twist0) into (x, m1, spin, twist).

    Before, x holds the places of held vertices and `spin` the turns of held edges.
    """
    start = model.start
    strands = len(start) - 1
    longest = (start[1:] - start[:-1]).max()
    for piece in prange(PIECES):
        step, now, other = potential.step_of(longest), potential.geometry(longest), potential.geometry(longest)
        band, local = np.empty((4 * longest, potential.WIDTH + 1)), np.empty((12, 8))
        g, direction, x_trial = np.empty((longest, 4)), np.empty((longest, 4)), np.empty((longest, 3))
        turn, turned, turned_trial = np.empty(longest), np.empty(longest), np.empty(longest)
        for s in range(piece * strands // PIECES, (piece + 1) * strands // PIECES):
            a, b = start[s], start[s + 1]
            n = b - a
            own, shape = potential.first_of_step(step, n), potential.first_of_geometry(now, n)
            potential.begin(model, inertia, a, x0[a:b], m1_0[a:b], spin0[a:b], twist0[a:b], h, own, shape)
            vectors = (g[:n], direction[:n], x_trial[:n], turn[:n], turned[:n], turned_trial[:n])
            converged[s], iterations[s], residual[s] = newton(
                own, shape, potential.first_of_geometry(other, n), vectors, band[: 4 * n], local, h, tolerance, max_newton,
                x[a:b], m1[a:b], spin[a:b], twist[a:b])


@njit(cache=True, error_model="numpy")
def newton(step, now, trial, vectors, band, local, h, tolerance, max_newton, x, m1, spin, twist):
    """Solve one strand's step; returns whether it converged, the iterations, and the residual force over the scale of forces.

    `now` is its shape at the start; `trial`, `vectors`, `band` [4V, 11] and `local` [12, 8] are memory.
    """
    g, direction, x_trial, turn, turned, turned_trial = vectors
    for i in range(len(x)):
        for k in range(3):
            if not step.held[i, k]:
                x[i, k] = step.start[i, k]
        turned[i] = turn[i] = spin[i] if step.held[i, 3] else 0.0
    potential.follow(x, turn, now, trial)
    now, trial = trial, now
    value = potential.energy(x, turned, now, step, h)
    if not np.isfinite(value):
        return False, 0, np.inf
    iteration = 0
    while True:
        potential.gradient(x, turned, now, step, h, local[0], g)
        scale = max(potential.force_scale(now, step), potential.round_off(x, step, h) / tolerance)
        residual = largest_force(g, now.length) / scale
        if residual <= tolerance or iteration == max_newton:
            break
        slope = descent(now, step, h, g, local, band, direction)
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
            reached = potential.energy(x_trial, turned_trial, trial, step, h)
            if reached <= value + ARMIJO * alpha * slope + ROUND_OFF * abs(value):
                break
            alpha *= 0.5
            if alpha < SHORTEST * longest:
                return False, iteration, residual
        x[:], turned[:] = x_trial, turned_trial
        now, trial, value = trial, now, reached
        iteration += 1
    m1[:-1], spin[:-1], twist[1:-1] = now.m1[:-1], turned[:-1] / h, now.twist[1:-1]
    spin[-1] = 0.0
    return residual <= tolerance, iteration, residual


@njit(cache=True, error_model="numpy")
def descent(now, step, h, g, local, band, direction):
    """Write Newton's direction [V, 4], with the positive form of the Hessian where the true one is not; returns its slope.

    The slope is infinite where not even the positive form can be factorised.
    """
    potential.hessian(now, step, h, False, local, band)
    if not banded.factorise(band):
        potential.hessian(now, step, h, True, local, band)
        shift = potential.EPSILON * band[:, 0].max()
        while not banded.factorise(band):  # rounding makes it indefinite where an edge is folded
            potential.hessian(now, step, h, True, local, band)
            band[:, 0] += shift
            shift *= 10.0
            if not shift < MOST * band[:, 0].max():
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
