"""Coulomb's law at all contacts of strands that answer linearly, by augmented Lagrangians: Fei 2019, eq. 14.36, solved otherwise.

Sweeps over single contacts, as the paper makes them, come to a stop where strands are taut: all contacts of a strand share its
tension, and the forces between them differ by what only its stretch answers, which is 1e4 times stiffer than its mass. Here a
strand is solved with all of its contacts at once. Contacts are springs of about the stiffness of the strands that they join, cut
off by Coulomb's law; what a spring is short of is added to its force, until springs are at rest where the law wants them
(`cones`). What is left in between is convex and smooth but for kinks: Newton's iterations with conjugate gradients,
preconditioned by the banded factor of every strand with its own ends of contacts (`newton_direction`). Where a step along such a
direction has to be shortened, the secants of friction take the place of its slopes in the next: the first impact of two bundles
took 349 iterations and 8,524 of conjugate gradients, then 190 and 5,343. Limits of friction are those of the round before.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from engine.arrays import Flags, Floats, Ints
from engine.contact.cones import friction, friction_limit, friction_potential, friction_slope, normal_force
from engine.contact.contact_problem import ContactProblem, align, relative, stiffen
from engine.contact.newton_direction import INEXACT, conjugate_gradients, factorise, in_order, stiffness_in_space
from engine.linalg import banded

INNER = 0.3  # of the tolerance, to which rounds go on, so that strands which follow do not stay behind
NEWTON = 30  # iterations in a round
CLOSE, LEFT = 0.1, 0.2  # of the tolerance, or of what the round leaves to the next, that a further iteration may move vertices by
FREE = 5  # rounds, after which limits of friction that swing are damped
SLOW = 0.5  # share of what a contact missed in the round before, above which it gets stiffer
STIFFER, STIFFEST = 4.0, 256.0  # factor by which its largest stiffness grows then, and by which in all
ARMIJO = 1e-4  # share of the slope's promise that a step must keep
SHORTEST = 1e-4  # step below which there is no descent
ROUND_OFF = 1e-13  # of the potential, that passes for no change


class Strands(NamedTuple):
    """Strands that answer linearly from where they are."""

    start: Ints  # strand s has the vertices start[s] ... start[s+1]-1, shape [S+1]
    gradient: Floats  # of their potential, 0 where they are held, shape [V, 4]
    band: Floats  # lower half of their Hessians, as identity where they are held, shape [4V, w+1]
    held: Flags  # shape [V, 4]


class Answer(NamedTuple):
    """What a solution came to."""

    rounds: int
    newton: int
    linear: int  # iterations of conjugate gradients
    error: float  # what w misses of Coulomb's law, in distances of touch
    step: Floats  # what vertices move, shape [V, 4]
    slope: Floats  # of forces by w: normal, and across 11, 12, 22, shape [C, 4]
    stiffness: Floats  # of contacts [N/m], shape [C, 3]
    stuck: Flags  # which contacts were still short of their forces after all rounds, shape [C]


@njit(cache=True, error_model="numpy")
def respond(problem, stiffness, limit, c, force, w, r, slope, tangent):
    """Write the force r [3] of contact c at w [3] and its `slope` (normal, 11, 12, 22); returns its potential [J].

    `force` [3] is the one that the contact has where w is 0, `limit` [N] that of its friction;
    `tangent` is as in `friction_slope`.
    """
    k = stiffness[c]
    r[0], on, potential = normal_force(force[0] - k[0] * w[0], k[0], problem.gap[c], problem.pull[c])
    t1, t2 = force[1] - k[1] * w[1], force[2] - k[2] * w[2]
    r[1], r[2], a = friction(t1, t2, k[1], k[2], limit[c])
    slope[0] = on * k[0]
    slope[1], slope[2], slope[3] = friction_slope(r[1], r[2], k[1], k[2], a, tangent)
    return potential / k[0] + friction_potential(t1, t2, r[1], r[2], k[1], k[2])


@njit(cache=True, error_model="numpy")
def update_limits(problem, stiffness, w, force, limit, change, damped):
    """Write the limits of friction [C] of contacts with `force` at w [C, 3], and their `change` [C].

    Where that is `damped` and goes back on the one before, it is half of what it would be, so that no limit swings for ever.
    """
    for c in range(len(limit)):
        k, r = stiffness[c, 0], force[c, 0]
        wanted = friction_limit(r, r - k * w[c, 0], k, problem.gap[c], problem.friction[c], problem.pull[c])
        share = 0.5 if damped and (wanted - limit[c]) * change[c] < 0.0 else 1.0
        change[c] = share * (wanted - limit[c])
        limit[c] += change[c]


@njit(cache=True, error_model="numpy")
def law_error(problem, stiffness, w, force):
    """Return what w and `force` [C, 3] miss of Coulomb's law at most: w in distances of touch, friction in parts of the force.

    Small friction may miss more, as long as that does not move the masses at the contact by as much of the distance of touch.
    """
    r, slope, limit, largest, part = np.empty(3), np.empty(4), np.zeros(len(force)), 0.0, 0.0
    update_limits(problem, stiffness, w, force, limit, np.zeros(len(force)), False)
    for c in range(len(force)):
        respond(problem, stiffness, limit, c, force[c], w[c], r, slope, True)
        off = whole = 0.0
        for j in range(3):
            largest = max(largest, abs(r[j] - force[c, j]) / (stiffness[c, j] * problem.touch[c]))
            off += (r[j] - force[c, j]) ** 2 if j > 0 else 0.0
            whole += max(r[j] ** 2, force[c, j] ** 2)
        if off > 0.0:
            part = max(part, np.sqrt(off) * min(1.0 / np.sqrt(whole), problem.yielding[c] / problem.touch[c]))
    return largest, part


@njit(cache=True, parallel=True, error_model="numpy")
def displacements(problem, moved, w):
    """Write w [C, 3] of all contacts where vertices move by `moved` [V, >= 3] [m] in the step."""
    for c in prange(len(w)):
        relative(problem, c, moved, w[c])
        for j in range(3):
            for k in range(3):
                w[c, j] -= problem.frame[c, j, k] * problem.carried[c, k]


def solve(
    strands: Strands, problem: ContactProblem, moved: Floats, force: Floats, tolerance: float, most: int,
    penalty: Floats | None = None, inexact: float = 0.0,
) -> Answer:
    """Find the forces at contacts [C, 3] [N] from a first guess that is overwritten.

    Vertices have moved by `moved` [V, 3] [m] in the step where strands are. Rounds end when the law's error is a share INNER of
    the `tolerance`, or a share `inexact` of what the first round moves, or after `most`; it is infinite where a Hessian has no
    factor. Where there is a `penalty` [C] [N/m], contacts are springs of this stiffness and nothing else.
    """
    if not len(force):
        return Answer(0, 0, 0, 0.0, np.zeros_like(strands.gradient), np.zeros((0, 4)), np.zeros((0, 3)), np.zeros(0, np.bool_))
    usual = align(problem, strands.band, strands.held)
    stiffest, stiffness = usual.copy(), np.zeros_like(usual)
    if penalty is not None:
        stiffness[:], force[:], most = penalty[:, None], 0.0, 1
    force[:] = np.einsum("cij,cj->ci", problem.frame, force)
    now = _at_start(strands, problem, moved)
    limit, change, left = np.zeros(len(force)), np.zeros(len(force)), np.full(len(force), np.inf)
    error, goal, rounds, newton, linear, touch = np.inf, INNER * tolerance, 0, 0, 0, problem.touch.min()
    while rounds < most:
        if penalty is None:
            stiffen(problem, stiffest, force, tolerance, stiffness)
        last = now.step
        update_limits(problem, stiffness, now.start + _by(problem, last), force, limit, change, rounds >= FREE)
        now, made, iterations = _newton(strands, problem, stiffness, limit, force, CLOSE * tolerance, now)
        if made == 0:
            return Answer(rounds, newton, linear, np.inf, now.step, now.slope, stiffness, left > goal)
        missed = _missed(problem, stiffness, now.force - force)
        slow = (missed > INNER * tolerance) & (missed > SLOW * left)
        stiffest[slow] = np.minimum(STIFFER * stiffest, STIFFEST * usual)[slow]
        force[:], left = now.force, missed
        rounds, newton, linear = rounds + 1, newton + made, linear + iterations
        error, part = law_error(problem, stiffness, now.w, force) if penalty is None else (0.0, 0.0)
        moves = np.abs(now.step[:, :3] - last[:, :3]).max() / touch
        goal = max(goal, inexact * moves) if rounds == 1 else goal
        if error <= goal and (part <= tolerance or moves <= goal):
            left[:] = 0.0
            break
    return Answer(rounds, newton, linear, error, now.step, now.slope, stiffness, left > goal)


class _Iterate(NamedTuple):
    """Where Newton's iteration is, and its memory; but for `start` and `step`, arrays are written anew in place."""

    start: Floats  # w without a step, shape [C, 3]
    step: Floats  # shape [V, 4]
    w: Floats  # shape [C, 3]
    force: Floats  # that the law leaves of the springs', shape [C, 3]
    slope: Floats  # shape [C, 4]
    residual: Floats  # minus the gradient, shape [V, 4]
    direction: Floats  # shape [V, 4]
    in_space: Floats  # stiffness of contacts [N/m], shape [C, 3, 3]
    factor: Floats  # of strands with their own ends of contacts, shape [4V, 11]


def _at_start(strands: Strands, problem: ContactProblem, moved: Floats) -> _Iterate:
    contacts, vertices = len(problem.gap), strands.gradient.shape
    start = np.empty((contacts, 3))
    displacements(problem, moved, start)
    return _Iterate(
        start, np.zeros(vertices), w=np.empty_like(start), force=np.empty_like(start), slope=np.empty((contacts, 4)),
        residual=np.zeros(vertices), direction=np.zeros(vertices), in_space=np.empty((contacts, 3, 3)),
        factor=np.empty_like(strands.band))


def _newton(
    strands: Strands, problem: ContactProblem, stiffness: Floats, limit: Floats, force: Floats, close: float, now: _Iterate
) -> tuple[_Iterate, int, int]:
    """Return where the potential of a round is least, and iterations of Newton (0: no factor) and of conjugate gradients.

    A vertex may still move by what is `close`, in distances of touch, or by a share LEFT of what the round leaves to the next.
    """
    linear, touch = 0, problem.touch.min()

    def evaluated(step: Floats, tangent: bool) -> float:
        return evaluate(
            strands, problem, stiffness, limit, force, now.start, step, now.w, now.force, now.slope, now.residual, tangent)

    value = evaluated(now.step, True)
    for iteration in range(NEWTON):
        stiffness_in_space(problem, now.slope, now.in_space)
        if not factorise(strands, problem, now.in_space, now.factor):
            return now, 0, linear
        linear += conjugate_gradients(strands, problem, now.in_space, now.factor, now.residual, now.direction)
        promised, far = -np.sum(now.residual * now.direction), np.abs(now.direction[:, :3]).max() / touch
        slope, alpha, step = now.slope.copy(), 1.0, now.step + now.direction
        reached = evaluated(step, True)
        while reached > value + ARMIJO * alpha * promised + ROUND_OFF * abs(value) and alpha >= SHORTEST:
            alpha *= 0.5
            step = now.step + alpha * now.direction
            reached = evaluated(step, False)
        now, value = now._replace(step=step), reached
        enough = max(close, LEFT * _missed(problem, stiffness, now.force - force).max())
        if far <= enough or (alpha == 1.0 and INEXACT * far <= enough and np.array_equal(now.slope, slope)):
            return now, iteration + 1, linear
    return now, NEWTON, linear


def _missed(problem: ContactProblem, stiffness: Floats, force: Floats) -> Floats:
    """What springs of a `stiffness` [C, 3] are short of for `force` [C, 3] more, in distances of touch, shape [C]."""
    return (np.abs(force) / (stiffness * problem.touch[:, None])).max(axis=1)


def _by(problem: ContactProblem, step: Floats) -> Floats:
    """What a step [V, 4] changes of w, shape [C, 3]."""
    w = np.empty((len(problem.gap), 3))
    displacements(problem._replace(carried=np.zeros_like(w)), step, w)
    return w


@njit(cache=True, parallel=True, error_model="numpy")
def evaluate(strands, problem, stiffness, limit, force, start, step, w, r, slope, residual, tangent):
    """Write w, forces r and their slopes where strands take a `step` [V, 4], and what is left over; returns the potential.

    `start` [C, 3] is w without a step. The `residual` [V, 4] is minus the gradient.
    """
    energy, potential = np.empty(len(problem.strand)), np.empty(len(w))
    for c in prange(len(w)):
        relative(problem, c, step, w[c])
        for j in range(3):
            w[c, j] += start[c, j]
        potential[c] = respond(problem, stiffness, limit, c, force[c], w[c], r[c], slope[c], tangent)
    for i in prange(len(problem.strand)):
        first, last = strands.start[problem.strand[i]], strands.start[problem.strand[i] + 1]
        banded.multiply(strands.band[4 * first : 4 * last], step[first:last].reshape(-1), residual[first:last].reshape(-1))
        energy[i] = 0.0
        for v in range(first, last):
            for k in range(4):
                energy[i] += step[v, k] * (strands.gradient[v, k] + 0.5 * residual[v, k])
                residual[v, k] = -strands.gradient[v, k] - residual[v, k]
        _add_forces(strands, problem, i, r, residual)
    return in_order(energy) + in_order(potential)


@njit(cache=True, error_model="numpy")
def _add_forces(strands, problem, i, force, total):
    """Add what forces at contacts [C, 3], in their frames, do to strand number i of those in contact to `total` [V, 4]."""
    for p in range(problem.first[i], problem.first[i + 1]):
        c, e = problem.place[p, 0], problem.place[p, 1]
        v = problem.vertex[c, e]
        for k in range(3):
            if not strands.held[v, k]:
                along = 0.0
                for j in range(3):
                    along += problem.frame[c, j, k] * force[c, j]
                total[v, k] += problem.weight[c, e] * along
