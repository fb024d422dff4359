"""Symmetric banded matrices: Cholesky factors and solutions in place.

`band` [n, w+1] holds the entry of row i and column i - d at [i, d]; what lies before the first column is not read.
"""

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def factorise(band):
    """Replace a symmetric matrix by its Cholesky factor; returns whether it is positive definite, else `band` is spoilt."""
    rows, width = band.shape[0], band.shape[1] - 1
    for i in range(rows):
        for d in range(min(width, i), -1, -1):
            j = i - d
            s = band[i, d]
            for m in range(1, min(width - d, j) + 1):
                s -= band[i, d + m] * band[j, m]
            if d > 0:
                band[i, d] = s * band[j, 0]  # the diagonal of the factor is kept as its inverse
            elif s > 0.0:
                band[i, 0] = 1.0 / np.sqrt(s)
            else:
                return False
    return True


@njit(cache=True, error_model="numpy")
def solve(band, b):
    """Replace the right-hand side b [n] by the solution, given the factor."""
    rows, width = band.shape[0], band.shape[1] - 1
    for i in range(rows):
        s = b[i]
        for d in range(1, min(width, i) + 1):
            s -= band[i, d] * b[i - d]
        b[i] = s * band[i, 0]
    for i in range(rows - 1, -1, -1):
        s = b[i] * band[i, 0]
        b[i] = s
        for d in range(1, min(width, i) + 1):
            b[i - d] -= band[i, d] * s


@njit(cache=True, error_model="numpy")
def multiply(band, x, b):
    """Write the product b [n] of the matrix, not its factor, with x [n]."""
    rows, width = band.shape[0], band.shape[1] - 1
    for i in range(rows):
        b[i] = band[i, 0] * x[i]
        for d in range(1, min(width, i) + 1):
            b[i] += band[i, d] * x[i - d]
            b[i - d] += band[i, d] * x[i]
