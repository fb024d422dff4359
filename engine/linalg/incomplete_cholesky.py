"""Block incomplete Cholesky factors without fill, in a chosen order of elimination, as a preconditioner."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints
from engine.linalg.block_matrix import BLOCK, BlockMatrix

FIRST_SHIFT = 1e-3
LARGEST_SHIFT = 1.0


@dataclass
class Elimination:
    """The lower pattern of a matrix under an order of elimination."""

    row: Ints  # the row that is eliminated at each position, shape [n]
    start: Ints  # blocks of position i are start[i] ... start[i+1]-1, shape [n+1]
    column: Ints  # position of each block's column, ascending in each row, shape [m]
    source: Ints  # where the block stands in the matrix, shape [m]


def elimination(a: BlockMatrix, row: Ints) -> Elimination:
    """Return the lower pattern of `a` when its rows are eliminated in the order `row`, a permutation [n]."""
    return Elimination(row, *_lower_pattern(a.start, a.column, row))


@dataclass
class IncompleteCholesky:
    """L with A ~ L L^T on the lower pattern of A; the diagonal blocks are stored as their inverses."""

    order: Elimination
    lower: Floats  # blocks left of the diagonal, shape [m, 5, 5]
    inverse: Floats  # inverses of the diagonal blocks, shape [n, 5, 5]
    shift: float

    def solve(self, b: Floats, out: Floats) -> None:
        """Write (L L^T)^-1 b into out, both [n, 5]."""
        _solve(self.order.row, self.order.start, self.order.column, self.lower, self.inverse, b, out)


def factorise(a: BlockMatrix, order: Elimination) -> IncompleteCholesky | None:
    """Factorise a symmetric matrix on its own pattern; None where it is too far from positive definite.

    Dropping fill can lose positive definiteness; the factorisation is then repeated for A + shift diag(A) with a
    growing shift.
    """
    lower = np.empty((len(order.column), BLOCK, BLOCK))
    inverse = np.empty((a.rows, BLOCK, BLOCK))
    shift = 0.0
    position = np.full(a.rows, -1, np.int64)
    while not _factorise(order.row, order.start, order.column, order.source, a.diagonal, a.block, shift, lower, inverse,
                         position):
        shift = max(FIRST_SHIFT, 4.0 * shift)
        if shift > LARGEST_SHIFT:
            return None
    return IncompleteCholesky(order, lower, inverse, shift)


@njit(cache=True)
def _lower_pattern(start, column, row):
    n = len(row)
    place = np.empty(n, np.int64)
    for i in range(n):
        place[row[i]] = i
    lower_start = np.zeros(n + 1, np.int64)
    for i in range(n):
        count = 0
        for k in range(start[row[i]], start[row[i] + 1]):
            if place[column[k]] < i:
                count += 1
        lower_start[i + 1] = lower_start[i] + count
    lower_column = np.empty(lower_start[n], np.int64)
    source = np.empty(lower_start[n], np.int64)
    for i in range(n):
        first = lower_start[i]
        end = first
        for k in range(start[row[i]], start[row[i] + 1]):
            j = place[column[k]]
            if j < i:
                m = end
                while m > first and lower_column[m - 1] > j:
                    lower_column[m], source[m] = lower_column[m - 1], source[m - 1]
                    m -= 1
                lower_column[m], source[m] = j, k
                end += 1
    return lower_start, lower_column, source


@njit(cache=True)
def _factorise(row, start, column, source, diagonal, block, shift, lower, inverse, position):
    position[:] = -1
    pivot = np.empty((BLOCK, BLOCK))
    for i in range(len(row)):
        first, last = start[i], start[i + 1]
        d = diagonal[row[i]]
        for r in range(BLOCK):
            for c in range(BLOCK):
                pivot[r, c] = block[d, r, c]
            pivot[r, r] *= 1.0 + shift
        for k in range(first, last):
            position[column[k]] = k
        for k in range(first, last):
            j = column[k]
            lower[k] = block[source[k]]
            for m in range(start[j], start[j + 1]):
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
        if not _inverse_factor(pivot, block[d], inverse[i]):
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
def _solve(row, start, column, lower, inverse, b, out):
    n = len(row)
    y = np.empty(BLOCK)
    for i in range(n):
        for r in range(BLOCK):
            y[r] = b[row[i], r]
        for k in range(start[i], start[i + 1]):
            j = row[column[k]]
            for r in range(BLOCK):
                s = 0.0
                for c in range(BLOCK):
                    s += lower[k, r, c] * out[j, c]
                y[r] -= s
        for r in range(BLOCK):
            s = 0.0
            for c in range(r + 1):
                s += inverse[i, r, c] * y[c]
            out[row[i], r] = s
    for i in range(n - 1, -1, -1):
        for r in range(BLOCK):
            s = 0.0
            for c in range(r, BLOCK):
                s += inverse[i, c, r] * out[row[i], c]
            y[r] = s
        for r in range(BLOCK):
            out[row[i], r] = y[r]
        for k in range(start[i], start[i + 1]):
            j = row[column[k]]
            for c in range(BLOCK):
                s = 0.0
                for r in range(BLOCK):
                    s += lower[k, r, c] * y[r]
                out[j, c] -= s
