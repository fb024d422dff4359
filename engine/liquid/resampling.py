"""Particles of about one size, evenly spread: small ones join neighbours, large ones split, crowded ones move apart.

All three keep mass, centre of mass, linear and angular momentum to round-off. On a staggered grid a particle of velocity v and
affine field A has the angular momentum m (x cross v + D curl A), D = spacing^2 / 4: its spin is the curl of A. What a change
takes from the orbits of particles it gives to their spins; the rest of A, the rate of strain, is kept.

What is near solids stays: `clear` says, as flags [P], at which places [P, 3] [m] no solid is within a cell: none goes that far.
"""

from collections.abc import Callable
from dataclasses import fields, replace
from math import pi

import numpy as np
from numba import njit, prange

from engine.arrays import Flags, Floats, Ints
from engine.geometry.frames import cross, dot, row
from engine.geometry.near_points import apart, near_points
from engine.liquid.model import LiquidModel, LiquidState

SMALL, LARGE = 0.5, 2.0  # of the fine volume: what is below joins another, what is above splits (Winchenbach et al. 2017)
FURTHEST = 0.5  # of a cell, that a half is put from where the whole was: a rigid rotation keeps half of its spin or more
STIFFNESS = 0.25  # of the overlap of two particles, that one pass takes away
MOST = 0.1  # of a cell, that a particle moves at a pass

Clear = Callable[[Floats], Flags]


def merge(model: LiquidModel, state: LiquidState, fine_volume: float, clear: Clear) -> LiquidState:
    """Join particles below half the `fine_volume` [m^3] with the nearest one, where each is the other's nearest.

    Both are within twice the radius of a sphere of the fine volume, and together no larger than what `split` leaves. The joint
    particle is at their centre of mass, with the means by volume of all that they carry; elastic strain is then scaled to keep
    volume. Returns `state` itself where nothing joins. A particle joins one other at a call.
    """
    small = _clear_of(state.volume < SMALL * fine_volume, state.x, clear)
    if not small.any():
        return state
    period, fine_radius = _period(model), np.cbrt(0.75 * fine_volume / pi)
    start, near = near_points(state.x, small, np.full(len(small), fine_radius), period)
    willing = np.zeros(len(small), np.bool_)
    willing[near] = True
    willing = _clear_of(willing, state.x, clear)
    nearest = _nearest(state.x, state.volume, start, near, willing, LARGE * fine_volume, period)
    index = np.arange(len(nearest))
    a = np.flatnonzero((nearest > index) & (nearest[nearest] == index))
    return _joined(state, a, nearest[a], model.spacing, period) if len(a) else state


def split(model: LiquidModel, state: LiquidState, fine_volume: float, clear: Clear) -> LiquidState:
    """Halve particles above twice the `fine_volume` [m^3] until there are none; arguments are those of `merge`.

    The halves are put on either side of the old place, as far apart as a cube of their volume is wide, at most a cell, along
    a direction that the bits of the place decide. Their velocities are those of the affine field, their spins less by what
    they then have in orbit about each other. Returns `state` itself where nothing splits.
    """
    while True:
        large = _clear_of(state.volume > LARGE * fine_volume, state.x, clear)
        if not large.any():
            return state
        state = _halved(state, np.flatnonzero(large), model.spacing)


def relax(model: LiquidModel, state: LiquidState, clear: Clear) -> LiquidState:
    """Move particles apart that are nearer than the mean edge of cubes of their volumes, by at most a tenth of a cell.

    Pairs push each other by equal and opposite products of mass and way, and their mean affine field says how velocities change
    on the way, so that a linear field of velocity stays what it is (after Ando et al. 2012, who interpolate it anew). Particles
    at one and the same place stay there. Returns `state` itself where none is too near; `clear` is that of `merge`.
    """
    free = np.flatnonzero(_clear_of(np.ones(len(state.x), np.bool_), state.x, clear))
    if len(free) < 2:
        return state
    x, velocity, affine, volume = state.x[free], state.velocity[free], state.affine[free], state.volume[free]
    edge, period = np.cbrt(volume), _period(model)
    start, near = near_points(x, np.ones(len(x), np.bool_), 0.5 * edge, period)
    share = _shares(x, volume, edge, start, near, period, MOST * model.spacing)
    moved, kicked, twisted = _apart(x, velocity, affine, volume, edge, start, near, period, share)
    if not moved.any():
        return state
    twisted = (twisted - np.cross(moved, kicked)) / _spin_inertia(model.spacing)
    state = replace(state, x=state.x.copy(), velocity=state.velocity.copy(), affine=state.affine.copy())
    state.x[free] += moved
    state.velocity[free] += kicked
    state.affine[free] += _rotation(twisted)
    return state


def _period(model: LiquidModel) -> Floats:
    """Length after which space repeats along each axis [m], 0 where it does not, shape [3]."""
    return model.period.astype(np.float64) * model.spacing


def _clear_of(some: Flags, x: Floats, clear: Clear) -> Flags:
    """Which of some particles are clear of solids, which is asked for those alone."""
    some = some.copy()
    if some.any():
        some[some] = clear(x[some])
    return some


def _rotation(curl: Floats) -> Floats:
    """Affine fields [1/s], shape [n, 3, 3], of rigid rotations that have a `curl` [n, 3] [1/s]."""
    affine = np.zeros((len(curl), 3, 3))
    for k in range(3):
        affine[:, (k + 2) % 3, (k + 1) % 3] = 0.5 * curl[:, k]
        affine[:, (k + 1) % 3, (k + 2) % 3] = -0.5 * curl[:, k]
    return affine


def _spin_inertia(spacing: float) -> float:
    """Angular momentum of a particle by its mass and the curl of its field: what quadratic weights spread it over [m^2]."""
    return 0.25 * spacing**2


def _taken(state: LiquidState, particles: Ints) -> LiquidState:
    """The state of some particles, which may be named twice."""
    whole = ("emitted", "drained")
    kept = {field.name: getattr(state, field.name) for field in fields(state) if field.name not in whole}
    return replace(state, **{name: array[particles] for name, array in kept.items() if array is not None})


def _joined(state: LiquidState, a: Ints, b: Ints, spacing: float, period: Floats) -> LiquidState:
    """The state in which particles `b` have joined particles `a`; all others stay in order."""
    kept = np.ones(len(state.x), np.bool_)
    kept[b] = False
    volume = state.volume[a] + state.volume[b]
    share = state.volume[b] / volume
    way = state.x[b] - state.x[a]
    way -= period * np.rint(np.divide(way, period, out=np.zeros_like(way), where=period > 0.0))
    orbit = (share * (1.0 - share))[:, None] * np.cross(way, state.velocity[b] - state.velocity[a])

    joined, one, other = _taken(state, np.flatnonzero(kept)), _taken(state, a), _taken(state, b)
    at = np.cumsum(kept)[a] - 1
    joined.volume[at] = volume
    joined.x[at] = one.x + share[:, None] * way
    joined.velocity[at] = _mean(one.velocity, other.velocity, share)
    joined.affine[at] = _mean(one.affine, other.affine, share) + _rotation(orbit / _spin_inertia(spacing))
    if joined.strain is not None:
        joined.strain[at] = _volume_preserving(_mean(one.strain, other.strain, share))
    if joined.compression is not None:
        joined.compression[at] = _mean(one.compression, other.compression, share)
    if joined.plastic_strain is not None:
        joined.plastic_strain[at] = _mean(one.plastic_strain, other.plastic_strain, share)
    return joined


def _mean(one, other, share):
    """The mean of two arrays [n, ...] where the other has a share [n]."""
    share = share.reshape((-1,) + (1,) * (one.ndim - 1))
    return (1.0 - share) * one + share * other


def _volume_preserving(strain: Floats) -> Floats:
    """Strains [n, 6] scaled to the determinant 1; that of a mean is not less."""
    xx, yy, zz, yz, xz, xy = strain.T
    determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    return strain / np.cbrt(determinant)[:, None]


def _halved(state: LiquidState, whole: Ints, spacing: float) -> LiquidState:
    """The state in which each particle of `whole` is one half of itself, and the other halves come last, in order."""
    count = len(state.x)
    half = 0.5 * state.volume[whole]
    way = np.minimum(0.5 * np.cbrt(half), FURTHEST * spacing)[:, None] * _directions(state.x[whole])
    faster = np.einsum("pij,pj->pi", state.affine[whole], way)
    orbit = np.cross(way, faster)

    halved = _taken(state, np.concatenate([np.arange(count), whole]))
    for part, side in ((whole, 1.0), (slice(count, None), -1.0)):
        halved.volume[part] = half
        halved.x[part] += side * way
        halved.velocity[part] += side * faster
        halved.affine[part] -= _rotation(orbit / _spin_inertia(spacing))
    return halved


def _directions(x: Floats) -> Floats:
    """Unit vectors, spread evenly over all directions, that the bits of places [n, 3] decide whatever their order."""
    bits = np.ascontiguousarray(x).view(np.uint64)
    mixed = _mixed(_mixed(_mixed(bits[:, 0]) ^ bits[:, 1]) ^ bits[:, 2])
    height = 2.0 * _fraction(mixed) - 1.0
    angle, radius = 2.0 * pi * _fraction(_mixed(mixed)), np.sqrt(1.0 - height**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)


def _mixed(bits):
    """Bits, each of which depends on all that were given (the finisher of splitmix64, Steele et al. 2014)."""
    bits = bits + np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


def _fraction(bits):
    return (bits >> np.uint64(11)) * 2.0**-53


@njit(cache=True)
def _nearest(x, volume, start, near, willing, most, period):
    """The particle that each would join, shape [P], -1 if none: ties go to the lower one, so that the nearest pair always joins.

    Pairs are those of small particles with willing neighbours that together have at most the volume `most`.
    """
    nearest, distance = np.full(len(x), -1, np.int64), np.full(len(x), np.inf)
    for i in range(len(x)):
        for n in range(start[i], start[i + 1]):
            j = near[n]
            if not willing[j] or volume[i] + volume[j] > most:
                continue
            r = apart(x, i, j, period)
            for one, other in ((i, j), (j, i)):
                if dot(r, r) < distance[one] or (dot(r, r) == distance[one] and other < nearest[one]):
                    nearest[one], distance[one] = other, dot(r, r)
    return nearest


@njit(cache=True)
def _push(i, j, r, volume, edge):
    """Length of the push that two particles give each other: volume times way [m^4]."""
    length = np.sqrt(dot(r, r))
    overlap = 0.5 * (edge[i] + edge[j]) - length
    if overlap <= 0.0 or length == 0.0:
        return 0.0
    return STIFFNESS * overlap * volume[i] * volume[j] / (volume[i] + volume[j])


@njit(cache=True, parallel=True)
def _shares(x, volume, edge, start, near, period, most):
    """How much of its pushes each particle bears, shape [P], so as not to move further than `most` [m]."""
    share = np.empty(len(x))
    for i in prange(len(x)):
        total = 0.0
        for n in range(start[i], start[i + 1]):
            total += _push(i, near[n], apart(x, i, near[n], period), volume, edge)
        share[i] = min(1.0, most * volume[i] / total) if total > 0.0 else 1.0
    return share


@njit(cache=True, parallel=True)
def _apart(x, velocity, affine, volume, edge, start, near, period, share):
    """How far particles move [m], how much faster they get [m/s], what they owe to spins [m^2/s], shape [P, 3] each."""
    moved, kicked, twisted = np.zeros(x.shape), np.zeros(x.shape), np.zeros(x.shape)
    for i in prange(len(x)):
        for n in range(start[i], start[i + 1]):
            j = near[n]
            r = apart(x, i, j, period)
            push = _push(i, j, r, volume, edge)
            if push == 0.0:
                continue
            scale = min(share[i], share[j]) * push / (np.sqrt(dot(r, r)) * volume[i])
            q = scale * r[0], scale * r[1], scale * r[2]
            faster = _along(affine, i, j, q)
            v, w = row(velocity, i), row(velocity, j)
            orbit, swing = cross(q, (v[0] - w[0], v[1] - w[1], v[2] - w[2])), cross(r, faster)
            for k in range(3):
                moved[i, k] += q[k]
                kicked[i, k] += faster[k]
                twisted[i, k] -= 0.5 * (orbit[k] + swing[k])
    return moved, kicked, twisted


@njit(cache=True)
def _along(affine, i, j, q):
    """Change of velocity along q in the mean affine field of two particles."""
    a, b = affine[i], affine[j]
    return (
        0.5 * (dot(row(a, 0), q) + dot(row(b, 0), q)),
        0.5 * (dot(row(a, 1), q) + dot(row(b, 1), q)),
        0.5 * (dot(row(a, 2), q) + dot(row(b, 2), q)),
    )
