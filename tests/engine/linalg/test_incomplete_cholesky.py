"""Block incomplete Cholesky: exact where nothing fills in, an approximate inverse elsewhere, none if indefinite."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.linalg.block_matrix import BLOCK
from engine.linalg.incomplete_cholesky import FIRST_SHIFT, factorise, next_shift
from tests.engine.linalg.dense import blocked, chain, dense, factors, grid, positive, reference_factor, reference_solve
from tests.engine.threads import on_one_and_two_threads

LOOP = [(0, 1), (1, 2), (2, 3), (0, 3), (0, 2), (3, 4)]


def inverse_of(full, pairs):
    """The matrix that the factors multiply by, column after column."""
    a, number = blocked(full, pairs)
    found = factors(a)
    columns = np.eye(len(full)).reshape(-1, a.rows, BLOCK)
    out, by_row, x = np.empty_like(columns), np.empty((a.rows, BLOCK)), np.empty((a.rows, BLOCK))
    for b, column in zip(columns, out, strict=True):
        by_row[number] = b
        found.solve(by_row, x)
        column[:] = x[number]
    return out.reshape(len(columns), -1).T


def random_matrix(rows, pairs, seed=0):
    return positive(np.random.default_rng(seed), rows, pairs)


def assert_exact(full, pairs):
    np.testing.assert_allclose(inverse_of(full, pairs) @ full, np.eye(len(full)), atol=1e-9)


@settings(deadline=None, max_examples=30)
@given(rows=st.integers(1, 9), seed=st.integers(0, 1000), scale=st.floats(-6, 6))
def test_exact_for_block_tridiagonal_matrices(rows, seed, scale):
    assert_exact(10.0**scale * random_matrix(rows, chain(rows), seed), chain(rows))


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 1000))
def test_exact_for_a_full_pattern(seed):
    everything = [(i, j) for i in range(5) for j in range(i)]
    assert_exact(random_matrix(5, everything, seed), everything)


def test_fill_is_dropped_where_elimination_starts_between_two_rows():
    between = [(0, 1), (0, 2)]
    full = random_matrix(3, between)
    assert np.abs(inverse_of(full, between) @ full - np.eye(len(full))).max() > 1e-3


@pytest.mark.parametrize("seed", range(5))
def test_symmetric_positive_and_close_where_fill_is_dropped(seed):
    full = random_matrix(5, LOOP, seed)
    inverse = inverse_of(full, LOOP)
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
    assert factors(blocked(full, chain(4))[0]) is None


def test_a_matrix_that_only_dropping_makes_indefinite_is_factorised():
    """Kershaw's example: positive definite, but a pivot of the factorisation without fill is negative."""
    kershaw = np.array([[3.0, -2, 0, 2], [-2, 3, -2, 0], [0, -2, 3, -2], [2, 0, -2, 3]])
    assert np.linalg.eigvalsh(kershaw).min() > 0.0
    full = np.kron(kershaw, np.eye(BLOCK))
    ring = [(0, 1), (1, 2), (2, 3), (0, 3)]
    assert factors(blocked(full, ring)[0]).shift > 0.0
    assert np.linalg.eigvalsh(inverse_of(full, ring)).min() > 0.0


def nearly_broken_down():
    """Kershaw's example with a diagonal for which the last pivot without fill is next to nothing; and its pairs."""
    ring = np.array([[0.0, -2, 0, 2], [-2, 0, -2, 0], [0, -2, 0, -2], [2, 0, -2, 0]])
    return np.kron(ring + (1.0 + 1e-5) * np.sqrt(12.0) * np.eye(4), np.eye(BLOCK)), [(0, 1), (1, 2), (2, 3), (0, 3)]


def inverse_by_rows(factor):
    """What factors multiply by, in the order of the rows of their matrix."""
    columns = np.eye(factor.matrix.rows * BLOCK).reshape(-1, factor.matrix.rows, BLOCK)
    out = np.empty_like(columns)
    for b, x in zip(columns, out, strict=True):
        factor.solve(b, x)
    return out.reshape(len(columns), -1).T


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_stronger_factors_leave_what_nearly_broke_down(dtype):
    full, pairs = nearly_broken_down()
    a, _ = blocked(full, pairs, dtype)
    found = factors(a)
    assert found.shift == 0.0
    assert np.linalg.eigvals(inverse_by_rows(found) @ dense(a)).real.max() > 1e3
    assert factorise(found, stronger=True)
    assert found.shift == FIRST_SHIFT
    assert np.linalg.eigvals(inverse_by_rows(found) @ dense(a)).real.max() < 50.0


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 1000), times=st.integers(1, 4))
def test_stronger_factors_begin_with_a_larger_shift_each_time_and_are_positive(seed, times):
    a, _ = blocked(random_matrix(5, LOOP, seed), LOOP)
    found, shifts = factors(a), []
    for _ in range(times):
        shifts.append(found.shift)
        assert factorise(found, stronger=True)
        assert found.shift >= next_shift(shifts[-1]) > shifts[-1]
        inverse = inverse_by_rows(found)
        np.testing.assert_allclose(inverse, inverse.T, atol=1e-12)
        assert np.linalg.eigvalsh(inverse).min() > 0.0
    while found.shift > shifts[0]:  # what is factorised anew needs less and less, down to what there was at first
        last = found.shift
        assert factorise(found) and shifts[0] <= found.shift < last


def graph(shape, seed):
    """A matrix on a grid of this shape with some more pairs between rows that are near, and its pairs.

    Its diagonal is large enough for factors without a shift.
    """
    wide, long = shape
    rng = np.random.default_rng(seed)
    first = rng.integers(0, wide * (long - 1), size=wide * long // 4)
    pairs = grid(wide, long) + [(i, i + rng.integers(1, wide + 2)) for i in first if i + wide + 1 < wide * long]
    return random_matrix(wide * long, pairs, seed) + 30.0 * np.eye(BLOCK * wide * long), pairs


STRIPS = pytest.mark.parametrize(("shape", "strips"), [((1, 10), 1), ((1, 330), 5), ((3, 110), 5), ((6, 50), 4), ((17, 18), 4)])


@STRIPS
def test_the_factors_are_those_of_elimination_row_after_row(shape, strips):
    full, pairs = graph(shape, 0)
    a, _ = blocked(full, pairs)
    assert len(a.strips.start) - 1 == strips
    found, wanted = factors(a), reference_factor(a)
    assert found.shift == 0.0
    for i, row in enumerate(wanted):
        left = a.column[a.start[i] : a.diagonal[i]]
        assert set(left) == row.keys() - {i}
        np.testing.assert_allclose(found.inverse[i] @ row[i], np.eye(BLOCK), atol=1e-10)
        for j, block in zip(left, found.lower[found.start[i] : found.start[i + 1]], strict=True):
            np.testing.assert_allclose(block, row[j], atol=1e-10)
    b = np.random.default_rng(1).normal(size=(a.rows, BLOCK))
    out = np.full_like(b, np.nan)
    found.solve(b, out)
    np.testing.assert_allclose(out, reference_solve(wanted, b), atol=1e-9)


@STRIPS
def test_the_same_to_the_bit_on_any_number_of_threads(shape, strips):
    a, _ = blocked(*graph(shape, 2))
    b = np.random.default_rng(3).normal(size=(a.rows, BLOCK))

    def solution():
        found, out = factors(a), np.empty_like(b)
        found.solve(b, out)
        return [values.tobytes() for values in (found.lower, found.inverse, out)]

    one, two = on_one_and_two_threads(solution)
    assert one == two


@STRIPS
def test_single_precision_comes_close_to_double(shape, strips):
    full, pairs = graph(shape, 4)
    b, ends = None, []
    for dtype in (np.float32, np.float64):
        a, _ = blocked(full, pairs, dtype)
        b = np.random.default_rng(5).normal(size=(a.rows, BLOCK))
        found, out = factors(a), np.empty_like(b)
        assert found.lower.dtype == found.inverse.dtype == dtype
        found.solve(b, out)
        ends.append(out)
    assert np.linalg.norm(ends[0] - ends[1]) <= 1e-5 * np.linalg.norm(ends[1])
