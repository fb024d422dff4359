"""Banded Cholesky factors against SciPy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solveh_banded

from engine.linalg import banded
from engine.linalg.banded import WIDTH


def random_band(rng, rows: int):
    """A positive definite matrix, whose transpose is SciPy's lower form."""
    band = rng.uniform(-1, 1, (rows, WIDTH + 1))
    band[:, 0] = 2 * WIDTH + 1
    return band


def full(band):
    """The matrix with all its entries."""
    rows = len(band)
    whole = np.zeros((rows, rows))
    for d in range(min(WIDTH, rows - 1) + 1):
        at = np.arange(rows - d)
        whole[at + d, at] = whole[at, at + d] = band[: rows - d, d]
    return whole


@settings(deadline=None)  # the first example compiles
@given(st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_solutions_are_those_of_scipy(rows, seed):
    rng = np.random.default_rng(seed)
    band = random_band(rng, rows)
    b = rng.normal(size=rows)
    wanted = solveh_banded(band.T[: min(WIDTH, rows - 1) + 1], b, lower=True)
    assert banded.factorise(band)
    banded.solve(band, b)
    np.testing.assert_allclose(b, wanted, rtol=1e-10, atol=1e-12)


@settings(deadline=None)
@given(st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_products_are_those_of_the_full_matrix(rows, seed):
    rng = np.random.default_rng(seed)
    band, x, b = random_band(rng, rows), rng.normal(size=rows), np.empty(rows)
    banded.multiply(band, x, b)
    np.testing.assert_allclose(b, full(band) @ x, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("spoilt", [(0, -1.0), (2, 30.0), (0, np.nan), (1, np.nan)])
def test_a_matrix_that_is_not_positive_is_told(spoilt):
    band = random_band(np.random.default_rng(0), 14)
    column, value = spoilt
    band[7, column] = value
    assert not banded.factorise(band)
