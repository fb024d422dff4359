"""Pattern and product of block matrices against their full form."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.linalg.block_matrix import BLOCK, locate, with_pattern
from tests.engine.linalg.dense import dense


@st.composite
def patterns(draw):
    rows = draw(st.integers(1, 8))
    row = st.integers(0, rows - 1)
    return rows, draw(st.lists(st.tuples(row, row), max_size=20))


def filled(rows, pairs, seed=0):
    a = with_pattern(rows, np.array(pairs, np.int64).reshape(-1, 2))
    a.block[:] = np.random.default_rng(seed).normal(size=a.block.shape)
    return a


@settings(deadline=None)
@given(patterns())
def test_the_pattern_is_the_diagonal_and_both_blocks_of_every_pair(pattern):
    rows, pairs = pattern
    a = filled(rows, pairs)
    wanted = {(i, i) for i in range(rows)} | set(pairs) | {(j, i) for i, j in pairs}
    found = [(i, int(j)) for i in range(rows) for j in a.column[a.start[i] : a.start[i + 1]]]
    assert found == sorted(wanted)  # each once, columns ascending
    np.testing.assert_array_equal(a.column[a.diagonal], np.arange(rows))
    assert a.rows == rows
    assert a.block.shape == (len(wanted), BLOCK, BLOCK)


@settings(deadline=None)
@given(patterns())
def test_every_block_is_located(pattern):
    a = filled(*pattern)
    for i in range(a.rows):
        for k in range(a.start[i], a.start[i + 1]):
            assert locate(a.start, a.column, i, a.column[k]) == k


def test_a_new_matrix_is_zero():
    assert not with_pattern(3, np.array([[0, 2]])).block.any()


@settings(deadline=None)
@given(patterns(), st.integers(0, 100))
def test_the_product_is_that_of_the_full_matrix(pattern, seed):
    a = filled(*pattern, seed)
    x = np.random.default_rng(seed + 1).normal(size=(a.rows, BLOCK))
    out = np.full_like(x, np.nan)
    a.multiply(x, out)
    np.testing.assert_allclose(out.ravel(), dense(a) @ x.ravel(), rtol=1e-12, atol=1e-12)
