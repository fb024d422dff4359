"""Block incomplete Cholesky factors without fill, as a preconditioner."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from engine.linalg.block_matrix import BLOCK, BlockMatrix
from engine.arrays import Floats, Ints

FIRST_SHIFT = 1e-3
LARGEST_SHIFT = 1.0


@dataclass
class IncompleteCholesky:
    """L with A ~ L L^T on the lower pattern of A; the diagonal blocks are stored as their inverses."""

    start: Ints
    column: Ints
    diagonal: Ints
    lower: Floats
    inverse: Floats
    shift: float

    def solve(self, b: Floats, out: Floats) -> None:
        """Write (L L^T)^-1 b into out, both [n, 5]."""
        _solve(self.start, self.column, self.diagonal, self.lower, self.inverse, b, out)


def factorise(a: BlockMatrix) -> IncompleteCholesky | None:
    """Factorise a symmetric matrix on its own pattern; None where it is too far from positive definite.

    Dropping fill can lose positive definiteness; the factorisation is then repeated for A + shift diag(A) with a
    growing shift.
    """
    lower = np.empty_like(a.block)
    inverse = np.empty((a.rows, BLOCK, BLOCK))
    shift = 0.0
    position = np.full(a.rows, -1, np.int64)
    while not _factorise(a.start, a.column, a.diagonal, a.block, shift, lower, inverse, position):
        shift = max(FIRST_SHIFT, 4.0 * shift)
        if shift > LARGEST_SHIFT:
            return None
    return IncompleteCholesky(a.start, a.column, a.diagonal, lower, inverse, shift)


@njit(cache=True)
def _factorise(start, column, diagonal, block, shift, lower, inverse, position):
    position[:] = -1
    pivot = np.empty((BLOCK, BLOCK))
    for i in range(len(diagonal)):
        first, last = start[i], diagonal[i]
        for r in range(BLOCK):
            for c in range(BLOCK):
                pivot[r, c] = block[last, r, c]
            pivot[r, r] *= 1.0 + shift
        for k in range(first, last):
            position[column[k]] = k
        for k in range(first, last):
            j = column[k]
            lower[k] = block[k]
            for m in range(start[j], diagonal[j]):
                p = position[column[m]]
                if p >= 0:
                    for r in range(BLOCK):
                        for c in range(BLOCK):
                            s = 0.0
                            for t in range(BLOCK):
                                s += lower[p, r, t] * lower[m, c, t]
                            lower[k, r, c] -= s
            for r in range(BLOCK):  # L_ij = (...) L_jj^-T, in place from the last column
                for c in range(BLOCK - 1, -1, -1):
                    s = 0.0
                    for t in range(c + 1):
                        s += lower[k, r, t] * inverse[j, c, t]
                    lower[k, r, c] = s
            for r in range(BLOCK):
                for c in range(r + 1):
                    s = 0.0
                    for t in range(BLOCK):
                        s += lower[k, r, t] * lower[k, c, t]
                    pivot[r, c] -= s
        for k in range(first, last):
            position[column[k]] = -1
        if not _inverse_factor(pivot, block[last], inverse[i]):
            return False
    return True


@njit(cache=True)
def _inverse_factor(pivot, original, inverse):
    """Cholesky factor of a pivot block and its inverse; false if a pivot lost too much of the original diagonal."""
    for c in range(BLOCK):
        s = pivot[c, c]
        for t in range(c):
            s -= pivot[c, t] * pivot[c, t]
        if not s > 1e-10 * original[c, c]:
            return False
        pivot[c, c] = np.sqrt(s)
        for r in range(c + 1, BLOCK):
            s = pivot[r, c]
            for t in range(c):
                s -= pivot[r, t] * pivot[c, t]
            pivot[r, c] = s / pivot[c, c]
    for c in range(BLOCK):
        for r in range(BLOCK):
            inverse[r, c] = 0.0
        inverse[c, c] = 1.0 / pivot[c, c]
        for r in range(c + 1, BLOCK):
            s = 0.0
            for t in range(c, r):
                s -= pivot[r, t] * inverse[t, c]
            inverse[r, c] = s / pivot[r, r]
    return True


@njit(cache=True)
def _solve(start, column, diagonal, lower, inverse, b, out):
    n = len(diagonal)
    y = np.empty(BLOCK)
    for i in range(n):
        for r in range(BLOCK):
            y[r] = b[i, r]
        for k in range(start[i], diagonal[i]):
            j = column[k]
            for r in range(BLOCK):
                s = 0.0
                for c in range(BLOCK):
                    s += lower[k, r, c] * out[j, c]
                y[r] -= s
        for r in range(BLOCK):
            s = 0.0
            for c in range(r + 1):
                s += inverse[i, r, c] * y[c]
            out[i, r] = s
    for i in range(n - 1, -1, -1):
        for r in range(BLOCK):
            s = 0.0
            for c in range(r, BLOCK):
                s += inverse[i, c, r] * out[i, c]
            y[r] = s
        for r in range(BLOCK):
            out[i, r] = y[r]
        for k in range(start[i], diagonal[i]):
            j = column[k]
            for c in range(BLOCK):
                s = 0.0
                for r in range(BLOCK):
                    s += lower[k, r, c] * y[r]
                out[j, c] -= s
