"""Sparse symmetric matrices of dense 5 x 5 blocks, in compressed rows.

One block row holds the five unknowns of one point. The pattern is built once per discretisation and refilled at every
Newton iteration; an unknown that takes no part is kept as an identity row (Sánchez-Banderas 2020, sec. 4.3). Rows stand in
strips (`engine.linalg.strips`), so that what works on rows can do so in parallel.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import DTypeLike

from engine.arrays import Floats, Ints
from engine.linalg.strips import Strips, permuted, strips_of

BLOCK = 5
CHUNK = 512  # rows that are one piece of work
CONTRACT = {"contract"}  # products are added without being rounded: a quarter faster, and the order of sums stays


@dataclass
class BlockMatrix:
    """A square matrix of `n` block rows; columns ascend within each row and include the diagonal."""

    start: Ints  # blocks of row i are start[i] ... start[i+1]-1, shape [n+1]
    column: Ints  # block column of each block, shape [nnz]
    diagonal: Ints  # position of each row's diagonal block, shape [n]
    block: Floats  # values, single or double precision, shape [nnz, 5, 5]
    strips: Strips  # of rows

    @property
    def rows(self) -> int:
        """Number of block rows."""
        return len(self.diagonal)

    def multiply(self, x: Floats, out: Floats) -> None:
        """Write the product with x [n, 5] into out [n, 5]."""
        multiply(self.start, self.column, self.block, x, out)


def with_pattern(rows: int, pairs: Ints, dtype: DTypeLike = np.float64) -> tuple[BlockMatrix, Ints]:
    """Return a zero matrix with the diagonal and both blocks of every pair in `pairs` [m, 2] (repeats allowed).

    Its rows are renumbered to stand in strips; the second result is the new number of every row, shape [rows].
    """
    start, column = _pattern(rows, pairs)
    order, strips = strips_of(start, column)
    number = np.empty(rows, np.int64)
    number[order] = np.arange(rows)
    start, column, diagonal = permuted(start, column, order, number)
    return BlockMatrix(start, column, diagonal, np.zeros((len(column), BLOCK, BLOCK), dtype), strips), number


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
    end = 0
    unique_start = np.zeros(rows + 1, np.int64)
    for i in range(rows):
        first = end
        for k in range(start[i], start[i + 1]):  # insertion of what is new; rows are short
            value = column[k]
            at = end
            while at > first and column[at - 1] > value:
                at -= 1
            if at > first and column[at - 1] == value:
                continue
            for m in range(end, at, -1):
                column[m] = column[m - 1]
            column[at] = value
            end += 1
        unique_start[i + 1] = end
    return unique_start, column[:end].copy()


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


@njit(cache=True, parallel=True, fastmath=CONTRACT)
def multiply(start, column, block, x, out):
    """Matrix-vector product, row after row."""
    rows = len(out)
    for chunk in prange((rows + CHUNK - 1) // CHUNK):
        for i in range(chunk * CHUNK, min((chunk + 1) * CHUNK, rows)):
            s0 = s1 = s2 = s3 = s4 = 0.0
            for k in range(start[i], start[i + 1]):
                j, b = column[k], block[k]
                x0, x1, x2, x3, x4 = x[j, 0], x[j, 1], x[j, 2], x[j, 3], x[j, 4]
                s0 += b[0, 0] * x0 + b[0, 1] * x1 + b[0, 2] * x2 + b[0, 3] * x3 + b[0, 4] * x4
                s1 += b[1, 0] * x0 + b[1, 1] * x1 + b[1, 2] * x2 + b[1, 3] * x3 + b[1, 4] * x4
                s2 += b[2, 0] * x0 + b[2, 1] * x1 + b[2, 2] * x2 + b[2, 3] * x3 + b[2, 4] * x4
                s3 += b[3, 0] * x0 + b[3, 1] * x1 + b[3, 2] * x2 + b[3, 3] * x3 + b[3, 4] * x4
                s4 += b[4, 0] * x0 + b[4, 1] * x1 + b[4, 2] * x2 + b[4, 3] * x3 + b[4, 4] * x4
            out[i, 0] = s0
            out[i, 1] = s1
            out[i, 2] = s2
            out[i, 3] = s3
            out[i, 4] = s4
