"""Sparse symmetric matrices of dense 5 x 5 blocks, in compressed rows.

One block row holds the five unknowns of one point. The pattern is built once per discretisation and refilled at every
Newton iteration; an unknown that takes no part is kept as an identity row, so nothing is ever resized
(Sánchez-Banderas 2020, sec. 4.3).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints

BLOCK = 5


@dataclass
class BlockMatrix:
    """A square matrix of `n` block rows; columns ascend within each row and include the diagonal."""

    start: Ints  # blocks of row i are start[i] ... start[i+1]-1, shape [n+1]
    column: Ints  # block column of each block, shape [nnz]
    diagonal: Ints  # position of each row's diagonal block, shape [n]
    block: Floats  # values, shape [nnz, 5, 5]

    @property
    def rows(self) -> int:
        """Number of block rows."""
        return len(self.diagonal)

    def multiply(self, x: Floats, out: Floats) -> None:
        """Write the product with x [n, 5] into out [n, 5]."""
        multiply(self.start, self.column, self.block, x, out)


def with_pattern(rows: int, pairs: Ints) -> BlockMatrix:
    """Return a zero matrix with the diagonal and both blocks of every pair in `pairs` [m, 2] (repeats allowed)."""
    start, column, diagonal = _pattern(rows, pairs)
    return BlockMatrix(start, column, diagonal, np.zeros((len(column), BLOCK, BLOCK)))


@njit(cache=True)
def _pattern(rows, pairs):
    count = np.ones(rows + 1, np.int64)
    count[0] = 0
    for e in range(len(pairs)):
        count[pairs[e, 0] + 1] += 1
        count[pairs[e, 1] + 1] += 1
    start = np.cumsum(count)
    filled = start[:-1].copy()
    column = np.empty(start[rows], np.int64)
    for i in range(rows):
        column[filled[i]] = i
        filled[i] += 1
    for e in range(len(pairs)):
        i, j = pairs[e, 0], pairs[e, 1]
        column[filled[i]] = j
        filled[i] += 1
        column[filled[j]] = i
        filled[j] += 1
    unique = np.empty_like(column)
    unique_start = np.zeros(rows + 1, np.int64)
    diagonal = np.empty(rows, np.int64)
    k = 0
    for i in range(rows):
        row = column[start[i] : start[i + 1]]
        for a in range(1, len(row)):
            value = row[a]
            b = a - 1
            while b >= 0 and row[b] > value:
                row[b + 1] = row[b]
                b -= 1
            row[b + 1] = value
        for a in range(len(row)):
            if a == 0 or row[a] != row[a - 1]:
                if row[a] == i:
                    diagonal[i] = k
                unique[k] = row[a]
                k += 1
        unique_start[i + 1] = k
    return unique_start, unique[:k].copy(), diagonal


@njit(cache=True, inline="never")
def locate(start, column, i, j):
    """Return the position of block (i, j), which must be in the pattern."""
    low, high = start[i], start[i + 1]
    while high - low > 1:
        middle = (low + high) // 2
        if column[middle] <= j:
            low = middle
        else:
            high = middle
    return low


@njit(cache=True)
def multiply(start, column, block, x, out):
    """Matrix-vector product, row after row."""
    for i in range(len(out)):
        s0 = s1 = s2 = s3 = s4 = 0.0
        for k in range(start[i], start[i + 1]):
            j = column[k]
            x0, x1, x2, x3, x4 = x[j, 0], x[j, 1], x[j, 2], x[j, 3], x[j, 4]
            s0 += block[k, 0, 0] * x0 + block[k, 0, 1] * x1 + block[k, 0, 2] * x2 + block[k, 0, 3] * x3 + block[k, 0, 4] * x4
            s1 += block[k, 1, 0] * x0 + block[k, 1, 1] * x1 + block[k, 1, 2] * x2 + block[k, 1, 3] * x3 + block[k, 1, 4] * x4
            s2 += block[k, 2, 0] * x0 + block[k, 2, 1] * x1 + block[k, 2, 2] * x2 + block[k, 2, 3] * x3 + block[k, 2, 4] * x4
            s3 += block[k, 3, 0] * x0 + block[k, 3, 1] * x1 + block[k, 3, 2] * x2 + block[k, 3, 3] * x3 + block[k, 3, 4] * x4
            s4 += block[k, 4, 0] * x0 + block[k, 4, 1] * x1 + block[k, 4, 2] * x2 + block[k, 4, 3] * x3 + block[k, 4, 4] * x4
        out[i, 0] = s0
        out[i, 1] = s1
        out[i, 2] = s2
        out[i, 3] = s3
        out[i, 4] = s4
