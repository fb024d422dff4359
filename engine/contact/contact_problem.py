"""Contacts of strands as a problem of linear algebra: which unknowns they join, in which directions, and how stiff these are."""

from typing import NamedTuple

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints
from engine.contact.strand_contacts import Contacts

STIFF = 10.0  # stiffness of contacts over that of the strands, where the rest of them is held


class ContactProblem(NamedTuple):
    """C contacts: w = sum of weight * displacement of four vertices - carried, in the frame of each."""

    vertex: Ints  # shape [C, 4]
    weight: Floats  # shape [C, 4]
    frame: Floats  # rows are the normal and two directions across, shape [C, 3, 3]
    gap: Floats  # [m], shape [C]
    carried: Floats  # in the frame [m], shape [C, 3]
    friction: Floats  # shape [C]
    pull: Floats  # that holds sides together which would part [N], shape [C]
    touch: Floats  # [m], shape [C]
    strand: Ints  # with contacts, ascending, shape [A]
    first: Ints  # places on strand[i] are first[i] ... first[i+1]-1 of `place`, shape [A + 1]
    place: Ints  # contact and which of its vertices, shape [P, 2]


def contact_problem(contacts: Contacts, strand: Ints, x: Floats, pull: Floats) -> ContactProblem:
    """Return the problem of contacts; `strand` [V] and x [V, 3] are those of vertices, `pull` [C] is in N.

    The first direction across the normal is the one along the strands, in which they are stiff.
    """
    solid = contacts.edge[:, 1] < 0
    edge = np.where(solid[:, None], contacts.edge[:, :1], contacts.edge)
    share = contacts.share
    weight = np.column_stack([1.0 - share[:, 0], share[:, 0], share[:, 1] - 1.0, -share[:, 1]])
    weight[solid, 2:] = 0.0
    vertex = np.column_stack([edge[:, 0], edge[:, 0] + 1, edge[:, 1], edge[:, 1] + 1])
    frame = _frames(contacts.normal, x[edge + 1] - x[edge])
    acts = np.argwhere(weight != 0.0)
    on = strand[vertex[acts[:, 0], acts[:, 1]]]
    order = np.argsort(on, kind="stable")
    touched, first = np.unique(on[order], return_index=True)
    return ContactProblem(
        vertex=vertex, weight=weight, frame=frame, gap=contacts.apart - contacts.kept,
        carried=np.einsum("cij,cj->ci", frame, contacts.carried), friction=contacts.friction, pull=pull, touch=contacts.touch,
        strand=touched, first=np.append(first, len(order)), place=acts[order],
    )


def _frames(normal: Floats, edges: Floats) -> Floats:
    """Normals [C, 3], the directions nearest to both edges [C, 2, 3] across them, and those across both, shape [C, 3, 3]."""
    along = edges / np.linalg.norm(edges, axis=2)[:, :, None]
    same = np.where(np.einsum("ck,ck->c", along[:, 0], along[:, 1]) < 0.0, -1.0, 1.0)
    first = along[:, 0] + same[:, None] * along[:, 1]
    first -= np.einsum("ck,ck->c", first, normal)[:, None] * normal
    least = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    least -= np.einsum("ck,ck->c", least, normal)[:, None] * normal
    first = np.where((np.linalg.norm(first, axis=1) < 1e-3)[:, None], least, first)  # a strand that meets a solid head-on
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([normal, first, np.cross(normal, first)], axis=1)


@njit(cache=True, error_model="numpy")
def contact_stiffness(problem, band):
    """Return the stiffness of contacts in their directions [N/m], shape [C, 3], in proportion to that of their strands.

    `band` [4V, w+1] are the strands' Hessians. Of two sides the softer one counts, as with springs in a row.
    """
    stiffness = np.empty((len(problem.gap), 3))
    for c in range(len(problem.gap)):
        for i in range(3):
            soft = 0.0
            for side in range(2):
                own = 0.0
                for e in range(2 * side, 2 * side + 2):
                    row = 4 * problem.vertex[c, e]
                    for a in range(3):
                        for b in range(3):
                            entry = band[row + max(a, b), abs(a - b)]
                            own += problem.weight[c, e] ** 2 * problem.frame[c, i, a] * problem.frame[c, i, b] * entry
                if own > 0.0:
                    soft += 1.0 / own
            stiffness[c, i] = STIFF / soft
    return stiffness


@njit(cache=True, error_model="numpy")
def relative(problem, c, moved, w):
    """Write w [3] of contact c, in its frame, where vertices move by `moved` [V, >= 3] [m], but for what is carried."""
    w[:] = 0.0
    for e in range(4):
        v = problem.vertex[c, e]
        for j in range(3):
            f = problem.frame[c, j]
            w[j] += problem.weight[c, e] * (f[0] * moved[v, 0] + f[1] * moved[v, 1] + f[2] * moved[v, 2])
