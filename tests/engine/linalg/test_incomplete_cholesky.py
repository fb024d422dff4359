"""Block incomplete Cholesky: exact where nothing fills in, an approximate inverse elsewhere, none if indefinite."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.linalg.block_matrix import BLOCK
from engine.linalg.incomplete_cholesky import factorise
from tests.engine.linalg.dense import blocked, chain, positive

LOOP = [(0, 1), (1, 2), (2, 3), (0, 3), (0, 2), (3, 4)]


def applied(factors, rows):
    """The matrix that the factors multiply by, column after column."""
    columns = np.eye(rows * BLOCK).reshape(-1, rows, BLOCK)
    out = np.full_like(columns, np.nan)
    for b, x in zip(columns, out, strict=True):
        factors.solve(b.copy(), x)
    return out.reshape(len(columns), -1).T


@settings(deadline=None, max_examples=30)
@given(rows=st.integers(1, 9), seed=st.integers(0, 1000), scale=st.floats(-6, 6))
def test_exact_for_block_tridiagonal_matrices(rows, seed, scale):
    full = 10.0**scale * positive(np.random.default_rng(seed), rows, chain(rows))
    factors = factorise(blocked(full, chain(rows)))
    np.testing.assert_allclose(applied(factors, rows) @ full, np.eye(len(full)), atol=1e-9)


def test_exact_for_a_full_pattern():
    everything = [(i, j) for i in range(4) for j in range(i)]
    full = positive(np.random.default_rng(1), 4, everything)
    factors = factorise(blocked(full, everything))
    np.testing.assert_allclose(applied(factors, 4) @ full, np.eye(len(full)), atol=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_symmetric_positive_and_close_where_fill_is_dropped(seed):
    full = positive(np.random.default_rng(seed), 5, LOOP)
    inverse = applied(factorise(blocked(full, LOOP)), 5)
    np.testing.assert_allclose(inverse, inverse.T, atol=1e-12)
    assert np.linalg.eigvalsh(inverse).min() > 0.0
    spread = np.linalg.eigvals(inverse @ full).real
    assert spread.max() / spread.min() < 0.2 * np.linalg.cond(full)


def test_a_solve_may_overwrite_its_right_hand_side():
    full = positive(np.random.default_rng(3), 6, chain(6))
    factors = factorise(blocked(full, chain(6)))
    b = np.random.default_rng(4).normal(size=(6, BLOCK))
    x = b.copy()
    factors.solve(x, x)
    np.testing.assert_allclose(full @ x.ravel(), b.ravel(), atol=1e-10)


def indefinite_pivot():
    full = positive(np.random.default_rng(0), 4, chain(4))
    full[7, 7] = -1.0
    return full


def indefinite_across():
    full = np.eye(4 * BLOCK)
    full[3, 3 + BLOCK] = full[3 + BLOCK, 3] = 10.0  # positive on the diagonal, not as a whole
    return full


@pytest.mark.parametrize(
    "full", [-np.eye(4 * BLOCK), np.zeros((4 * BLOCK, 4 * BLOCK)), indefinite_pivot(), indefinite_across()],
    ids=["negative", "zero", "pivot", "across"])
def test_no_factors_of_a_matrix_far_from_positive(full):
    assert factorise(blocked(full, chain(4))) is None


def test_a_matrix_that_only_dropping_makes_indefinite_is_factorised():
    """Kershaw's example: positive definite, but a pivot of the factorisation without fill is negative."""
    kershaw = np.array([[3.0, -2, 0, 2], [-2, 3, -2, 0], [0, -2, 3, -2], [2, 0, -2, 3]])
    assert np.linalg.eigvalsh(kershaw).min() > 0.0
    full = np.kron(kershaw, np.eye(BLOCK))
    inverse = applied(factorise(blocked(full, [(0, 1), (1, 2), (2, 3), (0, 3)])), 4)
    assert np.linalg.eigvalsh(0.5 * (inverse + inverse.T)).min() > 0.0
