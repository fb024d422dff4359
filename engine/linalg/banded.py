"""Symmetric matrices with ten diagonals on each side of the main one, as strands have: Cholesky factors and solutions in place.

`band` [n, 11] holds the entry of row j + d and column j at [j, d]; what lies below the last row is not read. Columns lie one
after the other, and loops along them have a fixed length: both let a compiler turn them into vector instructions.
"""

import numpy as np
from numba import njit

WIDTH = 10  # unknowns of a vertex, four, meet those of the two vertices beside it on each side


@njit(cache=True, error_model="numpy")
def factorise(band):
    """Replace a symmetric matrix by its Cholesky factor; returns whether it is positive definite, else `band` is spoilt."""
    rows = band.shape[0]
    for j in range(rows):
        if not band[j, 0] > 0.0:
            return False
        band[j, 0] = 1.0 / np.sqrt(band[j, 0])  # the diagonal of the factor is kept as its inverse
        for d in range(1, WIDTH + 1):
            band[j, d] *= band[j, 0]
        if j + WIDTH < rows:
            for b in range(1, WIDTH + 1):
                factor = band[j, b]
                for d in range(WIDTH + 1 - b):
                    band[j + b, d] -= factor * band[j, b + d]
        else:
            for b in range(1, rows - j):
                for d in range(rows - j - b):
                    band[j + b, d] -= band[j, b] * band[j, b + d]
    return True


@njit(cache=True, error_model="numpy")
def solve(band, b):
    """Replace the right-hand side b [n] by the solution, given the factor."""
    rows = band.shape[0]
    inner = max(rows - WIDTH, 0)
    for j in range(inner):
        b[j] *= band[j, 0]
        for d in range(1, WIDTH + 1):
            b[j + d] -= band[j, d] * b[j]
    for j in range(inner, rows):
        b[j] *= band[j, 0]
        for d in range(1, rows - j):
            b[j + d] -= band[j, d] * b[j]
    for j in range(rows - 1, inner - 1, -1):
        for d in range(rows - 1 - j, 0, -1):
            b[j] -= band[j, d] * b[j + d]
        b[j] *= band[j, 0]
    for j in range(inner - 1, -1, -1):
        s = b[j]
        for d in range(WIDTH, 0, -1):  # the unknown that was found last comes last, so that rows overlap in time
            s -= band[j, d] * b[j + d]
        b[j] = s * band[j, 0]


@njit(cache=True, error_model="numpy")
def multiply(band, x, b):
    """Write the product b [n] of the matrix, not its factor, with x [n]."""
    rows = band.shape[0]
    inner = max(rows - WIDTH, 0)
    b[:] = 0.0
    for j in range(inner):
        own = band[j, 0] * x[j]
        for d in range(1, WIDTH + 1):
            b[j + d] += band[j, d] * x[j]
            own += band[j, d] * x[j + d]
        b[j] += own
    for j in range(inner, rows):
        b[j] += band[j, 0] * x[j]
        for d in range(1, rows - j):
            b[j + d] += band[j, d] * x[j]
            b[j] += band[j, d] * x[j + d]
