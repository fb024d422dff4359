"""Preconditioned conjugate gradients against dense solves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.linalg.block_matrix import BLOCK
from engine.linalg.conjugate_gradient import LOOKS, conjugate_gradient, largest_eigenvalue
from tests.engine.linalg.dense import Identity, blocked, chain, dense, factors, grid, positive
from tests.engine.threads import on_one_and_two_threads

GRID = grid(4, 3)


class Dense:
    """Multiplication by a full matrix, in the order of the rows."""

    def __init__(self, full):
        self.full = full

    def solve(self, b, out):
        out[:] = (self.full @ b.ravel()).reshape(b.shape)


def solved(full, b, pairs, preconditioner=None, tolerance=1e-12, most=1000):
    a, number = blocked(full, pairs)
    by_row, x = np.empty_like(b), np.full_like(b, np.nan)
    by_row[number] = b
    iterations, is_positive, *_ = conjugate_gradient(a, by_row, x, preconditioner or factors(a), tolerance, most)
    return x[number], iterations, is_positive


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 1000))
@pytest.mark.parametrize("preconditioned", [False, True])
def test_the_solution_of_the_full_matrix(preconditioned, seed):
    rng = np.random.default_rng(seed)
    full, b = positive(rng, 12, GRID), rng.normal(size=(12, BLOCK))
    x, iterations, is_positive = solved(full, b, GRID, None if preconditioned else Identity())
    assert is_positive and 0 < iterations < 1000
    np.testing.assert_allclose(x.ravel(), np.linalg.solve(full, b.ravel()), rtol=1e-8, atol=1e-8)


def test_one_iteration_with_exact_factors():
    rng = np.random.default_rng(0)
    full, b = positive(rng, 9, chain(9)), rng.normal(size=(9, BLOCK))
    x, iterations, _ = solved(full, b, chain(9))
    assert iterations <= 2  # the second only where the first leaves round-off above the tolerance
    np.testing.assert_allclose(x.ravel(), np.linalg.solve(full, b.ravel()), rtol=1e-9)


def test_the_preconditioned_residual_falls_by_the_tolerance():
    rng = np.random.default_rng(1)
    full, b = positive(rng, 12, GRID), rng.normal(size=(12, BLOCK))
    residuals = []
    for tolerance in (1e-1, 1e-3, 1e-6):
        x, _, _ = solved(full, b, GRID, Identity(), tolerance)
        residuals.append(np.linalg.norm(b.ravel() - full @ x.ravel()) / np.linalg.norm(b))
        assert residuals[-1] <= tolerance
    assert residuals == sorted(residuals, reverse=True)


@pytest.mark.parametrize("floor", [1.0, 1e-3])
def test_the_largest_component_of_the_residual_falls_to_the_floor(floor):
    rng = np.random.default_rng(6)
    pairs = grid(4, 150)  # rows for two chunks
    full, b = positive(rng, 600, pairs), rng.normal(size=(600, BLOCK))
    a, number = blocked(full, pairs)
    by_row, x = np.empty_like(b), np.empty_like(b)
    by_row[number] = b
    iterations, *_ = conjugate_gradient(a, by_row, x, Identity(), 1e-12, 1000, floor)
    assert np.abs(by_row.ravel() - dense(a) @ x.ravel()).max() <= (1.0 + 1e-9) * floor
    conjugate_gradient(a, by_row, x, Identity(), 1e-12, iterations - 1)
    assert np.abs(by_row.ravel() - dense(a) @ x.ravel()).max() > floor  # one iteration less is too few


def test_no_more_iterations_than_allowed():
    rng = np.random.default_rng(2)
    full, b = positive(rng, 12, GRID), rng.normal(size=(12, BLOCK))
    assert solved(full, b, GRID, Identity(), most=3)[1:] == (3, True)


def test_nothing_to_solve():
    x, iterations, is_positive = solved(np.eye(12 * BLOCK), np.zeros((12, BLOCK)), GRID)
    assert not x.any() and iterations == 0 and is_positive


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 1000))
def test_negative_curvature_is_reported(seed):
    rng = np.random.default_rng(seed)
    full = positive(rng, 12, GRID) - 2.0 * np.eye(12 * BLOCK)  # some eigenvalues stay above 2, those of gaps are -1
    assert np.linalg.eigvalsh(full).min() < 0.0 < np.linalg.eigvalsh(full).max()
    _, _, is_positive = solved(full, rng.normal(size=(12, BLOCK)), GRID, Identity())
    assert not is_positive


def test_the_same_to_the_bit_when_repeated():
    rng = np.random.default_rng(3)
    full, b = positive(rng, 12, GRID), rng.normal(size=(12, BLOCK))
    np.testing.assert_array_equal(solved(full, b, GRID)[0], solved(full, b, GRID)[0])


def test_the_same_to_the_bit_on_any_number_of_threads():
    rng = np.random.default_rng(4)
    pairs = grid(4, 150)  # rows for two chunks of the sums, and for several strips
    full, b = positive(rng, 600, pairs), rng.normal(size=(600, BLOCK))
    (x, iterations, _), (one, same, _) = on_one_and_two_threads(lambda: solved(full, b, pairs))
    np.testing.assert_array_equal(x, one)
    assert iterations == same


def test_a_matrix_and_factors_in_single_precision_solve_to_its_precision():
    rng = np.random.default_rng(5)
    pairs = grid(4, 80)
    full, b = positive(rng, 320, pairs), rng.normal(size=(320, BLOCK))
    a, number = blocked(full, pairs, np.float32)
    by_row, x = np.empty_like(b), np.empty_like(b)
    by_row[number] = b
    assert conjugate_gradient(a, by_row, x, factors(a), 1e-10, 1000)[1]
    wanted = np.linalg.solve(full, b.ravel())
    assert np.linalg.norm(x[number].ravel() - wanted) <= 1e-5 * np.linalg.norm(wanted)


def textbook_steps(full, inverse, b, count):
    """The steps alpha and turns beta of so many iterations of the method."""
    r, z = b, inverse @ b
    p, steps, turns = z, [], []
    for _ in range(count):
        q = full @ p
        steps.append(r @ z / (p @ q))
        rest = r - steps[-1] * q
        turns.append(rest @ inverse @ rest / (r @ z))
        r, z = rest, inverse @ rest
        p = z + turns[-1] * p
    return steps, turns[:-1]


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 1000), preconditioned=st.booleans())
def test_the_largest_eigenvalue_is_found_and_from_below(seed, preconditioned):
    rng = np.random.default_rng(seed)
    full, b = positive(rng, 2, chain(2)), rng.normal(size=2 * BLOCK)
    inverse = positive(rng, 2, chain(2)) if preconditioned else np.eye(2 * BLOCK)
    wanted = np.linalg.eigvals(inverse @ full).real.max()
    found = [largest_eigenvalue(*textbook_steps(full, inverse, b, count)) for count in (1, 3, 7)]
    assert (np.diff(found) >= -1e-6 * wanted).all() and found[-1] <= (1.0 + 1e-6) * wanted
    assert found[-1] >= 0.9 * wanted


def test_the_estimate_of_one_step_is_a_rayleigh_quotient():
    full = np.diag([1.0, 3.0])
    assert largest_eigenvalue(*textbook_steps(full, np.eye(2), np.array([1.0, 1.0]), 1)) == pytest.approx(2.0)
    assert largest_eigenvalue(*textbook_steps(full, np.eye(2), np.array([1.0, 1.0]), 2)) == pytest.approx(3.0)


def with_one_huge_eigenvalue(huge):
    """A matrix on a long grid, a load, and a preconditioner M with one eigenvalue of M^-1 A at `huge`, the others up to 1."""
    rng = np.random.default_rng(7)
    pairs = grid(2, 15)
    full, b = positive(rng, 30, pairs), rng.normal(size=(30, BLOCK))
    a, _ = blocked(full, pairs)
    vector = rng.normal(size=30 * BLOCK)
    root = np.linalg.cholesky(dense(a))  # M^-1 = c + v v^T is similar to c A + w w^T with w = L^T v
    even = 1.0 / np.linalg.eigvalsh(dense(a)).max()
    vector *= np.sqrt(huge) / np.linalg.norm(root.T @ vector)
    return a, b, Dense(even * np.eye(30 * BLOCK) + np.outer(vector, vector))


@pytest.mark.parametrize("huge", [1e2, 1e4, 1e6])
def test_an_outlier_of_the_spectrum_is_reported_within_few_iterations(huge):
    a, b, preconditioner = with_one_huge_eigenvalue(huge)
    x = np.empty_like(b)
    assert conjugate_gradient(a, b, x, preconditioner, 1e-9, 2000, outlier=8.0)[:3] == (LOOKS[0], True, False)


@pytest.mark.parametrize("huge", [1e2, 1e4])
def test_an_outlier_that_is_allowed_only_takes_time(huge):
    a, b, preconditioner = with_one_huge_eigenvalue(huge)
    for allowed in ({}, {"outlier": 1.1 * huge}):
        x = np.empty_like(b)
        iterations, is_positive, sound, _ = conjugate_gradient(a, b, x, preconditioner, 1e-9, 2000, **allowed)
        assert LOOKS[-1] < iterations < 2000 and is_positive and sound
        np.testing.assert_allclose(x.ravel(), np.linalg.solve(dense(a), b.ravel()), rtol=1e-5, atol=1e-5)
