"""Block matrices written out in full, and their incomplete factors as a textbook has them."""

import numpy as np
from numpy.typing import DTypeLike

from engine.arrays import Floats, Ints
from engine.linalg.block_matrix import BLOCK, BlockMatrix, with_pattern
from engine.linalg.incomplete_cholesky import IncompleteCholesky, factorise, incomplete_cholesky


def dense(a: BlockMatrix) -> Floats:
    """Return the matrix in full, in the order of its rows, shape [5 n, 5 n]."""
    full = np.zeros((a.rows, BLOCK, a.rows, BLOCK))
    row = np.repeat(np.arange(a.rows), np.diff(a.start))
    full[row, :, a.column] = a.block
    return full.reshape(a.rows * BLOCK, -1)


def blocked(full: Floats, pairs, dtype: DTypeLike = np.float64) -> tuple[BlockMatrix, Ints]:
    """Return the blocks of a full matrix that the diagonal and `pairs` name, and the new number of every row."""
    rows = len(full) // BLOCK
    a, number = with_pattern(rows, np.array(pairs, np.int64).reshape(-1, 2), dtype)
    old = np.argsort(number)
    row = np.repeat(np.arange(rows), np.diff(a.start))
    a.block[:] = full.reshape(rows, BLOCK, rows, BLOCK)[old[row], :, old[a.column]]
    return a, number


class Identity:
    """The preconditioner that does nothing."""

    def solve(self, b: Floats, out: Floats) -> None:
        """Copy b into out."""
        out[:] = b


def factors(a: BlockMatrix) -> IncompleteCholesky | None:
    """Return the incomplete factors of `a`, None where there are none."""
    factor = incomplete_cholesky(a)
    return factor if factorise(factor) else None


def reference_factor(a: BlockMatrix) -> list[dict[int, Floats]]:
    """Return L with a ~ L L^T, row after row: the blocks of each row by their columns, those of `a` only."""
    factor: list[dict[int, Floats]] = []
    for i in range(a.rows):
        factor.append({})
        for k in range(a.start[i], a.start[i + 1]):
            j = int(a.column[k])
            if j <= i:
                common = factor[i].keys() & factor[j].keys()
                rest = a.block[k] - sum(factor[i][c] @ factor[j][c].T for c in common)
                factor[i][j] = np.linalg.cholesky(rest) if i == j else np.linalg.solve(factor[j][j], rest.T).T
    return factor


def reference_solve(factor: list[dict[int, Floats]], b: Floats) -> Floats:
    """Return (L L^T)^-1 b, shape [n, 5], row after row."""
    x = b.copy()
    for i, row in enumerate(factor):
        x[i] = np.linalg.solve(row[i], x[i] - sum(block @ x[j] for j, block in row.items() if j < i))
    for i in reversed(range(len(factor))):
        x[i] = np.linalg.solve(factor[i][i].T, x[i])
        for j, block in factor[i].items():
            if j < i:
                x[j] -= block.T @ x[i]
    return x


def chain(rows: int) -> list[tuple[int, int]]:
    """Return the pairs of a block tridiagonal matrix."""
    return [(i, i + 1) for i in range(rows - 1)]


def grid(wide: int, long: int, first: int = 0) -> list[tuple[int, int]]:
    """Return the pairs of a grid of rows, `wide` next to each other, that are numbered from `first`."""
    at = first + np.arange(wide * long).reshape(long, wide)
    return [*zip(at[:, :-1].flat, at[:, 1:].flat, strict=True), *zip(at[:-1].flat, at[1:].flat, strict=True)]


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
