"""Pattern and product of block matrices against their full form."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.linalg.block_matrix import BLOCK, locate, with_pattern
from tests.engine.linalg.dense import dense, grid


@st.composite
def patterns(draw):
    rows = draw(st.integers(1, 8))
    row = st.integers(0, rows - 1)
    return rows, draw(st.lists(st.tuples(row, row), max_size=20))


def filled(rows, pairs, seed=0):
    a, number = with_pattern(rows, np.array(pairs, np.int64).reshape(-1, 2))
    a.block[:] = np.random.default_rng(seed).normal(size=a.block.shape)
    return a, number


@settings(deadline=None)
@given(patterns())
def test_the_pattern_is_the_diagonal_and_both_blocks_of_every_pair(pattern):
    rows, pairs = pattern
    a, number = filled(rows, pairs)
    assert sorted(number) == list(range(rows))
    wanted = {(i, i) for i in range(rows)} | {(number[i], number[j]) for pair in pairs for i, j in (pair, pair[::-1])}
    found = [(i, int(j)) for i in range(rows) for j in a.column[a.start[i] : a.start[i + 1]]]
    assert found == sorted(wanted)  # each once, columns ascending
    np.testing.assert_array_equal(a.column[a.diagonal], np.arange(rows))
    assert a.rows == rows
    assert a.block.shape == (len(wanted), BLOCK, BLOCK)


@settings(deadline=None)
@given(patterns())
def test_every_block_is_located(pattern):
    a, _ = filled(*pattern)
    for i in range(a.rows):
        for k in range(a.start[i], a.start[i + 1]):
            assert locate(a.start, a.column, i, a.column[k]) == k


def test_a_new_matrix_is_zero():
    a, _ = with_pattern(3, np.array([[0, 2]]))
    assert not a.block.any() and a.block.dtype == np.float64


def test_the_product_of_a_matrix_in_single_precision():
    rng, pairs = np.random.default_rng(0), np.array(grid(5, 30))
    a, _ = with_pattern(150, pairs, np.float32)
    a.block[:] = rng.normal(size=a.block.shape)
    assert a.block.dtype == np.float32
    x = rng.normal(size=(a.rows, BLOCK))
    out = np.empty_like(x)
    a.multiply(x, out)
    np.testing.assert_allclose(out.ravel(), dense(a) @ x.ravel(), rtol=1e-12, atol=1e-12)  # sums are in double precision


@settings(deadline=None)
@given(patterns(), st.integers(0, 100))
def test_the_product_is_that_of_the_full_matrix(pattern, seed):
    a, _ = filled(*pattern, seed)
    x = np.random.default_rng(seed + 1).normal(size=(a.rows, BLOCK))
    out = np.full_like(x, np.nan)
    a.multiply(x, out)
    np.testing.assert_allclose(out.ravel(), dense(a) @ x.ravel(), rtol=1e-12, atol=1e-12)
