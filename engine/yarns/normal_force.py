"""Normal forces at contacts, from what each yarn's own equation of motion lacks.

At a shared point the contact force on yarn i is the sum of its inertia, weight and internal forces there, exact on
either side: where one side is pinned or given, the other still carries the whole load. At an EIL node it is the
constraint's spring force, at an eyelet or an edge the reaction across the yarn.
"""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from engine.arrays import Floats
from engine.yarns.model import PointKind, YarnModel, YarnState

if TYPE_CHECKING:  # whose assignment needs normals itself
    from engine.yarns.topology import Chain

CROSSING, CONTACT, STITCH = int(PointKind.CROSSING), int(PointKind.CONTACT), int(PointKind.STITCH)
EYELET, EDGE = int(PointKind.EYELET), int(PointKind.EDGE)


@njit(cache=True)
def normal_forces(
    point_kind, point_nodes, side, active, before, after, node_point, node_yarn,
    radius, spacing, bending_stiffness, stretch_stiffness, height, contact_force, x, u, force,
):
    """Write F_n [N] of every point to `force` [P]: positive where yarns press, negative where they pull.

    `contact_force` [P, 3] is what the first yarn of a point exerts on the second, or on the object there. It has the
    crimp's part where centre lines have their `height` [N] over points (`crimp`); elsewhere that is added.
    """
    t0, t1, n = np.empty(3), np.empty(3), np.empty(3)
    for p in range(len(force)):
        force[p] = 0.0
        kind = point_kind[p]
        if not active[p] or kind == STITCH:
            continue
        i, j = point_nodes[p, 0], point_nodes[p, 1]
        if kind == EYELET or kind == EDGE:
            tangent(i, before, after, node_point, x, u, t0)
            along = square = 0.0
            for k in range(3):
                along += contact_force[p, k] * t0[k]
                square += contact_force[p, k] ** 2
            force[p] = np.sqrt(max(square - along * along, 0.0))
        elif kind == CROSSING or kind == CONTACT:
            normal(i, j, side[p], before, after, node_point, x, u, t0, t1, n)
            for k in range(3):
                force[p] += contact_force[p, k] * n[k]
            if kind == CROSSING and height[i] == 0.0:
                offset = radius[node_yarn[i]] + radius[node_yarn[j]]
                for m in (i, j):
                    y = node_yarn[m]
                    tension = stretch_stiffness[y] * (stretch(m, before, after, node_point, x, u) - 1.0)
                    force[p] += 0.5 * crimp_force(offset, spacing[y], bending_stiffness[y], tension)


def at_rest(model: YarnModel, state: YarnState, chain: "Chain") -> Floats:
    """Return F_n of every point before the first step, when only crimp that is not set presses yarns, shape [P] [N]."""
    force = np.zeros(model.point_count)
    has_its_part = np.abs(model.set_angle)  # as where centre lines have a height: crimp that is set presses nothing
    normal_forces(
        model.point_kind, model.point_nodes, model.side, state.active, chain.before, chain.after,
        model.node_point, model.node_yarn, model.radius, model.crossing_spacing, model.bending_stiffness,
        model.stretch_stiffness, has_its_part, state.contact_force, state.x, state.u, force)
    return force


@njit(cache=True)
def crimp_force(offset, spacing, bending_stiffness, tension):
    """Force with which a crimped yarn presses on the one it passes [N].

    The model's yarns share the point; in a weave the yarn bends by twice atan(offset / spacing) over its partner, and
    both its bending moment and its tension push it back.
    """
    tilt = np.arctan2(offset, spacing)
    moment = 2.0 * bending_stiffness * (2.0 * tilt) / (2.0 * spacing)
    return 2.0 * moment * np.cos(tilt) ** 2 / spacing + 2.0 * max(tension, 0.0) * np.sin(tilt)


@njit(cache=True)
def normal(i, j, side, before, after, node_point, x, u, t0, t1, n):
    """Write the unit normal from node i's yarn to node j's, which cross, to n, and their tangents to t0 and t1.

    Where the yarns are parallel, n is zero.
    """
    tangent(i, before, after, node_point, x, u, t0)
    tangent(j, before, after, node_point, x, u, t1)
    length = 0.0
    for k in range(3):
        n[k] = side * (t0[(k + 1) % 3] * t1[(k + 2) % 3] - t0[(k + 2) % 3] * t1[(k + 1) % 3])
        length += n[k] * n[k]
    length = np.sqrt(length)
    for k in range(3):
        n[k] = n[k] / length if length > 1e-12 else 0.0


@njit(cache=True)
def stretches(nodes, before, after, node_point, x, u, of_node):
    """Write the mean lambda of the two segments that meet at each of `nodes` to `of_node` [N]."""
    for i in nodes:
        of_node[i] = stretch(i, before, after, node_point, x, u)


@njit(cache=True)
def stretch(i, before, after, node_point, x, u):
    """Mean lambda of the two segments that meet at node i."""
    total, count = 0.0, 0
    for a, b in ((before[i], i), (i, after[i])):
        if a >= 0 and b >= 0 and u[b] > u[a]:
            square = 0.0
            for k in range(3):
                square += (x[node_point[b], k] - x[node_point[a], k]) ** 2
            total += np.sqrt(square) / (u[b] - u[a])
            count += 1
    return total / count if count > 0 else 1.0


@njit(cache=True)
def tangent(i, before, after, node_point, x, u, t):
    """Write the unit tangent of the yarn at node i: the bisector of its two segments."""
    for k in range(3):
        t[k] = 0.0
    for a, b in ((before[i], i), (i, after[i])):
        if a >= 0 and b >= 0:
            square = 0.0
            for k in range(3):
                square += (x[node_point[b], k] - x[node_point[a], k]) ** 2
            if square > 0.0:
                for k in range(3):
                    t[k] += (x[node_point[b], k] - x[node_point[a], k]) / np.sqrt(square)
    length = np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    for k in range(3):
        t[k] /= max(length, 1e-300)
