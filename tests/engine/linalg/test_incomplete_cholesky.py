"""Block incomplete Cholesky: exact where nothing fills in, an approximate inverse elsewhere, none if indefinite."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.linalg.block_matrix import BLOCK
from tests.engine.linalg.dense import blocked, chain, factors, positive

LOOP = [(0, 1), (1, 2), (2, 3), (0, 3), (0, 2), (3, 4)]
STAR = [(0, 1), (0, 2), (0, 3), (0, 4)]


def inverse_of(found, rows):
    """The matrix that the factors multiply by, column after column."""
    columns = np.eye(rows * BLOCK).reshape(-1, rows, BLOCK)
    out = np.full_like(columns, np.nan)
    for b, x in zip(columns, out, strict=True):
        found.solve(b.copy(), x)
    return out.reshape(len(columns), -1).T


def random_matrix(rows, pairs, seed=0):
    return positive(np.random.default_rng(seed), rows, pairs)


def assert_exact(full, pairs, order=None):
    inverse = inverse_of(factors(blocked(full, pairs), order), len(full) // BLOCK)
    np.testing.assert_allclose(inverse @ full, np.eye(len(full)), atol=1e-9)


@settings(deadline=None, max_examples=30)
@given(rows=st.integers(1, 9), seed=st.integers(0, 1000), scale=st.floats(-6, 6))
def test_exact_for_block_tridiagonal_matrices(rows, seed, scale):
    full = 10.0**scale * random_matrix(rows, chain(rows), seed)
    assert_exact(full, chain(rows))
    assert_exact(full, chain(rows), order=np.arange(rows)[::-1])


@settings(deadline=None, max_examples=20)
@given(order=st.permutations(range(5)))
def test_exact_for_a_full_pattern_in_any_order(order):
    everything = [(i, j) for i in range(5) for j in range(i)]
    assert_exact(random_matrix(5, everything), everything, order)


@settings(deadline=None, max_examples=20)
@given(leaves=st.permutations(range(1, 5)))
def test_exact_for_a_star_whose_centre_is_eliminated_last(leaves):
    full = random_matrix(5, STAR)
    assert_exact(full, STAR, [*leaves, 0])
    first = inverse_of(factors(blocked(full, STAR), [0, *leaves]), 5)
    assert np.abs(first @ full - np.eye(len(full))).max() > 1e-3  # the other way round, fill is dropped


@pytest.mark.parametrize("seed", range(5))
def test_symmetric_positive_and_close_where_fill_is_dropped(seed):
    full = random_matrix(5, LOOP, seed)
    inverse = inverse_of(factors(blocked(full, LOOP)), 5)
    np.testing.assert_allclose(inverse, inverse.T, atol=1e-12)
    assert np.linalg.eigvalsh(inverse).min() > 0.0
    spread = np.linalg.eigvals(inverse @ full).real
    assert spread.max() / spread.min() < 0.2 * np.linalg.cond(full)


def indefinite_pivot():
    full = random_matrix(4, chain(4))
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
    assert factors(blocked(full, chain(4))) is None


def test_a_matrix_that_only_dropping_makes_indefinite_is_factorised():
    """Kershaw's example: positive definite, but a pivot of the factorisation without fill is negative."""
    kershaw = np.array([[3.0, -2, 0, 2], [-2, 3, -2, 0], [0, -2, 3, -2], [2, 0, -2, 3]])
    assert np.linalg.eigvalsh(kershaw).min() > 0.0
    full = np.kron(kershaw, np.eye(BLOCK))
    found = factors(blocked(full, [(0, 1), (1, 2), (2, 3), (0, 3)]))
    assert found.shift > 0.0
    assert np.linalg.eigvalsh(inverse_of(found, 4)).min() > 0.0
