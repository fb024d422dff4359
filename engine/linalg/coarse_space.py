"""A coarse space over patches of rows, for what a local preconditioner is slow to see.

Every patch has nine coarse unknowns: the displacement of its body and the change of that along the patch's two longest
directions. With P what the unknowns of rows do then, the correction P (P^T A P)^-1 P^T is added to a local preconditioner.

Stiff woven cloth is stretched over hundreds of yarns within a step, and its layers slide on each other as a whole. For a
pull on the full `jeans-pocket` incomplete factors with patches of both layers together need 85 iterations, however small
the patches (4 to 16 yarns); with patches of one layer each, of 16 yarns, 19. Later Newton iterations, which bend: 140
iterations with patches of 24 yarns, 102 with 16, 79 with 12; `shirt-tag-stretch-h` 139 with 12, 84 with 8, and 59 with 6,
whose factor takes more memory than all else. A V-cycle of Gauss-Seidel over patches of 4 yarns needs
496 there.
"""

from typing import Any

import numpy as np
from numba import njit, prange
from scipy.sparse import bsr_array
from scipy.sparse.linalg import splu

from engine.arrays import Floats, Ints, Singles
from engine.linalg.block_matrix import BLOCK, CONTRACT, BlockMatrix
from engine.linalg.conjugate_gradient import Preconditioner
from engine.linalg.patches import MODES, form_patches

AXES = 3
SIZE = AXES * MODES
MOST_PATCHES = 6000  # a factor of P^T A P is cheap up to there
FLAT = 1e-9  # of the largest diagonal: an unknown below it does not exist, as the breadth of a line
RIDGE = 1e-6  # of the diagonal is added: where most of a patch is held, its modes depend on each other


class CoarseSpace:
    """The patches of a matrix, each of the displacement of one body."""

    def __init__(self, matrix: BlockMatrix, place: Floats, bodies: Ints, response: Singles, edge: float):
        """Form patches of rows at `place` [n, 3] in cubes of `edge` [m], or larger ones where these would be too many.

        A row belongs to one or two `bodies` [n, 2], -1 for none; `response` [n, 2, 5, 3] is how its unknowns follow their
        displacements.
        """
        self.matrix, self.response = matrix, response
        p = self.patches = form_patches(place, bodies, edge, MOST_PATCHES, matrix.start, matrix.column)
        # row, response and modes of the members, patch by patch: every iteration goes through them in that order
        self.row, slot = np.divmod(p.members, 2)
        self.factor: Any = None  # SuperLU's, of P^T A P
        self.members_response, self.members_mode = response[self.row, slot], p.mode[self.row, slot]

    def refresh(self) -> bool:
        """Factorise P^T A P for the present values of the matrix; false where it is singular.

        Where it is indefinite, conjugate gradients find that out.
        """
        a, p = self.matrix, self.patches
        block = np.zeros((len(p.column), SIZE, SIZE))
        _coarse_matrix(a.start, a.column, a.block, p.of, p.mode, self.response, p.members, p.start, p.first, p.column, block)
        coarse = bsr_array((block, p.column, p.first)).tocsr().T  # by columns, for nothing: it is symmetric
        diagonal = coarse.diagonal()
        absent = diagonal <= FLAT * diagonal.max()
        coarse.setdiag(np.where(absent, diagonal.max(), (1.0 + RIDGE) * diagonal))
        self.factor = None  # two of them are the most memory that a step takes
        try:
            self.factor = splu(coarse, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        except RuntimeError:  # exactly singular
            return False
        return True

    def add_correction(self, b: Floats, out: Floats) -> None:
        """Add P (P^T A P)^-1 P^T b to out, both [n, 5]."""
        p = self.patches
        coarse = np.empty((p.count, SIZE))
        _restrict(self.row, p.start, self.members_mode, self.members_response, b, coarse)
        _prolong(p.of, p.mode, self.response, self.factor.solve(coarse.ravel()).reshape(coarse.shape), out)


class TwoLevels:
    """A local preconditioner and a coarse space, added."""

    def __init__(self, local: Preconditioner, coarse: CoarseSpace):
        self.local, self.coarse = local, coarse

    def solve(self, b: Floats, out: Floats) -> None:
        """Write the sum of both corrections of b into out, both [n, 5]."""
        self.local.solve(b, out)
        self.coarse.add_correction(b, out)


@njit(cache=True, parallel=True, fastmath=CONTRACT)
def _coarse_matrix(start, column, block, of, mode, response, members, patch_start, first, neighbour, coarse):
    for p in prange(len(patch_start) - 1):
        half, whole = np.empty((AXES, BLOCK)), np.empty((AXES, AXES))
        of_row = np.empty((AXES, SIZE))  # what a row adds to the patch's own block, before its own modes
        own = np.zeros((SIZE, SIZE))
        for a in range(patch_start[p], patch_start[p + 1]):
            i, s = members[a] // 2, members[a] % 2
            of_row[:] = 0.0
            for k in range(start[i], start[i + 1]):
                j = column[k]
                if j > i and of[j, 0] == p and of[j, 1] < 0:  # most are: their transposes come from row j
                    continue
                for r in range(AXES):
                    for c in range(BLOCK):
                        half[r, c] = 0.0
                        for t in range(BLOCK):
                            half[r, c] += response[i, s, t, r] * block[k, t, c]
                for s_j in range(2):
                    q = of[j, s_j]
                    if q < 0 or (q == p and j > i):
                        continue
                    _product(half, response[j, s_j], whole)
                    if q == p:
                        share = 0.5 if j == i else 1.0
                        for n in range(MODES):
                            _add(share * mode[j, s_j, n], whole, 0, n, of_row)
                    else:
                        e = first[p] + np.searchsorted(neighbour[first[p] : first[p + 1]], q)
                        for m in range(MODES):
                            for n in range(MODES):
                                _add(mode[i, s, m] * mode[j, s_j, n], whole, m, n, coarse[e])
            for m in range(MODES):
                for r in range(AXES):
                    for c in range(SIZE):
                        own[AXES * m + r, c] += mode[i, s, m] * of_row[r, c]
        e = first[p] + np.searchsorted(neighbour[first[p] : first[p + 1]], p)
        for r in range(SIZE):
            for c in range(SIZE):
                coarse[e, r, c] = own[r, c] + own[c, r]


@njit(cache=True, fastmath=CONTRACT)
def _product(half, response, whole):
    for r in range(AXES):
        for c in range(AXES):
            whole[r, c] = 0.0
            for t in range(BLOCK):
                whole[r, c] += half[r, t] * response[t, c]


@njit(cache=True, fastmath=CONTRACT)
def _add(factor, whole, m, n, coarse):
    """Add what modes m and n have of a product to the block of their patches."""
    for r in range(AXES):
        for c in range(AXES):
            coarse[AXES * m + r, AXES * n + c] += factor * whole[r, c]


@njit(cache=True, parallel=True, fastmath=CONTRACT)
def _restrict(row, patch_start, mode, response, b, coarse):
    for p in prange(len(patch_start) - 1):  # by hand for three modes of three axes: the nine sums stay in registers
        s00 = s01 = s02 = s10 = s11 = s12 = s20 = s21 = s22 = 0.0
        for a in range(patch_start[p], patch_start[p + 1]):
            i, free = row[a], response[a]
            b0, b1, b2, b3, b4 = b[i, 0], b[i, 1], b[i, 2], b[i, 3], b[i, 4]
            v0 = free[0, 0] * b0 + free[1, 0] * b1 + free[2, 0] * b2 + free[3, 0] * b3 + free[4, 0] * b4
            v1 = free[0, 1] * b0 + free[1, 1] * b1 + free[2, 1] * b2 + free[3, 1] * b3 + free[4, 1] * b4
            v2 = free[0, 2] * b0 + free[1, 2] * b1 + free[2, 2] * b2 + free[3, 2] * b3 + free[4, 2] * b4
            m0, m1, m2 = mode[a, 0], mode[a, 1], mode[a, 2]
            s00, s01, s02 = s00 + m0 * v0, s01 + m0 * v1, s02 + m0 * v2
            s10, s11, s12 = s10 + m1 * v0, s11 + m1 * v1, s12 + m1 * v2
            s20, s21, s22 = s20 + m2 * v0, s21 + m2 * v1, s22 + m2 * v2
        coarse[p, 0], coarse[p, 1], coarse[p, 2] = s00, s01, s02
        coarse[p, 3], coarse[p, 4], coarse[p, 5] = s10, s11, s12
        coarse[p, 6], coarse[p, 7], coarse[p, 8] = s20, s21, s22


@njit(cache=True, parallel=True)
def _prolong(of, mode, response, coarse, out):
    for i in prange(len(of)):
        for s in range(2):
            if of[i, s] >= 0:
                move = coarse[of[i, s]]
                for c in range(AXES):
                    value = mode[i, s, 0] * move[c] + mode[i, s, 1] * move[AXES + c] + mode[i, s, 2] * move[2 * AXES + c]
                    for t in range(BLOCK):
                        out[i, t] += response[i, s, t, c] * value
