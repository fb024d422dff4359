"""A coarse space over patches of rows, for what a local preconditioner is slow to see.

Rows that stand near each other in space form a patch, and every patch has nine coarse unknowns: its translation and the
change of that along its two longest directions. With P their values at the rows, the correction P (P^T A P)^-1 P^T is added
to a local preconditioner. Stiff woven cloth is stretched over hundreds of yarns within a step; incomplete factors alone need
270 iterations there, with patches of 4 yarns 34, of 8 yarns 66, of 12 yarns 92, and translations alone would need 115.
"""

from itertools import pairwise

import numpy as np
from numba import njit, prange
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from engine.arrays import Floats, Ints
from engine.linalg.block_matrix import BlockMatrix
from engine.linalg.conjugate_gradient import Preconditioner

AXES = 3  # of the unknowns of a row, the first three are its place
MODES = 3  # scalar modes of a patch: constant, and linear in two directions
SIZE = AXES * MODES
MOST_PATCHES = 1500  # a factor of P^T A P is cheap up to there
FLAT = 1e-9  # of the largest diagonal: an unknown below it does not exist, as the breadth of a line
RIDGE = 1e-6  # of the diagonal is added: where most of a patch is held, its modes depend on each other


class CoarseSpace:
    """Two levels of preconditioning: a local one, and the patches of a matrix."""

    def __init__(self, matrix: BlockMatrix, place: Floats, free: Floats, edge: float):
        """Form patches of rows at `place` [n, 3] in cubes of `edge` [m], or larger ones where these would be too many.

        `free` [n, 3, 3] are the projectors on the directions in which rows may move.
        """
        self.matrix, self.free = matrix, np.ascontiguousarray(free)
        patch = _patches(place, edge)
        while patch.max() >= MOST_PATCHES:
            edge *= 1.25
            patch = _patches(place, edge)
        self.patch, self.count = patch, int(patch.max()) + 1
        self.rows = np.argsort(patch, kind="stable")  # by patches
        self.start = np.searchsorted(patch[self.rows], np.arange(self.count + 1)).astype(np.int64)
        self.mode = _modes(place, self.rows, self.start, edge)
        self.pair_start, self.pair_column = _neighbours(matrix.start, matrix.column, patch, self.rows, self.start, self.count)

    def refresh(self) -> bool:
        """Factorise P^T A P for the present values of the matrix; false where it is not positive definite."""
        a = self.matrix
        block = np.zeros((len(self.pair_column), SIZE, SIZE))
        _coarse_matrix(a.start, a.column, a.block, self.patch, self.mode, self.free, self.rows, self.start, self.pair_start,
                       self.pair_column, block)
        patch = np.repeat(np.arange(self.count), np.diff(self.pair_start))
        within = np.arange(SIZE)
        row = np.broadcast_to(SIZE * patch[:, None, None] + within[:, None], block.shape)
        column = np.broadcast_to(SIZE * self.pair_column[:, None, None] + within, block.shape)
        coarse = csc_array((block.ravel(), (row.ravel(), column.ravel())))
        diagonal = coarse.diagonal()
        absent = diagonal <= FLAT * diagonal.max()
        coarse.setdiag(np.where(absent, diagonal.max(), (1.0 + RIDGE) * diagonal))
        self.factor = splu(coarse, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        return bool(self.factor.U.diagonal().min() > 0.0)

    def add_correction(self, b: Floats, out: Floats) -> None:
        """Add P (P^T A P)^-1 P^T b to out, both [n, 5]."""
        coarse = np.empty((self.count, MODES, AXES))
        _restrict(self.rows, self.start, self.mode, self.free, b, coarse)
        _prolong(self.patch, self.mode, self.free, self.factor.solve(coarse.ravel()).reshape(coarse.shape), out)


class TwoLevels:
    """A local preconditioner and a coarse space, added."""

    def __init__(self, local: Preconditioner, coarse: CoarseSpace):
        self.local, self.coarse = local, coarse

    def solve(self, b: Floats, out: Floats) -> None:
        """Write the sum of both corrections of b into out, both [n, 5]."""
        self.local.solve(b, out)
        self.coarse.add_correction(b, out)


def _patches(place: Floats, edge: float) -> Ints:
    """Number of the cube of each place, in an order of its own, shape [n]."""
    cube = np.floor((place - place.min(axis=0)) / edge).astype(np.int64)
    sides = cube.max(axis=0) + 1
    return np.unique((cube[:, 0] * sides[1] + cube[:, 1]) * sides[2] + cube[:, 2], return_inverse=True)[1].astype(np.int64)


def _modes(place: Floats, rows: Ints, start: Ints, edge: float) -> Floats:
    """Values of the scalar modes at every row, shape [n, 3]: one, and two coordinates about the patch's middle."""
    mode = np.ones((len(place), MODES))
    for first, last in pairwise(start):
        inside = rows[first:last]
        away = (place[inside] - place[inside].mean(axis=0)) / edge
        _, directions = np.linalg.eigh(away.T @ away)
        mode[inside, 1:] = away @ directions[:, :0:-1]
    return mode


@njit(cache=True)
def _neighbours(start, column, patch, rows, patch_start, count):
    """Patches that the rows of each patch are coupled to, ascending, in compressed rows."""
    seen = np.full(count, -1, np.int64)
    pair_start = np.zeros(count + 1, np.int64)
    pair_column = np.empty(64 * count + 64, np.int64)
    end = 0
    for p in range(count):
        first = end
        for a in range(patch_start[p], patch_start[p + 1]):
            for k in range(start[rows[a]], start[rows[a] + 1]):
                q = patch[column[k]]
                if seen[q] != p:
                    seen[q] = p
                    if end == len(pair_column):
                        grown = np.empty(2 * end, np.int64)
                        grown[:end] = pair_column
                        pair_column = grown
                    pair_column[end] = q
                    end += 1
        pair_column[first:end].sort()
        pair_start[p + 1] = end
    return pair_start, pair_column[:end].copy()


@njit(cache=True, parallel=True)
def _coarse_matrix(start, column, block, patch, mode, free, rows, patch_start, pair_start, pair_column, coarse):
    for p in prange(len(patch_start) - 1):
        half, whole = np.empty((AXES, AXES)), np.empty((AXES, AXES))
        for a in range(patch_start[p], patch_start[p + 1]):
            i = rows[a]
            for k in range(start[i], start[i + 1]):
                j = column[k]
                _product(free[i], block[k], half)
                _product(half, free[j], whole)
                e = pair_start[p] + np.searchsorted(pair_column[pair_start[p] : pair_start[p + 1]], patch[j])
                for m in range(MODES):
                    for n in range(MODES):
                        weight = mode[i, m] * mode[j, n]
                        for r in range(AXES):
                            for c in range(AXES):
                                coarse[e, AXES * m + r, AXES * n + c] += weight * whole[r, c]


@njit(cache=True)
def _product(a, b, out):
    for r in range(AXES):
        for c in range(AXES):
            out[r, c] = a[r, 0] * b[0, c] + a[r, 1] * b[1, c] + a[r, 2] * b[2, c]


@njit(cache=True, parallel=True)
def _restrict(rows, patch_start, mode, free, b, coarse):
    for p in prange(len(patch_start) - 1):
        coarse[p] = 0.0
        for a in range(patch_start[p], patch_start[p + 1]):
            i = rows[a]
            for r in range(AXES):
                value = free[i, r, 0] * b[i, 0] + free[i, r, 1] * b[i, 1] + free[i, r, 2] * b[i, 2]
                for m in range(MODES):
                    coarse[p, m, r] += mode[i, m] * value


@njit(cache=True, parallel=True)
def _prolong(patch, mode, free, coarse, out):
    for i in prange(len(patch)):
        move = coarse[patch[i]]
        for r in range(AXES):
            value = 0.0
            for c in range(AXES):
                value += free[i, r, c] * (mode[i, 0] * move[0, c] + mode[i, 1] * move[1, c] + mode[i, 2] * move[2, c])
            out[i, r] += value
