"""Contacts of strands as a problem of linear algebra: which unknowns they join, in which directions, and how stiff these are."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from engine.arrays import Floats, Ints
from engine.contact.strand_contacts import Contacts
from engine.strands.springs import Springs

STIFF = 10.0  # stiffness of contacts over that of the strands, where the rest of them is held, or over that of their mass
RIGID = 1e9  # stiffness of what is held, over that of the same vertex in other directions


class ContactProblem(NamedTuple):
    """C contacts: w = sum of weight * displacement of four vertices - carried, as components in the frame of each."""

    vertex: Ints  # shape [C, 4]
    weight: Floats  # shape [C, 4]
    frame: Floats  # rows are the normal and two directions across, shape [C, 3, 3]
    gap: Floats  # [m], shape [C]
    carried: Floats  # [m], shape [C, 3]
    friction: Floats  # shape [C]
    pull: Floats  # that holds sides together which would part [N], shape [C]
    touch: Floats  # [m], shape [C]
    yielding: Floats  # what a force moves the masses at the contact by in the step [m/N], shape [C]
    strand: Ints  # with contacts, ascending, shape [A]
    first: Ints  # places on strand[i] are first[i] ... first[i+1]-1 of `place`, shape [A + 1]
    place: Ints  # contact and which of its vertices, shape [P, 2]


def contact_problem(contacts: Contacts, strand: Ints, pull: Floats, compliance: Floats) -> ContactProblem:
    """Return the problem of contacts; `strand` [V] is that of vertices, `pull` [C] is in N.

    `compliance` [V] is what a force moves a vertex by in the step that nothing else holds [m/N].
    """
    solid = contacts.edge[:, 1] < 0
    edge = np.where(solid[:, None], contacts.edge[:, :1], contacts.edge)
    share = contacts.share
    weight = np.column_stack([1.0 - share[:, 0], share[:, 0], share[:, 1] - 1.0, -share[:, 1]])
    weight[solid, 2:] = 0.0
    vertex = np.column_stack([edge[:, 0], edge[:, 0] + 1, edge[:, 1], edge[:, 1] + 1])
    frame = _frames(contacts.normal)
    acts = np.argwhere(weight != 0.0)
    on = strand[vertex[acts[:, 0], acts[:, 1]]]
    order = np.argsort(on, kind="stable")
    touched, first = np.unique(on[order], return_index=True)
    return ContactProblem(
        vertex=vertex, weight=weight, frame=frame, gap=contacts.apart - contacts.kept,
        carried=contacts.carried, friction=contacts.friction, pull=pull, touch=contacts.touch,
        yielding=(weight**2 * compliance[vertex]).sum(axis=1),
        strand=touched, first=np.append(first, len(order)), place=acts[order],
    )


def _frames(normal: Floats) -> Floats:
    """Frames whose first rows are unit normals [C, 3], shape [C, 3, 3]."""
    least = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    first = np.cross(normal, least)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([normal, first, np.cross(normal, first)], axis=1)


@njit(cache=True, parallel=True, error_model="numpy")
def align(problem, band, held):
    """Turn the frames so that contacts are softest in one direction across the normal; returns their largest stiffness [C, 3].

    It is, in N/m, in proportion to that of their strands, whose Hessians are `band` [4V, w+1], where all but one vertex is held
    at a time, and what is `held` [V, 4]. What vertices yield adds up: strands that cross are soft along each other, for neither
    can hold the other.
    """
    stiffness = np.empty((len(problem.gap), 3))
    for c in prange(len(problem.gap)):
        frame, soft = problem.frame[c], np.empty((3, 3))
        _softness(problem, band, held, c, soft)
        angle = 0.5 * np.arctan2(2.0 * soft[1, 2], soft[1, 1] - soft[2, 2])
        cosine, sine = np.cos(angle), np.sin(angle)
        middle, half = 0.5 * (soft[1, 1] + soft[2, 2]), np.hypot(0.5 * (soft[1, 1] - soft[2, 2]), soft[1, 2])
        for k in range(3):
            first, second = frame[1, k], frame[2, k]
            frame[1, k], frame[2, k] = cosine * first + sine * second, cosine * second - sine * first
        stiffness[c, 0] = STIFF / soft[0, 0]
        stiffness[c, 1], stiffness[c, 2] = STIFF / (middle + half), STIFF / (middle - half)
    return stiffness


@njit(cache=True, error_model="numpy")
def _softness(problem, band, held, c, soft):
    """Write what contact c yields to a unit force in its frame [3, 3] [m/N]: the sum of what its vertices do one by one."""
    soft[:] = 0.0
    own, inverse = np.empty((3, 3)), np.empty((3, 3))
    for e in range(4):
        v, square = problem.vertex[c, e], problem.weight[c, e] ** 2
        if square == 0.0 or (held[v, 0] and held[v, 1] and held[v, 2]):
            continue
        for a in range(3):
            for b in range(3):
                own[a, b] = band[4 * v + min(a, b), abs(a - b)]
            if held[v, a]:
                own[a, a] = RIGID * max(band[4 * v, 0], band[4 * v + 1, 0], band[4 * v + 2, 0])
        _invert(own, inverse)
        for i in range(3):
            for j in range(3):
                for a in range(3):
                    for b in range(3):
                        soft[i, j] += square * problem.frame[c, i, a] * inverse[a, b] * problem.frame[c, j, b]


@njit(cache=True, error_model="numpy")
def _invert(a, inverse):
    """Write the inverse of a matrix [3, 3]."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for m in range(3):
            n, o = (m + 1) % 3, (m + 2) % 3
            inverse[m, i] = a[j, n] * a[k, o] - a[j, o] * a[k, n]
    determinant = a[0, 0] * inverse[0, 0] + a[0, 1] * inverse[1, 0] + a[0, 2] * inverse[2, 0]
    inverse[:] /= determinant


@njit(cache=True, error_model="numpy")
def stiffen(problem, most, force, tolerance, stiffness):
    """Raise the stiffness of contacts [C, 3] [N/m] so that their force [C, 3] [N] moves them by no more than is tolerated.

    That is `tolerance` distances of touch. Stiffer than needed, the law would have kinks too sharp for Newton's iterations. It is
    no less than is in proportion to the masses at the contact, and no more than the `most` [C, 3] of `align`.
    """
    for c in range(len(force)):
        size = np.sqrt(force[c, 0] ** 2 + force[c, 1] ** 2 + force[c, 2] ** 2)
        wanted = max(STIFF / problem.yielding[c], size / (tolerance * problem.touch[c]))
        for i in range(3):
            stiffness[c, i] = max(stiffness[c, i], min(most[c, i], wanted))


@njit(cache=True, error_model="numpy")
def relative(problem, c, moved, w):
    """Write w [3] of contact c, in its frame, where vertices move by `moved` [V, >= 3] [m], but for what is carried."""
    w[:] = 0.0
    for e in range(4):
        v = problem.vertex[c, e]
        for j in range(3):
            f = problem.frame[c, j]
            w[j] += problem.weight[c, e] * (f[0] * moved[v, 0] + f[1] * moved[v, 1] + f[2] * moved[v, 2])


def springs_of(contacts: Contacts, problem: ContactProblem, force: Floats, slope: Floats, x: Floats, strand: Ints) -> Springs:
    """Return what contacts are to each of their strands while the other side stays where vertices are at x [V, 3] [m].

    `force` [C, 3] [N] is in the frames, and `slope` [C, 4] [N/m] what it falls by: along the normal, and across 11, 12, 22.
    """
    acts = np.any(force != 0.0, axis=1) | np.any(slope != 0.0, axis=1)
    contacts, force, slope, frame = contacts.those(acts), force[acts], slope[acts], problem.frame[acts]
    push = np.einsum("cij,ci->cj", frame, force)
    local = np.zeros((len(force), 3, 3))
    local[:, 0, 0], local[:, 1, 1], local[:, 2, 2] = slope[:, 0], slope[:, 1], slope[:, 3]
    local[:, 1, 2] = local[:, 2, 1] = slope[:, 2]
    stiffness = np.einsum("cia,cij,cjb->cab", frame, local, frame)
    second = contacts.edge[:, 1] >= 0
    vertex = np.concatenate([contacts.edge[:, 0], contacts.edge[second, 1]])
    share = np.concatenate([contacts.share[:, 0], contacts.share[second, 1]])
    order = np.argsort(strand[vertex], kind="stable")
    vertex, share = vertex[order], share[order]
    return Springs(
        first=np.searchsorted(strand[vertex], np.arange(strand[-1] + 2)), vertex=vertex, share=share,
        anchor=(1.0 - share[:, None]) * x[vertex] + share[:, None] * x[vertex + 1],
        force=np.concatenate([push, -push[second]])[order], stiffness=np.concatenate([stiffness, stiffness[second]])[order],
    )
