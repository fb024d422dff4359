"""Block incomplete Cholesky factors without fill, in the strips of a matrix, as a preconditioner."""

from dataclasses import dataclass

import numpy as np
from numba import njit, prange

from engine.arrays import Floats, Ints
from engine.linalg.block_matrix import BLOCK, CONTRACT, BlockMatrix

FIRST_SHIFT = 4e-3
LARGEST_SHIFT = 1.0
LEAST_PIVOT = 10.0  # round-offs of the original diagonal: less is none of a pivot that was positive


@dataclass
class IncompleteCholesky:
    """L with A ~ L L^T on the lower pattern of A; the diagonal blocks are stored as their inverses.

    The blocks of row i left of the diagonal are lower[start[i]] ... lower[start[i+1]-1], in the order of A's columns.
    """

    matrix: BlockMatrix  # A, whose pattern this shares
    start: Ints  # shape [n+1]
    lower: Floats  # shape [m, 5, 5]
    inverse: Floats  # inverses of the diagonal blocks, shape [n, 5, 5]
    shift: float = 0.0

    def solve(self, b: Floats, out: Floats) -> None:
        """Write (L L^T)^-1 b into out, both [n, 5]."""
        a = self.matrix
        _solve(a.strips.start, a.strips.reds, a.start, a.column, self.start, self.lower, self.inverse, b, out)


def incomplete_cholesky(a: BlockMatrix) -> IncompleteCholesky:
    """Return room for the factor of a matrix, for `factorise` to fill."""
    start = np.concatenate([[0], np.cumsum(a.diagonal - a.start[:-1])])
    lower = np.empty((int(start[-1]), BLOCK, BLOCK), a.block.dtype)
    return IncompleteCholesky(a, start, lower, np.empty((a.rows, BLOCK, BLOCK), a.block.dtype))


def factorise(factor: IncompleteCholesky, stronger: bool = False) -> bool:
    """Factorise the present values of the factor's matrix; false where it is too far from positive definite.

    Dropping fill can lose positive definiteness; the factorisation is then repeated for A + shift diag(A) with a
    growing shift, from a quarter of the last that was needed. `stronger` begins with a larger shift than the last, for a
    factor that proved useless.
    """
    a = factor.matrix
    factor.shift = next_shift(factor.shift) if stronger else smaller_shift(factor.shift)
    least = a.block.dtype.type(LEAST_PIVOT * np.finfo(a.block.dtype).eps)
    failed = np.zeros(len(a.strips.start) - 1, np.bool_)
    while True:
        _factorise(a.strips.start, a.strips.reds, a.start, a.column, a.diagonal, a.block, a.block.dtype.type(factor.shift),
                   least, factor.start, factor.lower, factor.inverse, failed)
        if not failed.any():
            return True
        factor.shift = next_shift(factor.shift)
        if factor.shift > LARGEST_SHIFT:
            factor.shift = 0.0  # says nothing about the next matrix
            return False


def next_shift(shift: float) -> float:
    """Return the shift to try where `shift` was not enough."""
    return max(FIRST_SHIFT, 2.0 * shift)


def smaller_shift(shift: float) -> float:
    """Return the shift to begin with where the last matrix needed `shift`."""
    return 0.25 * shift if shift >= 4.0 * FIRST_SHIFT else 0.0


@njit(cache=True, parallel=True)
def _factorise(strip, reds, start, column, diagonal, block, shift, least, lower_start, lower, inverse, failed):
    for first, end in ((0, reds), (reds, len(strip) - 1)):
        for s in prange(first, end):
            failed[s] = not _factorise_rows(
                strip[s], strip[s + 1], start, column, diagonal, block, shift, least, lower_start, lower, inverse)


@njit(cache=True, fastmath=CONTRACT)
def _factorise_rows(first, last, start, column, diagonal, block, shift, least, lower_start, lower, inverse):
    pivot = np.empty((BLOCK, BLOCK), block.dtype)
    for i in range(first, last):
        d = diagonal[i]
        for r in range(BLOCK):
            for c in range(BLOCK):
                pivot[r, c] = block[d, r, c]
            pivot[r, r] += shift * block[d, r, r]
        left = lower_start[i]
        for k in range(start[i], d):
            j, here = column[k], lower[left + k - start[i]]
            for r in range(BLOCK):  # entry by entry: for arrays at once numba compiles the text of an error, for seconds
                for c in range(BLOCK):
                    here[r, c] = block[k, r, c]
            # what rows i and j have in common left of column j
            a, b = start[i], start[j]
            while a < k and b < diagonal[j]:
                if column[a] < column[b]:
                    a += 1
                elif column[a] > column[b]:
                    b += 1
                else:
                    _subtract(lower[left + a - start[i]], lower[lower_start[j] + b - start[j]], here)
                    a += 1
                    b += 1
            inv = inverse[j]
            for r in range(BLOCK):  # L_ij = (...) L_jj^-T, in place from the last column
                for c in range(BLOCK - 1, -1, -1):
                    s = here[r, c] * inv[c, c]
                    for t in range(c):
                        s += here[r, t] * inv[c, t]
                    here[r, c] = s
            _subtract(here, here, pivot)
        if not _inverse_factor(pivot, block[d], least, inverse[i]):
            return False
    return True


@njit(cache=True, fastmath=CONTRACT)
def _subtract(a, b, out):
    """out -= a b^T."""
    for r in range(BLOCK):
        a0, a1, a2, a3, a4 = a[r, 0], a[r, 1], a[r, 2], a[r, 3], a[r, 4]
        for c in range(BLOCK):
            out[r, c] -= a0 * b[c, 0] + a1 * b[c, 1] + a2 * b[c, 2] + a3 * b[c, 3] + a4 * b[c, 4]


@njit(cache=True, fastmath=CONTRACT)
def _inverse_factor(pivot, original, least, inverse):
    """Cholesky factor of a pivot block and its inverse; false if a pivot lost too much of the original diagonal."""
    for c in range(BLOCK):
        s = pivot[c, c]
        for t in range(c):
            s -= pivot[c, t] * pivot[c, t]
        if not s > least * original[c, c]:
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
            s = pivot[r, c] * inverse[c, c]
            for t in range(c + 1, r):
                s += pivot[r, t] * inverse[t, c]
            inverse[r, c] = -s / pivot[r, r]
    return True


@njit(cache=True, parallel=True)
def _solve(strip, reds, start, column, lower_start, lower, inverse, b, out):
    strips = len(strip) - 1
    for first, end in ((0, reds), (reds, strips)):
        for s in prange(first, end):
            _forward(strip[s], strip[s + 1], start, column, lower_start, lower, inverse, b, out)
    for first, end in ((reds, strips), (0, reds)):
        for s in prange(first, end):
            _backward(strip[s], strip[s + 1], start, column, lower_start, lower, inverse, out)


@njit(cache=True, fastmath=CONTRACT)
def _forward(first, last, start, column, lower_start, lower, inverse, b, out):
    for i in range(first, last):
        y0, y1, y2, y3, y4 = b[i, 0], b[i, 1], b[i, 2], b[i, 3], b[i, 4]
        for k in range(lower_start[i], lower_start[i + 1]):
            j, m = column[start[i] + k - lower_start[i]], lower[k]
            x0, x1, x2, x3, x4 = out[j, 0], out[j, 1], out[j, 2], out[j, 3], out[j, 4]
            y0 -= m[0, 0] * x0 + m[0, 1] * x1 + m[0, 2] * x2 + m[0, 3] * x3 + m[0, 4] * x4
            y1 -= m[1, 0] * x0 + m[1, 1] * x1 + m[1, 2] * x2 + m[1, 3] * x3 + m[1, 4] * x4
            y2 -= m[2, 0] * x0 + m[2, 1] * x1 + m[2, 2] * x2 + m[2, 3] * x3 + m[2, 4] * x4
            y3 -= m[3, 0] * x0 + m[3, 1] * x1 + m[3, 2] * x2 + m[3, 3] * x3 + m[3, 4] * x4
            y4 -= m[4, 0] * x0 + m[4, 1] * x1 + m[4, 2] * x2 + m[4, 3] * x3 + m[4, 4] * x4
        m = inverse[i]
        out[i, 0] = m[0, 0] * y0
        out[i, 1] = m[1, 0] * y0 + m[1, 1] * y1
        out[i, 2] = m[2, 0] * y0 + m[2, 1] * y1 + m[2, 2] * y2
        out[i, 3] = m[3, 0] * y0 + m[3, 1] * y1 + m[3, 2] * y2 + m[3, 3] * y3
        out[i, 4] = m[4, 0] * y0 + m[4, 1] * y1 + m[4, 2] * y2 + m[4, 3] * y3 + m[4, 4] * y4


@njit(cache=True, fastmath=CONTRACT)
def _backward(first, last, start, column, lower_start, lower, inverse, out):
    for i in range(last - 1, first - 1, -1):
        x0, x1, x2, x3, x4 = out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4]
        m = inverse[i]
        y0 = m[0, 0] * x0 + m[1, 0] * x1 + m[2, 0] * x2 + m[3, 0] * x3 + m[4, 0] * x4
        y1 = m[1, 1] * x1 + m[2, 1] * x2 + m[3, 1] * x3 + m[4, 1] * x4
        y2 = m[2, 2] * x2 + m[3, 2] * x3 + m[4, 2] * x4
        y3 = m[3, 3] * x3 + m[4, 3] * x4
        y4 = m[4, 4] * x4
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = y0, y1, y2, y3, y4
        # strictly backwards through memory, which processors foresee: the other way a row costs four times as much
        for k in range(lower_start[i + 1] - 1, lower_start[i] - 1, -1):
            j, m = column[start[i] + k - lower_start[i]], lower[k]
            out[j, 0] -= m[0, 0] * y0 + m[1, 0] * y1 + m[2, 0] * y2 + m[3, 0] * y3 + m[4, 0] * y4
            out[j, 1] -= m[0, 1] * y0 + m[1, 1] * y1 + m[2, 1] * y2 + m[3, 1] * y3 + m[4, 1] * y4
            out[j, 2] -= m[0, 2] * y0 + m[1, 2] * y1 + m[2, 2] * y2 + m[3, 2] * y3 + m[4, 2] * y4
            out[j, 3] -= m[0, 3] * y0 + m[1, 3] * y1 + m[2, 3] * y2 + m[3, 3] * y3 + m[4, 3] * y4
            out[j, 4] -= m[0, 4] * y0 + m[1, 4] * y1 + m[2, 4] * y2 + m[3, 4] * y3 + m[4, 4] * y4
