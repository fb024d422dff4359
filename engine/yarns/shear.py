"""Shear of woven cloth: warps and wefts resist leaving their right angle (Cirio 2014, as Sánchez-Banderas 2020, sec. 4.2 says).

At every crossing within a fabric, for each of the four pairs of a warp segment and a weft segment at the angle phi,

    V = k_x L (a^2 / 2 + J b^3 / 3),  a = phi - pi / 2,  b = |a| - a_jam where that is positive, else 0,

with L the rest spacing. In a rhombus of side L the yarns of radius R meet at phi_jam = 2 asin(R / L), so a_jam is
pi / 2 - phi_jam: from there on the cloth jams, by a cubic term that leaves V twice differentiable.

V depends on x alone. At an EIL node both segments are that between its EoL neighbours, so that its force goes to those.
"""

import numpy as np
from numba import njit, prange

from engine.arrays import Floats, Ints
from engine.geometry.edge_angle import edge_angle
from engine.linalg.block_matrix import locate
from engine.yarns.model import PointKind, YarnModel, YarnState
from engine.yarns.topology import Chain

JAMMING = 1e3  # J: a tenth of a radian behind the angle of jamming, shear is 200 times as stiff as before [1/rad]
ALIGNED = 1e-9  # sine of the angle below which the plane of two segments is arbitrary


def sheared(model: YarnModel, state: YarnState) -> Ints:
    """Return the crossings within a fabric that resist shear."""
    of_fabric = (model.point_kind == PointKind.CROSSING) & (model.fabric[model.node_yarn[model.point_nodes[:, 0]]] >= 0)
    return np.flatnonzero(of_fabric & state.active & (stiffness(model) > 0.0))


def stiffness(model: YarnModel) -> Floats:
    """Return k_x L of every point, the mean of its two yarns, shape [P] [N m]."""
    return _mean_of_yarns(model, model.shear_stiffness) * _mean_of_yarns(model, model.crossing_spacing)


def free_angle(model: YarnModel) -> Floats:
    """Return a_jam of every point: how far phi may be from pi / 2 before yarns meet, shape [P] [rad]."""
    jammed = 2.0 * np.arcsin(np.minimum(_mean_of_yarns(model, model.radius / model.crossing_spacing), 1.0))
    return np.maximum(0.5 * np.pi - jammed, 0.0)


def members(model: YarnModel, chain: Chain, points: Ints) -> Ints:
    """Return each of `points` and the four around it, the point itself where a yarn ends, shape [n, 5]."""
    around = [points]
    for node in model.point_nodes[points].T:
        for neighbour in (chain.before, chain.after):
            around.append(np.where(neighbour[node] < 0, points, model.node_point[neighbour[node]]))
    return np.column_stack(around)


def _mean_of_yarns(model, of_yarn):
    first, second = model.point_nodes.T
    return 0.5 * (of_yarn[model.node_yarn[first]] + of_yarn[model.node_yarn[second]])


@njit(cache=True, error_model="numpy")
def add_gradient(points, point_nodes, eil, before, after, node_point, stiffness, free_angle, x, gradient):
    """Add the gradient to `gradient` [N, 4] and return the energy [J]; `stiffness` and `free_angle` are [P]."""
    energy = 0.0
    t, s, n, m = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for p in points:
        for side in range(4):
            a, b = _segment(point_nodes[p, 0], side % 2, eil, before, after)
            c, d = _segment(point_nodes[p, 1], side // 2, eil, before, after)
            if a < 0 or b < 0 or c < 0 or d < 0:
                continue
            la, lc, phi = _angle(x, node_point[a], node_point[b], node_point[c], node_point[d], t, s, n, m)
            work, moment, _ = _law(phi, stiffness[p], free_angle[p])
            energy += work
            for k in range(3):
                gradient[a, k] -= moment / la * n[k]
                gradient[b, k] += moment / la * n[k]
                gradient[c, k] -= moment / lc * m[k]
                gradient[d, k] += moment / lc * m[k]
    return energy


@njit(cache=True, error_model="numpy")
def add_hessian(
    points, point_nodes, eil, before, after, node_point, stiffness, free_angle, x, convex, row, start, column, block
):
    """Add the Hessian, exact or, where `convex` [P], a positive form of it; `row` [P] are the points' rows.

    Stretching a segment turns phi at second order, which `convex` leaves out. Across the plane of both segments, tilts
    alpha and beta of them cost M (cos(phi) (alpha^2 + beta^2) / 2 - alpha beta) / sin(phi) with the moment M = dV/dphi, that is
    M ((1 + cos phi) (alpha - beta)^2 - (1 - cos phi) (alpha + beta)^2) / (4 sin phi): one of both parts is positive.
    """
    t, s, n, m = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    binormal = np.empty(3)
    of_ends = np.empty((2, 2, 3, 3))  # second derivatives in the edges of both segments
    ends, around = np.empty(4, np.int64), np.empty(5, np.int64)
    local = np.empty((5, 5, 3, 3))  # of the point and those around it
    for p in points:
        local[:] = 0.0
        around[:] = p
        for side in range(4):
            a, b = _segment(point_nodes[p, 0], side % 2, eil, before, after)
            c, d = _segment(point_nodes[p, 1], side // 2, eil, before, after)
            if a < 0 or b < 0 or c < 0 or d < 0:
                continue
            ends[0], ends[1] = _places(node_point[a], node_point[b], p, 1 + side % 2, 2 - side % 2, around)
            ends[2], ends[3] = _places(node_point[c], node_point[d], p, 3 + side // 2, 4 - side // 2, around)
            la, lc, phi = _angle(x, node_point[a], node_point[b], node_point[c], node_point[d], t, s, n, m)
            _, moment, rigidity = _law(phi, stiffness[p], free_angle[p])
            cosine, sine = np.cos(phi), max(np.sin(phi), ALIGNED)
            apart, together = moment * (1.0 + cosine) / (2.0 * sine), -moment * (1.0 - cosine) / (2.0 * sine)
            if convex[p]:
                apart, together = max(apart, 0.0), max(together, 0.0)
            bend = 0.0 if convex[p] else moment
            for k in range(3):
                binormal[k] = t[(k + 1) % 3] * n[(k + 2) % 3] - t[(k + 2) % 3] * n[(k + 1) % 3]
            for r in range(3):
                for q in range(3):
                    across = binormal[r] * binormal[q]
                    of_ends[0, 0, r, q] = (
                        rigidity * n[r] * n[q] + (apart + together) * across - bend * (n[r] * t[q] + t[r] * n[q])) / (la * la)
                    of_ends[1, 1, r, q] = (
                        rigidity * m[r] * m[q] + (apart + together) * across - bend * (m[r] * s[q] + s[r] * m[q])) / (lc * lc)
                    of_ends[0, 1, r, q] = (rigidity * n[r] * m[q] - (apart - together) * across) / (la * lc)
                    of_ends[1, 0, q, r] = of_ends[0, 1, r, q]
            for i in range(4):
                for j in range(4):
                    sign = 1.0 if i % 2 == j % 2 else -1.0
                    for r in range(3):
                        for q in range(3):
                            local[ends[i], ends[j], r, q] += sign * of_ends[i // 2, j // 2, r, q]
        for i in range(5):
            for j in range(5):
                if (i > 0 and around[i] == p) or (j > 0 and around[j] == p):
                    continue
                k = locate(start, column, row[around[i]], row[around[j]])
                for r in range(3):
                    for q in range(3):
                        block[k, r, q] += local[i, j, r, q]


@njit(cache=True, error_model="numpy")
def _places(a, b, p, forward, backward, around):
    """Where points a and b of a segment stand among those `around` p: 0 for p itself."""
    around[forward] = b
    if a == p:
        return 0, forward
    around[backward] = a
    return backward, forward


@njit(cache=True, parallel=True, error_model="numpy")
def add_gradient_in_parts(points, part, point_nodes, eil, before, after, node_point, stiffness, free_angle, x, gradient):
    """As `add_gradient`, with the parts points[part[s]:part[s+1]], which share no node, at once and the rest after them."""
    parts = len(part) - 1
    energy = np.zeros(parts)
    for s in prange(parts):
        energy[s] = add_gradient(
            points[part[s] : part[s + 1]], point_nodes, eil, before, after, node_point, stiffness, free_angle, x, gradient)
    total = add_gradient(points[part[parts] :], point_nodes, eil, before, after, node_point, stiffness, free_angle, x, gradient)
    for s in range(parts):
        total += energy[s]
    return total


@njit(cache=True, parallel=True, error_model="numpy")
def add_hessian_in_parts(
    points, part, point_nodes, eil, before, after, node_point, stiffness, free_angle, x, convex, row, start, column, block
):
    """As `add_hessian`, with the parts points[part[s]:part[s+1]], which share no row, at once and the rest after them."""
    parts = len(part) - 1
    for s in prange(parts):
        add_hessian(points[part[s] : part[s + 1]], point_nodes, eil, before, after, node_point, stiffness, free_angle, x,
                    convex, row, start, column, block)
    add_hessian(points[part[parts] :], point_nodes, eil, before, after, node_point, stiffness, free_angle, x, convex, row,
                start, column, block)


@njit(cache=True, error_model="numpy")
def _law(phi, stiffness, free_angle):
    """V, dV/dphi and d2V/dphi2 of one pair of segments."""
    a = phi - 0.5 * np.pi
    b = max(abs(a) - free_angle, 0.0)
    jammed = JAMMING * b * b
    return (
        stiffness * (0.5 * a * a + jammed * b / 3.0),
        stiffness * (a + np.sign(a) * jammed),
        stiffness * (1.0 + 2.0 * JAMMING * b),
    )


@njit(cache=True, error_model="numpy")
def _segment(i, forward, eil, before, after):
    """Nodes between which the segment before or behind node i runs, away from i; -1 where the yarn has ended."""
    if eil[i]:
        return (before[i], after[i]) if forward else (after[i], before[i])
    return i, after[i] if forward else before[i]


@njit(cache=True, error_model="numpy")
def _angle(x, a, b, c, d, t, s, n, m):
    """Lengths of the segments from point a to b and from c to d, and the angle phi between them.

    Writes their unit directions t and s, and the unit directions n and m in their plane in which phi grows when b (n) or
    d (m) moves.
    """
    la, lc, cosine, sine = edge_angle(x, a, b, c, d, t, s)
    for k in range(3):
        n[k] = (cosine * t[k] - s[k]) / max(sine, ALIGNED)
        m[k] = (cosine * s[k] - t[k]) / max(sine, ALIGNED)
    return la, lc, np.arctan2(sine, cosine)
