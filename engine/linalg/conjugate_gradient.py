"""Preconditioned conjugate gradients on block vectors, the same to the bit on any number of threads."""

from typing import Protocol

import numpy as np
from numba import njit, prange

from engine.arrays import Floats
from engine.linalg.block_matrix import CHUNK, BlockMatrix


class Preconditioner(Protocol):
    """Anything that applies an approximate inverse."""

    def solve(self, b: Floats, out: Floats) -> None:
        """Write the approximate solution for right-hand side b into out."""


def conjugate_gradient(
    a: BlockMatrix, b: Floats, x: Floats, preconditioner: Preconditioner, tolerance: float, max_iterations: int,
    floor: float = 0.0,
) -> tuple[int, bool]:
    """Solve a x = b from x = 0 until the preconditioned residual falls by `tolerance`, or all of it to `floor`.

    Returns the number of iterations, and whether the matrix was found positive along all of them.

    b and x have shape [n, 5]; x is overwritten. The norm is that of the preconditioner, in which the iteration itself
    measures: (r, M^-1 r)^1/2; `floor` bounds every component of r.
    """
    x[:] = 0.0
    r = b.copy()
    z = np.empty_like(b)
    q = np.empty_like(b)
    preconditioner.solve(r, z)
    p = z.copy()
    rho = dot(r, z)
    target = tolerance * tolerance * rho
    for iteration in range(1, max_iterations + 1):
        if rho <= 0.0:
            return iteration - 1, True
        a.multiply(p, q)
        curvature = dot(p, q)
        if curvature <= 0.0:
            return iteration, False
        advance(rho / curvature, p, q, x, r)
        preconditioner.solve(r, z)
        rho_next = dot(r, z)
        if rho_next <= target or largest(r) <= floor:
            return iteration, True
        turn(rho_next / rho, z, p)
        rho = rho_next
    return max_iterations, True


@njit(cache=True, parallel=True)
def dot(a, b):
    """Inner product of two block vectors: sums over fixed chunks of rows, then their sum in order."""
    rows = len(a)
    chunks = (rows + CHUNK - 1) // CHUNK
    partial = np.zeros(chunks)
    for chunk in prange(chunks):
        s = 0.0
        for i in range(chunk * CHUNK, min((chunk + 1) * CHUNK, rows)):
            for k in range(a.shape[1]):
                s += a[i, k] * b[i, k]
        partial[chunk] = s
    total = 0.0
    for chunk in range(chunks):
        total += partial[chunk]
    return total


@njit(cache=True, parallel=True)
def largest(a):
    """Largest absolute value of a block vector."""
    rows = len(a)
    chunks = (rows + CHUNK - 1) // CHUNK
    partial = np.zeros(chunks)
    for chunk in prange(chunks):
        most = 0.0
        for i in range(chunk * CHUNK, min((chunk + 1) * CHUNK, rows)):
            for k in range(a.shape[1]):
                most = max(most, abs(a[i, k]))
        partial[chunk] = most
    return partial.max()


@njit(cache=True, parallel=True)
def advance(alpha, p, q, x, r):
    """x += alpha p and r -= alpha q."""
    for i in prange(x.shape[0]):
        for k in range(x.shape[1]):
            x[i, k] += alpha * p[i, k]
            r[i, k] -= alpha * q[i, k]


@njit(cache=True, parallel=True)
def turn(beta, z, p):
    """p = z + beta p."""
    for i in prange(p.shape[0]):
        for k in range(p.shape[1]):
            p[i, k] = z[i, k] + beta * p[i, k]
