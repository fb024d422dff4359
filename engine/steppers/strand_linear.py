"""Strands as they answer in the neighbourhood of where they are in a step: their gradients and Hessians."""

import numpy as np
from numba import njit, prange

from engine.arrays import Ints
from engine.contact.augmented_lagrangian import Strands
from engine.linalg import banded
from engine.steppers.strand_newton import PIECES
from engine.strands import potential
from engine.strands.loads import Inertia
from engine.strands.model import StrandModel, StrandState


def linearised(model: StrandModel, inertia: Inertia, which: Ints, before: StrandState, after: StrandState) -> Strands:
    """Return the strands `which` [A] as they answer at `after`, in a step from `before`.

    A Hessian that is not positive is replaced by its positive form.
    """
    vertices = len(before.x)
    gradient, band = np.empty((vertices, 4)), np.empty((4 * vertices, banded.WIDTH + 1))
    _linearise(model, inertia, which, before.x, before.m1, before.twist, after.x, after.turn, gradient, band)
    return Strands(model.start, gradient, band, model.held)


@njit(cache=True, parallel=True, error_model="numpy")
def _linearise(model, inertia, which, x0, m1, twist, x, turned, gradient, band):
    start = model.start
    longest = (start[1:] - start[:-1]).max()
    for piece in prange(PIECES):
        step, now, other = potential.step_of(longest), potential.geometry(longest), potential.geometry(longest)
        factor, local = np.empty((4 * longest, banded.WIDTH + 1)), np.empty((12, 8))
        for i in range(piece * len(which) // PIECES, (piece + 1) * len(which) // PIECES):
            a, b = start[which[i]], start[which[i] + 1]
            n, h = b - a, inertia.effective[a]
            own, shape = potential.first_of_step(step, n), potential.first_of_geometry(now, n)
            there = potential.first_of_geometry(other, n)
            potential.begin(model, inertia, which[i], x0[a:b], m1[a:b], twist[a:b], own, shape, there)
            potential.follow(x[a:b], turned[a:b], shape, there)
            potential.gradient(x[a:b], turned[a:b], there, own, h, local[0], gradient[a:b])
            potential.hessian(there, own, h, False, local, band[4 * a : 4 * b])
            factor[: 4 * n] = band[4 * a : 4 * b]
            if not banded.factorise(factor[: 4 * n]):
                potential.hessian(there, own, h, True, local, band[4 * a : 4 * b])
