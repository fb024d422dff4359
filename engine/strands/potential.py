"""The incremental potential of one implicit step of a strand: inertia and elasticity, with gradient and Hessian.

Internal friction is elasticity about the strains q* that their rate (q - q*) / h counts from, for implicit Euler those at the
start of the step: stiffness k with friction beta k and rest q0 is, but for a constant, stiffness k (1 + beta / h) with rest
(q0 + beta / h q*) / (1 + beta / h). Here and below h is the effective step (`engine.strands.backward_difference`).
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from engine.arrays import Flags, Floats
from engine.geometry.frames import across, cross, row
from engine.linalg.banded import WIDTH
from engine.strands import bending, stretching, twisting
from engine.strands.kinematics import edges, frames

EPSILON = np.finfo(np.float64).eps


class Geometry(NamedTuple):
    """The shape of a strand of V vertices; what belongs to edges has V rows too, the last of which is not used."""

    t: Floats  # unit tangents of edges, shape [V, 3]
    length: Floats  # of edges [m], shape [V]
    m1: Floats  # material directions of edges, shape [V, 3]
    m2: Floats
    binormal: Floats  # integrated curvature vector kb of vertices, shape [V, 3]
    kappa: Floats  # integrated curvatures of vertices in the frames of both edges, shape [V, 2, 2]
    twist: Floats  # of vertices [rad], shape [V]


class Step(NamedTuple):
    """What stays in the step of a strand: where inertia takes it, stiffnesses and rest strains with friction's share."""

    mass: Floats  # with that of drag [kg], shape [V]
    weight: Floats  # [N], shape [V]
    start: Floats  # places of vertices before the step [m], shape [V, 3]
    target: Floats  # where inertia alone takes them [m], shape [V, 3]
    spin_inertia: Floats  # [kg m^2], shape [V]
    spun: Floats  # turns of edges that inertia would make [rad], shape [V]
    stretch_stiffness: Floats  # [N/m], shape [V]
    rest_length: Floats  # [m], shape [V]
    bending_stiffness: Floats  # [N m], shape [V, 2]
    rest_curvature: Floats  # shape [V, 2, 2]
    twist_stiffness: Floats  # [N m], shape [V]
    rest_twist: Floats  # [rad], shape [V]
    held: Flags  # shape [V, 4]


@njit(cache=True, error_model="numpy")
def geometry(n):
    """Memory for the shape of a strand of n vertices."""
    return Geometry(np.empty((n, 3)), np.empty(n), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 2, 2)),
                    np.zeros(n))


@njit(cache=True, error_model="numpy")
def first_of_geometry(g, n):
    """The part of longer memory that a strand of n vertices needs."""
    return Geometry(g.t[:n], g.length[:n], g.m1[:n], g.m2[:n], g.binormal[:n], g.kappa[:n], g.twist[:n])


@njit(cache=True, error_model="numpy")
def step_of(n):
    """Memory for the step of a strand of n vertices."""
    return Step(np.empty(n), np.empty(n), np.empty((n, 3)), np.empty((n, 3)), np.empty(n), np.empty(n), np.empty(n), np.empty(n),
                np.empty((n, 2)), np.empty((n, 2, 2)), np.empty(n), np.empty(n), np.empty((n, 4), np.bool_))


@njit(cache=True, error_model="numpy")
def first_of_step(s, n):
    """The part of longer memory that a strand of n vertices needs."""
    return Step(s.mass[:n], s.weight[:n], s.start[:n], s.target[:n], s.spin_inertia[:n], s.spun[:n], s.stretch_stiffness[:n],
                s.rest_length[:n], s.bending_stiffness[:n], s.rest_curvature[:n], s.twist_stiffness[:n], s.rest_twist[:n],
                s.held[:n])


@njit(cache=True, error_model="numpy")
def begin(model, inertia, s, x, m1, twist, step, now, base):
    """Write what stays in the step of strand s of `model` to `step`, and its shape at the start to `now`.

    x, m1 and twist are the strand's own, `inertia` that of all; `base` is memory.
    """
    first, last = model.start[s], model.start[s + 1]
    h, lean = inertia.effective[first], inertia.lean[first]
    shape(x, m1, twist, now)
    rates_from = now
    if lean > 0.0:
        shape(inertia.earlier_x[first:last], inertia.earlier_m1[first:last], inertia.earlier_twist[first:last], base)
        lean_on(now, lean, base)
        rates_from = base
    for i in range(len(x)):
        v = first + i
        share = model.damping[v] / h
        whole = 1.0 + share
        step.mass[i], step.weight[i] = inertia.mass[v], inertia.weight[v]
        step.spin_inertia[i], step.spun[i] = model.spin_inertia[v], inertia.spun[v]
        step.stretch_stiffness[i] = whole * model.stretch_stiffness[v]
        step.rest_length[i] = (model.rest_length[v] + share * rates_from.length[i]) / whole
        step.twist_stiffness[i] = whole * model.twist_stiffness[v]
        step.rest_twist[i] = (model.rest_twist[v] + share * rates_from.twist[i]) / whole
        for k in range(3):
            step.start[i, k], step.target[i, k] = x[i, k], inertia.target[v, k]
        for k in range(4):
            step.held[i, k] = model.held[v, k]
        for j in range(2):
            step.bending_stiffness[i, j] = whole * model.bending_stiffness[v, j]
            for c in range(2):
                step.rest_curvature[i, j, c] = (model.rest_curvature[v, j, c] + share * rates_from.kappa[i, j, c]) / whole


@njit(cache=True, error_model="numpy")
def shape(x, m1, twist, g):
    """Write the shape of a strand at x [V, 3] [m] with material directions m1 [V, 3] of edges and twist [V] [rad] to g."""
    edges(x, g.t, g.length)
    g.twist[:] = twist
    for i in range(len(x) - 1):
        tangent = row(g.t, i)
        one = across(row(m1, i), tangent)
        two = cross(tangent, one)
        for k in range(3):
            g.m1[i, k], g.m2[i, k] = one[k], two[k]
    bending.curvatures(g.t, g.m1, g.m2, g.binormal, g.kappa)


@njit(cache=True, error_model="numpy")
def lean_on(now, lean, base):
    """Make the strains of `base`, which are those a step before `now`, those that rates count from: y_n + c (y_n - y_(n-1))."""
    for i in range(len(now.length)):
        base.length[i] = now.length[i] + lean * (now.length[i] - base.length[i])
        base.twist[i] = now.twist[i] + lean * (now.twist[i] - base.twist[i])
        for j in range(2):
            for c in range(2):
                base.kappa[i, j, c] = now.kappa[i, j, c] + lean * (now.kappa[i, j, c] - base.kappa[i, j, c])


@njit(cache=True, error_model="numpy")
def follow(x, turn, before, now):
    """Write the shape `now` of a strand whose vertices went to x [V, 3] and whose edges turned by `turn` [V] since `before`."""
    edges(x, now.t, now.length)
    frames(before.t, before.m1, now.t, turn, now.m1, now.m2)
    bending.curvatures(now.t, now.m1, now.m2, now.binormal, now.kappa)
    twisting.twists(now.t, now.m1, before.twist, turn, now.twist)


@njit(cache=True, error_model="numpy")
def force_scale(now, step):
    """Largest weight of a vertex, or force within the strand [N]."""
    scale = step.weight.max()
    for i in range(len(step.mass) - 1):
        scale = max(scale, step.stretch_stiffness[i] * abs(now.length[i] - step.rest_length[i]))
    for i in range(1, len(step.mass) - 1):
        for c in range(2):
            change = abs(now.kappa[i, 0, c] - step.rest_curvature[i, 0, c])
            scale = max(scale, step.bending_stiffness[i, c] * change / now.length[i])
        scale = max(scale, step.twist_stiffness[i] * abs(now.twist[i] - step.rest_twist[i]) / now.length[i])
    return scale


@njit(cache=True, error_model="numpy")
def rounding(x):
    """What rounding makes of the distances between places x [V, 3] [m]."""
    extent = 0.0
    for i in range(len(x)):
        for k in range(3):
            extent = max(extent, abs(x[i, k]))
    return 4.0 * EPSILON * extent


@njit(cache=True, error_model="numpy")
def round_off(x, step, h):
    """What rounding the places x [V, 3] changes of the forces of stretch and inertia [N]: no iteration finds smaller ones."""
    return rounding(x) * max(step.stretch_stiffness.max(), step.mass.max() / (h * h))


@njit(cache=True, error_model="numpy")
def energy(x, turned, now, step, h):
    """Incremental potential [J] at x [V, 3] and the angles `turned` [V] since the start of the step, with the shape `now`.

    That of inertia counts from the start of the step: in long steps it would drown that of elasticity.
    """
    inertia = 0.0
    for i in range(len(x)):
        for k in range(3):
            moved = x[i, k] - step.start[i, k]
            inertia += step.mass[i] * moved * (moved - 2.0 * (step.target[i, k] - step.start[i, k]))
    for i in range(len(x) - 1):
        inertia += step.spin_inertia[i] * turned[i] * (turned[i] - 2.0 * step.spun[i])
    return (
        0.5 * inertia / (h * h)
        + stretching.energy(now.length, step.rest_length, step.stretch_stiffness)
        + bending.energy(now.kappa, step.rest_curvature, step.bending_stiffness)
        + twisting.energy(now.twist, step.rest_twist, step.twist_stiffness)
    )


@njit(cache=True, error_model="numpy")
def gradient(x, turned, now, step, h, local, g):
    """Write the gradient of `energy` by x [N] and turns [N m] to g [V, 4], 0 where they are held; `local` [8] is memory."""
    vertices = len(x)
    for i in range(vertices):
        for k in range(3):
            g[i, k] = step.mass[i] * (x[i, k] - step.target[i, k]) / (h * h)
        g[i, 3] = step.spin_inertia[i] * (turned[i] - step.spun[i]) / (h * h) if i < vertices - 1 else 0.0
    for i in range(vertices - 1):
        local[:] = 0.0
        stretching.add_gradient(i, now.t, now.length, step.rest_length, step.stretch_stiffness, local)
        for k in range(3):
            g[i, k] -= local[k]
            g[i + 1, k] += local[k]
    for i in range(1, vertices - 1):
        local[:] = 0.0
        bending.add_gradient(i, now.t, now.length, now.m1, now.m2, now.binormal, now.kappa, step.rest_curvature,
                             step.bending_stiffness, local)
        twisting.add_gradient(i, now.length, now.binormal, now.twist, step.rest_twist, step.twist_stiffness, local)
        for k in range(3):
            g[i - 1, k] -= local[k]
            g[i, k] += local[k] - local[3 + k]
            g[i + 1, k] += local[3 + k]
        g[i - 1, 3] += local[6]
        g[i, 3] += local[7]
    for i in range(vertices):
        for k in range(4):
            if step.held[i, k]:
                g[i, k] = 0.0


@njit(cache=True, error_model="numpy")
def hessian(now, step, h, positive, local, band):
    """Write the Hessian of `energy` to `band` [4V, 11], as identity where unknowns are held, or its `positive` form.

    `local` [12, 8] is memory.
    """
    vertices = len(step.mass)
    block, strain = local[:8], local[8:]
    band[:] = 0.0
    for i in range(vertices):
        for k in range(3):
            band[4 * i + k, 0] = step.mass[i] / (h * h)
        band[4 * i + 3, 0] = step.spin_inertia[i] / (h * h) if i < vertices - 1 else 1.0
    for i in range(vertices - 1):
        block[:] = 0.0
        stretching.add_hessian(i, now.t, now.length, step.rest_length, step.stretch_stiffness, positive, block)
        _add_edge(4 * i, block, band)
    for i in range(1, vertices - 1):
        block[:] = 0.0
        bending.add_hessian(i, now.t, now.length, now.m1, now.m2, now.binormal, now.kappa, step.rest_curvature,
                            step.bending_stiffness, positive, strain, block)
        twisting.add_hessian(i, now.t, now.length, now.binormal, now.twist, step.rest_twist, step.twist_stiffness, positive,
                             block)
        _add_vertex(4 * (i - 1), block, band)
    for i in range(vertices):
        for k in range(4):
            if step.held[i, k]:
                _hold(4 * i + k, band)


@njit(cache=True, error_model="numpy")
def _add_edge(first, local, band):
    """Add second derivatives, lower half of `local` [3, 3], by an edge; `first` is the first unknown of its first vertex."""
    for a in range(3):
        for b in range(3):
            value = local[a, b] if b <= a else local[b, a]
            if b <= a:
                band[first + b, a - b] += value
                band[first + 4 + b, a - b] += value
            band[first + b, 4 + a - b] -= value


@njit(cache=True, error_model="numpy")
def _add_vertex(first, local, band):
    """Add second derivatives, lower half of `local` [8, 8], by two edges and their turns; `first` is as in `_add_edge`."""
    for a in range(3):
        for b in range(3):
            h10 = local[3 + a, b]
            h00, h11 = (local[a, b], local[3 + a, 3 + b]) if b <= a else (local[b, a], local[3 + b, 3 + a])
            if b <= a:
                band[first + b, a - b] += h00
                band[first + 4 + b, a - b] += h00 - h10 - local[3 + b, a] + h11
                band[first + 8 + b, a - b] += h11
            band[first + b, 4 + a - b] += h10 - h00
            band[first + b, 8 + a - b] -= h10
            band[first + 4 + b, 4 + a - b] += h10 - h11
    for j in range(2):
        turn = first + 3 + 4 * j
        for c in range(j + 1):
            band[first + 3 + 4 * c, 4 * (j - c)] += local[6 + j, 6 + c]
        for a in range(3):
            by_0, by_1 = local[6 + j, a], local[6 + j, 3 + a]
            _add(turn, first + a, -by_0, band)
            _add(turn, first + 4 + a, by_0 - by_1, band)
            _add(turn, first + 8 + a, by_1, band)


@njit(cache=True, error_model="numpy")
def _add(row, column, value, band):
    band[min(row, column), abs(row - column)] += value


@njit(cache=True, error_model="numpy")
def _hold(row, band):
    """Make a row and its column those of the identity."""
    band[row, :] = 0.0
    for d in range(1, min(WIDTH, row) + 1):
        band[row - d, d] = 0.0
    band[row, 0] = 1.0
