"""Sweeps over single contacts, block Gauss-Seidel in Fei 2019, sec. 13.6 and 14.1: what the engine's solver is compared with.

Each contact in turn takes the force that Coulomb's law wants while all others keep theirs; strands answer to it exactly.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.linalg import solveh_banded

from engine.arrays import Floats, Ints
from engine.contact.augmented_lagrangian import Strands, respond
from engine.contact.cones import friction_limit
from engine.contact.contact_problem import ContactProblem, relative

CLOSE = 1e-12  # distances of touch that the law still asks for in a contact by itself
MOST = 200  # projections that find its force


class Delassus(NamedTuple):
    """What forces at contacts move contacts by, with V vertices, the longest strand of L; what is held does not move."""

    first: Ints  # vertex of the same strand, shape [V]
    last: Ints  # vertex of the same strand, shape [V]
    answer: Floats  # what forces at a vertex, by component, move those from `first` on by [m/N], shape [V, 3, L, 3]
    free: Floats  # what vertices move by in the step without forces at contacts [m], shape [V, 3]
    own: Floats  # what a contact's force moves it by, in its frame [m/N], shape [C, 3, 3]
    stiffness: Floats  # of projections that converge with it: no more than it in any direction [N/m], shape [C, 3]
    carried: Floats  # what solids carry contacts by, in their frames [m], shape [C, 3]


def delassus(strands: Strands, problem: ContactProblem, moved: Floats) -> Delassus:
    """Return the operator of strands whose vertices have moved by `moved` [V, 3] [m] in the step where they are."""
    count = np.diff(strands.start)
    first, last = np.repeat(strands.start[:-1], count), np.repeat(strands.start[1:] - 1, count)
    answer, free = np.zeros((len(first), 3, count.max(), 3)), moved.copy()
    for s in problem.strand:
        a, b, n = strands.start[s], strands.start[s + 1], count[s]
        loads = np.column_stack([np.eye(4 * n), -strands.gradient[a:b].reshape(-1)])
        moves = solveh_banded(strands.band[4 * a : 4 * b].T, loads, lower=True).reshape(n, 4, -1)
        loose = ~strands.held[a:b, :3]
        inverse = moves[:, :3, :-1].reshape(n, 3, n, 4)[..., :3]
        answer[a:b, :, :n] = np.where(loose[:, :, None, None] & loose, inverse, 0.0)
        free[a:b] += moves[:, :3, -1]
    v, u = problem.vertex[:, :, None], problem.vertex[:, None, :]
    between = answer[v, :, np.where(first[v] == first[u], u - first[u], 0)] * (first[v] == first[u])[..., None, None]
    own = np.einsum("ce,cf,cia,cefab,cjb->cij", problem.weight, problem.weight, problem.frame, between, problem.frame,
                    optimize=True)
    return Delassus(first, last, answer, free, own, stiffness=1.0 / (3.0 * np.einsum("cii->ci", own)),
                    carried=np.einsum("cij,cj->ci", problem.frame, problem.carried))


@njit(cache=True, error_model="numpy")
def answered(problem, operator, force):
    """Return what vertices move by in the step [m], shape [V, 3], under `force` [C, 3] [N] in the frames of contacts."""
    moved = operator.free.copy()
    for c in range(len(force)):
        _push(problem, operator, c, force[c], moved)
    return moved


@njit(cache=True, error_model="numpy")
def sweep(problem, operator, force, moved):
    """Let each contact by itself keep Coulomb's law: changes `force` [C, 3] [N] and what vertices have `moved` [V, 3] [m]."""
    stiffness, limit, w = operator.stiffness, np.empty(len(force)), np.empty(3)
    before, after, slope = np.empty(3), np.empty(3), np.empty(4)
    for c in range(len(force)):
        relative(problem, c, moved, w)
        w -= operator.carried[c]
        before[:] = force[c]
        for _ in range(MOST):
            r, k = force[c, 0], stiffness[c, 0]
            limit[c] = friction_limit(r, r - k * w[0], k, problem.gap[c], problem.friction[c], problem.pull[c])
            respond(problem, stiffness, limit, c, force[c], w, after, slope, True)
            off = 0.0
            for j in range(3):
                change = after[j] - force[c, j]
                force[c, j] = after[j]
                off = max(off, abs(change) / (stiffness[c, j] * problem.touch[c]))
                for i in range(3):
                    w[i] += operator.own[c, i, j] * change
            if off <= CLOSE:
                break
        _push(problem, operator, c, force[c] - before, moved)


@njit(cache=True, error_model="numpy")
def _push(problem, operator, c, force, moved):
    """Add what a `force` [3] at contact c, in its frame, moves its strands by to `moved` [V, 3]."""
    if force[0] == 0.0 and force[1] == 0.0 and force[2] == 0.0:
        return
    for e in range(4):
        v = problem.vertex[c, e]
        first, last, frame = operator.first[v], operator.last[v], problem.frame[c]
        for a in range(3):
            along = frame[0, a] * force[0] + frame[1, a] * force[1] + frame[2, a] * force[2]
            load = problem.weight[c, e] * along
            for u in range(first, last + 1):
                for b in range(3):
                    moved[u, b] += load * operator.answer[v, a, u - first, b]
