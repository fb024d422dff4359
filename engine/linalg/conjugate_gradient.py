"""Preconditioned conjugate gradients on block vectors, the same to the bit on any number of threads."""

from typing import NamedTuple, Protocol

import numpy as np
from numba import njit, prange
from scipy.linalg import eigvalsh_tridiagonal

from engine.arrays import Floats
from engine.linalg.block_matrix import CHUNK, BlockMatrix

LOOKS = (10, 20, 40)  # iterations after which the spectrum is looked at


class Preconditioner(Protocol):
    """Anything that applies an approximate inverse."""

    def solve(self, b: Floats, out: Floats) -> None:
        """Write the approximate solution for right-hand side b into out."""


class Outcome(NamedTuple):
    """What became of a solution."""

    iterations: int
    positive: bool  # matrix and preconditioner were along all directions of the search, so that x descends along b
    sound: bool  # no eigenvalue of M^-1 A was found to be an outlier
    curvature: Floats | None = None  # each row's share in p.Ap, where a direction p made that negative, shape [n]


def conjugate_gradient(
    a: BlockMatrix, b: Floats, x: Floats, preconditioner: Preconditioner, tolerance: float, max_iterations: int,
    floor: float = 0.0, outlier: float = np.inf,
) -> Outcome:
    """Solve a x = b from x = 0 until the preconditioned residual falls by `tolerance`, or all of it to `floor`.

    b and x have shape [n, 5]; x is overwritten. All other vectors have the precision of the matrix. The norm is that of the
    preconditioner, in which the iteration itself measures: (r, M^-1 r)^1/2; `floor` bounds every component of r. It ends
    early where matrix or preconditioner are found not to be positive, or the latter not to be sound: factors that nearly
    broke down give M^-1 A a few huge eigenvalues, which the Lanczos matrix of the iteration shows long before they have
    been dealt with. `outlier` is what none may exceed.
    """
    x[:] = 0.0
    r = b.astype(a.block.dtype)
    z = np.empty_like(r)
    q = np.empty_like(r)
    preconditioner.solve(r, z)
    p = z.copy()
    rho = dot(r, z)
    target = tolerance * tolerance * rho
    steps: list[float] = []
    turns: list[float] = []
    if rho <= 0.0:
        return Outcome(0, rho == 0.0, True)
    for iteration in range(1, max_iterations + 1):
        a.multiply(p, q)
        curvature = dot(p, q)
        if curvature <= 0.0:
            return Outcome(iteration, False, True, np.einsum("ik,ik->i", p, q))
        steps.append(rho / curvature)
        advance(steps[-1], p, q, x, r)
        preconditioner.solve(r, z)
        rho_next = dot(r, z)
        if rho_next < -target:
            return Outcome(iteration, False, True)
        if rho_next <= target or largest(r) <= floor:
            return Outcome(iteration, True, True)
        if iteration in LOOKS and largest_eigenvalue(steps, turns) > outlier:
            return Outcome(iteration, True, False)
        turns.append(rho_next / rho)
        turn(turns[-1], z, p)
        rho = rho_next
    return Outcome(max_iterations, True, True)


def largest_eigenvalue(steps: list[float], turns: list[float]) -> float:
    """Return the estimate of the largest eigenvalue of M^-1 A that k steps alpha and k - 1 turns beta of the iteration give."""
    alpha, beta = np.array(steps), np.array(turns)
    diagonal = 1.0 / alpha
    diagonal[1:] += beta / alpha[:-1]
    return float(eigvalsh_tridiagonal(diagonal, np.sqrt(beta) / alpha[:-1]).max())


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
                s += np.float64(a[i, k]) * np.float64(b[i, k])
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
