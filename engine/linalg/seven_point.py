"""Seven-point systems on a list of cells of a sparse grid, as flow between a cell and the six beside it gives.

Row i of the matrix takes diagonal_i p_i and subtracts coupling_ij p_j for the cells j beside cell i. What its diagonal has
beyond its couplings is its excess: conductance to where p is given, and what compresses. It is never negative, so that the
matrix is positive definite, or has the constants of components without excess as its null space.

Couplings are kept once for each pair of cells: to read them twice, from six a cell, was not faster and takes half as much
memory again.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from engine.arrays import Floats
from engine.linalg.block_matrix import CHUNK

Indices = NDArray[np.int32]
ROUND_OFF = 1e-14  # of the diagonal: no more of an excess is one


class SevenPoint(NamedTuple):
    """A symmetric matrix on n cells, whose rows may stand in any order."""

    place: Indices  # coordinates of the cells, shape [n, 3]
    beside: Indices  # cell at -x, +x, -y, +y, -z, +z, -1 where there is none, shape [n, 6]
    coupling: Floats  # conductance to the cells at +x, +y, +z, not negative, 0 where there are none, shape [n, 3]
    diagonal: Floats  # couplings to all cells beside and excess, shape [n]

    def multiply(self, x: Floats, out: Floats) -> None:
        """Write the product with x [n] into out [n]."""
        _multiply(self.beside, self.coupling, self.diagonal, x, out)


@njit(cache=True)
def flow_in(i, beside, coupling, x):
    """Return what couplings take from the x [n] of cells beside cell i."""
    total = 0.0
    for a in range(3):
        j = beside[i, 2 * a]
        if j >= 0:
            total += coupling[j, a] * x[j]
        j = beside[i, 2 * a + 1]
        if j >= 0:
            total += coupling[i, a] * x[j]
    return total


@njit(cache=True)
def coupled(i, beside, coupling):
    """Return the sum of the couplings of cell i."""
    total = 0.0
    for a in range(3):
        if beside[i, 2 * a] >= 0:
            total += coupling[beside[i, 2 * a], a]
        total += coupling[i, a]
    return total


@njit(cache=True, parallel=True)
def _multiply(beside, coupling, diagonal, x, out):
    rows = len(x)
    for chunk in prange((rows + CHUNK - 1) // CHUNK):
        for i in range(chunk * CHUNK, min((chunk + 1) * CHUNK, rows)):
            out[i] = diagonal[i] * x[i] - flow_in(i, beside, coupling, x)
