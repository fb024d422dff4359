"""Contacts that begin: yarns of different fabrics that are about to pass through each other.

The paper detects contacts between fabrics once, at the start, and only ever removes them (Sánchez-Banderas 2020, sec. 5).
Here a point belongs to two yarns for good. Yarns that bend little cross once at most, so the points that may ever be in
use are known when a scene is built, and one out of use only has to follow the place at which its yarns come nearest: a
short walk along both, from where that was a step ago.

With the normal n = side * t_0 x t_1 / |t_0 x t_1| from yarn 0 to yarn 1, the gap is s = n . (X_1 - X_0) and its rate
n . (V_1 - V_0), however the material slides. Layers have no thickness, so yarns touch at s = 0. A contact begins where
the rate is negative and s + h * rate, the gap at the end of a next step without it, is below zero: during that step the
constraint then stops what approaches. It has no part in what does not come so far, and never attracts.

A new contact interpolates its place on both yarns, so it has no mass and changes neither momentum nor energy.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit, prange

from engine.arrays import Flags, Floats, Ints
from engine.geometry.segment_distance import walk_to_nearest
from engine.yarns.model import PointKind, YarnModel, YarnState
from engine.yarns.topology import Chain

SLACK = 0.01  # radii that yarns must be about to pass each other, so that those at rest at a gap of zero do not flicker
DEEPEST = 0.5  # sums of radii: yarns that have passed each other by more are apart, on the other side
INSIDE = 0.1  # radii from the end of a yarn to a contact that begins
LEAST_SINE = 0.1  # of the angle at which yarns cross: below, it is open where they do


@dataclass(frozen=True)
class Approach:
    """How n contacts out of use come closer."""

    points: Ints  # shape [n]
    gap: Floats  # s; infinite where the yarns do not lie over each other [m], shape [n]
    rate: Floats  # of the gap [m/s], shape [n]
    between: Floats  # X_0 - X_1 [m], shape [n, 3]


def approach(model: YarnModel, state: YarnState, chain: Chain) -> Approach:
    """Follow the nearest places of yarns whose contact is not in use; writes their `state.u` and `state.x`."""
    points = np.flatnonzero((model.point_kind == PointKind.CONTACT) & ~state.active)
    gap, rate, between = np.full(len(points), np.inf), np.zeros(len(points)), np.zeros((len(points), 3))
    if len(points):
        _approach(points, model.point_nodes, model.side, model.node_yarn, model.node_point, model.kinematic, model.length,
                  model.radius, chain.node, chain.start, model.node_point[chain.node], state.velocity, state.x_rate, state.x,
                  state.u, gap, rate, between)
    return Approach(points, gap, rate, between)


def meeting(model: YarnModel, coming: Approach, h: float) -> Flags:
    """Return which of the contacts would be passed through within a step h [s], or have just been, shape [n]."""
    first, second = model.radius[model.node_yarn[model.point_nodes[coming.points]]].T
    passing = (coming.rate < 0.0) & (coming.gap + h * coming.rate < -SLACK * np.minimum(first, second))
    return passing & (coming.gap > -DEEPEST * (first + second))


def add(model: YarnModel, state: YarnState, coming: Approach, chosen: Flags) -> None:
    """Take those `chosen` [n] of the contacts into use where they are, as EIL nodes on both yarns, without a force."""
    points = coming.points[chosen]
    nodes = model.point_nodes[points].ravel()
    state.active[points], state.parting[points] = True, False
    state.eil[nodes] = True
    state.anchor[nodes], state.u_rate[nodes], state.velocity[nodes] = state.u[nodes], 0.0, 0.0
    state.gap[points] = coming.between[chosen]
    state.contact_force[points], state.normal_force[points], state.x_rate[points] = 0.0, 0.0, 0.0
    state.pulling_time[points] = 0.0
    for yarn in np.unique(model.node_yarn[nodes]):
        own = slice(model.node_start[yarn], model.node_start[yarn + 1])
        state.order[own] = state.order[own][np.argsort(state.u[state.order[own]], kind="stable")]


@njit(cache=True, parallel=True)
def _approach(points, point_nodes, side, node_yarn, node_point, kinematic, length, radius, chain, start, chain_point, velocity,
              x_rate, x, u, gap, rate, between):
    for a in prange(len(points)):
        p = points[a]
        m, n = point_nodes[p, 0], point_nodes[p, 1]
        y, z = node_yarn[m], node_yarn[n]
        first, second = chain[start[y] : start[y + 1]], chain[start[z] : start[z + 1]]
        i, j, s, t, _ = walk_to_nearest(
            chain_point[start[y] : start[y + 1]], chain_point[start[z] : start[z + 1]], x, _segment(first, u, u[m]),
            _segment(second, u, u[n]))
        i0, i1, j0, j1 = first[i], first[i + 1], second[j], second[j + 1]
        u[m], u[n] = (1.0 - s) * u[i0] + s * u[i1], (1.0 - t) * u[j0] + t * u[j1]
        p0, p1, q0, q1 = node_point[i0], node_point[i1], node_point[j0], node_point[j1]
        normal, across, lengths = np.empty(3), 0.0, np.zeros(2)
        for k in range(3):
            k1, k2 = (k + 1) % 3, (k + 2) % 3
            normal[k] = side[p] * ((x[p1, k1] - x[p0, k1]) * (x[q1, k2] - x[q0, k2])
                                   - (x[p1, k2] - x[p0, k2]) * (x[q1, k1] - x[q0, k1]))
            across += normal[k] ** 2
            lengths[0] += (x[p1, k] - x[p0, k]) ** 2
            lengths[1] += (x[q1, k] - x[q0, k]) ** 2
            here = (1.0 - s) * x[p0, k] + s * x[p1, k]
            there = (1.0 - t) * x[q0, k] + t * x[q1, k]
            between[a, k] = here - there
            x[p, k] = 0.5 * (here + there)
        over = (_inside(u[m], length[y], INSIDE * radius[y]) and _inside(u[n], length[z], INSIDE * radius[z]))
        if not over or across <= LEAST_SINE**2 * lengths[0] * lengths[1]:
            continue
        gap[a] = 0.0
        for k in range(3):
            v0 = _velocity(i0, i1, s, k, kinematic[y], node_point, velocity, x_rate)
            v1 = _velocity(j0, j1, t, k, kinematic[z], node_point, velocity, x_rate)
            gap[a] -= normal[k] * between[a, k] / np.sqrt(across)
            rate[a] += normal[k] * (v1 - v0) / np.sqrt(across)


@njit(cache=True)
def _segment(nodes, u, here):
    """Number of the segment between EoL nodes in which a place on a yarn is."""
    low, high = 0, len(nodes) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if u[nodes[middle]] <= here:
            low = middle
        else:
            high = middle
    return low


@njit(cache=True)
def _inside(u, length, margin):
    return margin <= u <= length - margin


@njit(cache=True)
def _velocity(i, j, share, k, given, node_point, velocity, x_rate):
    """Component k of the material's velocity on the segment from node i to node j."""
    if given:
        return (1.0 - share) * x_rate[node_point[i], k] + share * x_rate[node_point[j], k]
    return (1.0 - share) * velocity[i, 1, k] + share * velocity[j, 0, k]
