"""What a step does to particles: they strain and flow, swell, and move (Fei 2019, algorithm 2, items 7 to 12)."""

import numpy as np
from numba import njit, prange

from engine.liquid.rheology import (
    elastic_trial,
    plastic_return,
    plastic_strain,
    relaxed_strain,
    trial_stress,
    volume_preserving,
)
from engine.liquid.transfer import FIELD, gather, load, weigh

ROUND_OFF = 1e-15  # of a period


@njit(cache=True, parallel=True)
def flow(affine, h, shear_modulus, yield_norm, consistency, flow_index, recovery_rate, implicit, strain, history):
    """Strain particles [P, 6] by their velocity gradient `affine` [P, 3, 3] [1/s] for h [s] and let them flow.

    Their plastic strain `history` [P] grows by it and recovers.
    """
    for p in prange(len(affine)):
        trial = elastic_trial(strain[p], affine[p], h)
        _, size, mu_hat = trial_stress(trial, shear_modulus)
        pull = shear_modulus * size
        s, _ = plastic_return(pull, mu_hat, h, yield_norm, consistency, flow_index, implicit)
        history[p] = plastic_strain(history[p], pull, s, mu_hat, recovery_rate, h)
        after = trial
        if s < pull:
            after = volume_preserving(relaxed_strain(trial, s / pull))
        for k in range(6):
            strain[p, k] = after[k]


@njit(cache=True, parallel=True)
def swell(grid, x, rate, wet, h, compression):
    """Let volumes over those at rest [P] grow for h [s] at the rate of divergence of cells [B, 64] [1/s], where these are `wet`.

    Splines count among wet cells only: there the pressure has settled what divergence is. Away from them volumes stay.
    """
    for t in prange(len(grid.turn)):
        b = grid.turn[t]
        rates, wets = np.empty(FIELD), np.empty(FIELD)
        weight, first = np.empty((3, 2, 6)), np.empty((3, 2), np.int64)
        load(grid.near[b], rate, rates)
        load(grid.near[b], wet, wets)
        for p in range(grid.start[b], grid.start[b + 1]):
            weigh(x[p], grid.origin, grid.spacing, grid.place[b], weight, first)
            share, _, _, _ = gather(wets, weight, first, 3)
            if share > 1e-6:
                growth, _, _, _ = gather(rates, weight, first, 3)
                compression[p] *= np.exp(h * growth / share)


@njit(cache=True, parallel=True)
def tear(history, limit, compression):
    """Take tension from particles whose plastic strain is beyond a limit: they are no larger than at rest."""
    for p in prange(len(history)):
        if history[p] > limit:
            compression[p] = min(compression[p], 1.0)


@njit(cache=True, parallel=True)
def move(x, velocity, h):
    """Move particles at x [P, 3] [m] for h [s]."""
    for p in prange(len(x)):
        for k in range(3):
            x[p, k] += h * velocity[p, k]


@njit(cache=True, parallel=True)
def shift(grid, x, by):
    """Move particles at x [P, 3] [m], by which they are sorted, by displacements of faces [3, B, 64] [m]."""
    for t in prange(len(grid.turn)):
        b = grid.turn[t]
        tiles = np.empty((3, FIELD))
        weight, first = np.empty((3, 2, 6)), np.empty((3, 2), np.int64)
        for a in range(3):
            load(grid.near[b], by[a], tiles[a])
        for p in range(grid.start[b], grid.start[b + 1]):
            weigh(x[p], grid.origin, grid.spacing, grid.place[b], weight, first)
            for a in range(3):
                value, _, _, _ = gather(tiles[a], weight, first, a)
                x[p, a] += value


@njit(cache=True, parallel=True)
def wrap(x, origin, length):
    """Bring x [P, 3] [m] back within the period `length` [3] [m] of space, 0 where it has none.

    What round-off leaves at or beyond its ends is put at its beginning, so that it lies in a block of the period.
    """
    for p in prange(len(x)):
        for k in range(3):
            if length[k] > 0.0:
                x[p, k] -= length[k] * np.floor((x[p, k] - origin[k]) / length[k])
                if not 0.0 <= x[p, k] - origin[k] < (1.0 - ROUND_OFF) * length[k]:
                    x[p, k] = origin[k]
