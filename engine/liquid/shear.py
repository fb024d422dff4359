"""The semi-implicit shear solve (Fei 2019, eq. 14.6): velocities that agree with the shear stress that they lead to.

Momentum is M (u - u_free) = h f(u), where the force f is that of the particles' stress after the step has strained them and let
them flow (eqs. 14.7 and 14.9). Newton's iterations solve it: the residual is the true one, the matrix the symmetric positive
part of the derivative (eqs. 14.25 to 14.30), applied particle by particle and never put together. Stress of Newtonian liquids is
linear in u; then one iteration does, and no strain is looked at.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from engine.arrays import Floats, Singles
from engine.linalg.conjugate_gradient import advance, dot, turn
from engine.liquid.grid import CELLS, COLOURS, Grid
from engine.liquid.mirror import Mirror, collect, reflect, reflect_change
from engine.liquid.model import LiquidModel
from engine.liquid.rheology import (
    elastic_trial,
    newtonian_stress,
    plastic_return,
    strain_rate,
    tangent_stress,
    trial_stress,
)
from engine.liquid.settings import LiquidSettings
from engine.liquid.transfer import FIELD, add, gather, load, scatter, weigh

INEXACT = 0.1  # of the residual of an iteration, that its linear solve may leave
ROUND_OFF = 1e-9  # of momentum, below which impulses are nothing
SHRINK, MOST_SHRINKS = 0.5, 8  # of steps that do not lessen the residual


class Sheared(NamedTuple):
    """What the shear solve has come to."""

    u: Floats  # of faces [m/s], shape [3, B, 64]
    converged: bool
    newton: int
    linear: int
    residual: float  # what is left over, in units of the impulses of gravity and stress
    inertia: Floats | None  # share of mass, beside stress, in the diagonal of Newton's matrix [3, B, 64]; None where liquid slips


def shear_solve(
    grid: Grid, model: LiquidModel, settings: LiquidSettings, x: Floats, volume: Floats, strain: Floats | None, mirror: Mirror,
    mass: Floats, u: Floats, free: Floats, h: float,
) -> Sheared:
    """Return the velocities of faces after a step of `h` [s] of shear stress.

    `u` [3, B, 64] [m/s] are velocities before the step, `free` those that other forces lead to; faces with a `mass` [3, B, 64]
    [kg], which has that of faces behind walls, move. Particles at x [P, 3] [m] have a `volume` [P] [m^3] at rest and, unless
    Newtonian, an elastic strain [P, 6].
    """
    system = _System(grid, model, settings, x, volume, strain, mirror, mass, u, free, h)
    u = np.where(mass > 0.0, u, 0.0)
    left, scale = system.residual(u)
    newton = linear = 0
    while (size := system.norm(left)) > settings.shear_tolerance * scale and newton < settings.max_newton:
        goal = INEXACT if model.elastic else 0.1 * settings.shear_tolerance * scale / size
        change, iterations = system.direction(left, goal, settings.max_linear)
        newton, linear, step = newton + 1, linear + iterations, 1.0
        for _ in range(MOST_SHRINKS):
            trial = u + step * change
            left, scale = system.residual(trial)
            if system.norm(left) < (1.0 - 1e-4 * step) * size:
                break
            step *= SHRINK
        else:
            return Sheared(u, False, newton, linear, size / scale, None)
        u = trial
    converged = size <= settings.shear_tolerance * scale
    inertia = system.inertia() if converged and model.no_slip else None
    return Sheared(u, converged, newton, linear, size / scale if scale > 0.0 else 0.0, inertia)


class _System:
    """The equations of one step."""

    def __init__(
        self, grid: Grid, model: LiquidModel, settings: LiquidSettings, x: Floats, volume: Floats, strain: Floats | None,
        mirror: Mirror, mass: Floats, before: Floats, free: Floats, h: float,
    ):
        self.grid, self.model, self.x, self.volume, self.strain, self.mirror = grid, model, x, volume, strain, mirror
        self.h, self.free, self.implicit = h, free, settings.plastic_flow == "implicit"
        self.mass = mass.copy()
        self.mass.reshape(-1)[mirror.face] = 0.0
        self.inverse = np.divide(1.0, self.mass, out=np.zeros_like(mass), where=self.mass > 0.0)
        self.tangent: Singles = np.empty((len(x) if model.elastic else 0, 8), np.float32)
        self.force, self.diagonal = grid.faces(), grid.faces()
        self.driven = self.norm(self.mass * (free - before)) + ROUND_OFF * self.norm(self.mass * free)

    def residual(self, u: Floats) -> tuple[Floats, float]:
        """Reflect u at walls; return the impulse that it leaves over [kg m/s], and the norm of what drives it and of stress."""
        reflect(self.mirror, u)
        self.force[:] = 0.0
        model = self.model
        if model.elastic:
            assert self.strain is not None
            add_elastic_impulse(self.grid, self.x, self.volume, self.strain, u, self.h, model.shear_modulus,
                                np.sqrt(2.0 / 3.0) * model.yield_stress, model.consistency, model.flow_index, self.implicit,
                                self.force, self.tangent)
        else:
            add_viscous_impulse(self.grid, self.x, self.volume, u, self.h, model.consistency, self.force)
        collect(self.mirror, self.force)
        left = self.mass * (self.free - u) + self.force
        return left, self.norm(self.force) + self.driven

    def norm(self, impulse: Floats) -> float:
        """Return the norm of an impulse, in which its square is twice the energy that it gives to what is at rest."""
        return float(np.sqrt(dot(_rows(impulse), _rows(self.inverse * impulse))))

    def direction(self, left: Floats, goal: float, most: int) -> tuple[Floats, int]:
        """Return the change of u [3, B, 64] that Newton's matrix gives, by preconditioned conjugate gradients."""
        self._set_diagonal()
        change, r, q = np.zeros_like(left), left.copy(), np.empty_like(left)
        z = r / self.diagonal
        p = z.copy()
        rho = dot(_rows(r), _rows(z))
        target = goal * goal * rho
        for iteration in range(1, most + 1):
            self._multiply(p, q)
            advance(rho / dot(_rows(p), _rows(q)), _rows(p), _rows(q), _rows(change), _rows(r))
            np.divide(r, self.diagonal, out=z)
            rho_next = dot(_rows(r), _rows(z))
            if rho_next <= target:
                return change, iteration
            turn(rho_next / rho, _rows(z), _rows(p))
            rho = rho_next
        return change, most

    def inertia(self) -> Floats:
        """Return the share of mass in the diagonal of Newton's matrix at the velocities that `residual` last saw [3, B, 64].

        Without what faces behind walls add to it; 0 where there is no mass.
        """
        self._set_diagonal()
        return self.mass / self.diagonal

    def _multiply(self, p: Floats, q: Floats) -> None:
        """Write what Newton's matrix makes of a change p of u."""
        reflect_change(self.mirror, p)
        q[:] = 0.0
        if self.model.elastic:
            add_tangent_impulse(self.grid, self.x, self.tangent, p, q)
        else:
            add_viscous_impulse(self.grid, self.x, self.volume, p, self.h, self.model.consistency, q)
        collect(self.mirror, q)
        p.reshape(-1)[self.mirror.face] = 0.0
        np.subtract(self.mass * p, q, out=q)

    def _set_diagonal(self) -> None:
        """Write the diagonal of Newton's matrix, but for what stress does more along its direction than across."""
        across = self.tangent[:, 6] if self.model.elastic else (self.h * self.model.consistency * self.volume).astype(np.float32)
        np.copyto(self.diagonal, self.mass)
        add_diagonal(self.grid, self.x, across, self.diagonal)
        self.diagonal[self.mass == 0.0] = 1.0


def _rows(faces: Floats) -> Floats:
    return faces.reshape(-1, CELLS)


@njit(cache=True, inline="always")
def _gradient(tiles, weight, first, scale, gradient):
    """Write the velocity gradient [3, 3] [1/s] at a particle."""
    for a in range(3):
        _, gx, gy, gz = gather(tiles[a], weight, first, a)
        gradient[a, 0], gradient[a, 1], gradient[a, 2] = scale * gx, scale * gy, scale * gz


@njit(cache=True, inline="always")
def _scatter_stress(tiles, weight, first, factor, s):
    """Add the force of a shear stress [6] times `factor` to the nodes around a particle (Fei 2019, eq. 14.7)."""
    scatter(tiles[0], weight, first, 0, 0.0, factor * s[0], factor * s[5], factor * s[4])
    scatter(tiles[1], weight, first, 1, 0.0, factor * s[5], factor * s[1], factor * s[3])
    scatter(tiles[2], weight, first, 2, 0.0, factor * s[4], factor * s[3], factor * s[2])


@njit(cache=True, parallel=True)
def add_elastic_impulse(grid, x, volume, strain, u, h, shear_modulus, yield_norm, consistency, flow_index, implicit, force,
                        tangent):
    """Add the impulse of shear stress [kg m/s] that u [3, B, 64] [m/s] leads to in a step of h [s], to `force` [3, B, 64].

    Writes what its derivative needs: of every particle the unit direction of stress, and `across` and `along` of
    `tangent_stress` times volume and step, `tangent` [P, 8].
    """
    scale = 4.0 / grid.spacing
    for colour in range(COLOURS):
        for t in prange(grid.turns[colour], grid.turns[colour + 1]):
            b = grid.turn[t]
            tiles, forces = np.empty((3, FIELD)), np.zeros((3, FIELD))
            weight, first, gradient = np.empty((3, 2, 6)), np.empty((3, 2), np.int64), np.empty((3, 3))
            for a in range(3):
                load(grid.near[b], u[a], tiles[a])
            for p in range(grid.start[b], grid.start[b + 1]):
                weigh(x[p], grid.origin, grid.spacing, grid.place[b], weight, first)
                _gradient(tiles, weight, first, scale, gradient)
                trial = elastic_trial(strain[p], gradient, h)
                unit, size, mu_hat = trial_stress(trial, shear_modulus)
                pull = shear_modulus * size
                s, slope = plastic_return(pull, mu_hat, h, yield_norm, consistency, flow_index, implicit)
                _scatter_stress(forces, weight, first, -h * volume[p] * s * scale, unit)
                for k in range(6):
                    tangent[p, k] = unit[k]
                stiff = 2.0 * mu_hat * h * h * volume[p]
                tangent[p, 6] = stiff * (s / pull if pull > 0.0 else slope)
                tangent[p, 7] = stiff * slope
            for a in range(3):
                add(grid.near[b], forces[a], force[a])


@njit(cache=True, parallel=True)
def add_tangent_impulse(grid, x, tangent, u, force):
    """Add the change of the impulse of `add_elastic_impulse` by a change u [3, B, 64] [m/s], to `force` [3, B, 64]."""
    scale = 4.0 / grid.spacing
    for colour in range(COLOURS):
        for t in prange(grid.turns[colour], grid.turns[colour + 1]):
            b = grid.turn[t]
            tiles, forces = np.empty((3, FIELD)), np.zeros((3, FIELD))
            weight, first, gradient = np.empty((3, 2, 6)), np.empty((3, 2), np.int64), np.empty((3, 3))
            for a in range(3):
                load(grid.near[b], u[a], tiles[a])
            for p in range(grid.start[b], grid.start[b + 1]):
                weigh(x[p], grid.origin, grid.spacing, grid.place[b], weight, first)
                _gradient(tiles, weight, first, scale, gradient)
                s = tangent_stress(strain_rate(gradient), tangent[p], tangent[p, 6], tangent[p, 7])
                _scatter_stress(forces, weight, first, -scale, s)
            for a in range(3):
                add(grid.near[b], forces[a], force[a])


@njit(cache=True, parallel=True)
def add_viscous_impulse(grid, x, volume, u, h, consistency, force):
    """Add the impulse of a Newtonian liquid's shear stress in a step of h [s] [kg m/s], to `force` [3, B, 64]."""
    scale = 4.0 / grid.spacing
    for colour in range(COLOURS):
        for t in prange(grid.turns[colour], grid.turns[colour + 1]):
            b = grid.turn[t]
            tiles, forces = np.empty((3, FIELD)), np.zeros((3, FIELD))
            weight, first, gradient = np.empty((3, 2, 6)), np.empty((3, 2), np.int64), np.empty((3, 3))
            for a in range(3):
                load(grid.near[b], u[a], tiles[a])
            for p in range(grid.start[b], grid.start[b + 1]):
                weigh(x[p], grid.origin, grid.spacing, grid.place[b], weight, first)
                _gradient(tiles, weight, first, scale, gradient)
                _scatter_stress(forces, weight, first, -h * volume[p] * scale, newtonian_stress(gradient, consistency))
            for a in range(3):
                add(grid.near[b], forces[a], force[a])


@njit(cache=True, parallel=True)
def add_diagonal(grid, x, across, diagonal):
    """Add to `diagonal` [3, B, 64] what the impulse on a face changes by with its own velocity [kg].

    `across` [P] is that of `tangent_stress` times volume and step. Where component a has the gradient g, the square of the
    strain rate's deviator is |g|^2 / 2 + g_a^2 / 6.
    """
    scale = 16.0 / grid.spacing**2
    for colour in range(COLOURS):
        for t in prange(grid.turns[colour], grid.turns[colour + 1]):
            b = grid.turn[t]
            tiles = np.zeros((3, FIELD))
            weight, first = np.empty((3, 2, 6)), np.empty((3, 2), np.int64)
            for p in range(grid.start[b], grid.start[b + 1]):
                weigh(x[p], grid.origin, grid.spacing, grid.place[b], weight, first)
                for axis in range(3):
                    for kind in range(2):
                        for k in range(6):
                            weight[axis, kind, k] *= weight[axis, kind, k]
                side, own = scale * across[p] / 2.0, scale * across[p] * 2.0 / 3.0
                scatter(tiles[0], weight, first, 0, 0.0, own, side, side)
                scatter(tiles[1], weight, first, 1, 0.0, side, own, side)
                scatter(tiles[2], weight, first, 2, 0.0, side, side, own)
            for a in range(3):
                add(grid.near[b], tiles[a], diagonal[a])


@njit(cache=True, parallel=True)
def add_to_cells(grid, x, value, cells):
    """Add numbers of particles [P] at x [P, 3] [m] to cells [B, 64], by their splines."""
    for colour in range(COLOURS):
        for t in prange(grid.turns[colour], grid.turns[colour + 1]):
            b = grid.turn[t]
            tile = np.zeros(FIELD)
            weight, first = np.empty((3, 2, 6)), np.empty((3, 2), np.int64)
            for p in range(grid.start[b], grid.start[b + 1]):
                weigh(x[p], grid.origin, grid.spacing, grid.place[b], weight, first)
                scatter(tile, weight, first, 3, np.float64(value[p]), 0.0, 0.0, 0.0)
            add(grid.near[b], tile, cells)
