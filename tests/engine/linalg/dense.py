"""Block matrices written out in full."""

import numpy as np

from engine.arrays import Floats
from engine.linalg.block_matrix import BLOCK, BlockMatrix, with_pattern
from engine.linalg.incomplete_cholesky import IncompleteCholesky, elimination, factorise


def dense(a: BlockMatrix) -> Floats:
    """Return the matrix in full, shape [5 n, 5 n]."""
    full = np.zeros((a.rows, BLOCK, a.rows, BLOCK))
    row = np.repeat(np.arange(a.rows), np.diff(a.start))
    full[row, :, a.column] = a.block
    return full.reshape(a.rows * BLOCK, -1)


def blocked(full: Floats, pairs) -> BlockMatrix:
    """Return the blocks of a full matrix that the diagonal and `pairs` name."""
    rows = len(full) // BLOCK
    a = with_pattern(rows, np.array(pairs, np.int64).reshape(-1, 2))
    row = np.repeat(np.arange(rows), np.diff(a.start))
    a.block[:] = full.reshape(rows, BLOCK, rows, BLOCK)[row, :, a.column]
    return a


def factors(a: BlockMatrix, order=None) -> IncompleteCholesky | None:
    """Return the incomplete factors of `a`, row after row where no `order` of elimination is given."""
    rows = np.arange(a.rows) if order is None else np.array(order, np.int64)
    return factorise(a, elimination(a, rows))


def chain(rows: int) -> list[tuple[int, int]]:
    """Return the pairs of a block tridiagonal matrix."""
    return [(i, i + 1) for i in range(rows - 1)]


def positive(rng: np.random.Generator, rows: int, pairs) -> Floats:
    """Return a random symmetric positive definite matrix with non-zero blocks on the diagonal and `pairs` only.

    Each pair adds the square of a random factor of both its rows, as every energy of a segment does.
    """
    full = np.kron(np.eye(rows), np.eye(BLOCK))
    for pair in pairs:
        at = (BLOCK * np.array(pair)[:, None] + np.arange(BLOCK)).ravel()
        factor = rng.normal(size=(BLOCK, len(at)))
        full[np.ix_(at, at)] += factor.T @ factor
    return full
