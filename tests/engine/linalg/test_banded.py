"""Banded Cholesky factors against SciPy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solveh_banded

from engine.linalg import banded


def random_band(rng, rows: int, width: int):
    """A positive definite matrix in both storages: entry (i, i - d) at [i, d], and SciPy's lower form."""
    band = rng.uniform(-1, 1, (rows, width + 1))
    band[:, 0] = 2 * width + 1
    lower = np.zeros((width + 1, rows))
    for d in range(min(width, rows - 1) + 1):
        lower[d, : rows - d] = band[d:, d]
    return band, lower


@settings(deadline=None)  # the first example compiles
@given(st.integers(2, 40), st.integers(1, 10), st.integers(0, 2**32 - 1))
def test_solutions_are_those_of_scipy(rows, width, seed):
    rng = np.random.default_rng(seed)
    band, lower = random_band(rng, rows, width)
    b = rng.normal(size=rows)
    wanted = solveh_banded(lower, b, lower=True)
    assert banded.factorise(band)
    banded.solve(band, b)
    np.testing.assert_allclose(b, wanted, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("spoilt", [(0, -1.0), (2, 9.0), (0, np.nan), (1, np.nan)])
def test_a_matrix_that_is_not_positive_is_told(spoilt):
    band, _ = random_band(np.random.default_rng(0), 12, 3)
    column, value = spoilt
    band[7, column] = value
    assert not banded.factorise(band)
