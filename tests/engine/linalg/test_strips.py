"""Strips of rows: an order of all of them, in which what works on one colour at once meets nobody else's rows."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array

from engine.linalg.strips import FEWEST_ROWS, MOST, permuted, strips_of
from tests.engine.linalg.dense import chain, grid


def pattern(rows, pairs):
    """Start and column of the symmetric pattern of the diagonal and `pairs`."""
    i, j = np.concatenate([np.array(pairs, np.int64).reshape(-1, 2), np.arange(rows)[:, None].repeat(2, axis=1)]).T
    entries = np.concatenate([i, j]), np.concatenate([j, i])
    a = coo_array((np.ones(2 * len(i)), entries), shape=(rows, rows)).tocsr()
    a.sort_indices()
    return a.indptr.astype(np.int64), a.indices.astype(np.int64)


@st.composite
def graphs(draw):
    """One to three grids, most of them long, with more pairs at random and their rows in any order."""
    rng = np.random.default_rng(draw(st.integers(0, 1000)))
    rows, pairs = 0, []
    for _ in range(draw(st.integers(1, 3))):
        wide, long = draw(st.integers(1, 6)), draw(st.integers(1, 200))
        pairs += grid(wide, long, rows)
        near = rows + rng.integers(0, wide * long, size=draw(st.integers(0, 20)))
        pairs += [(i, min(i + rng.integers(0, 3 * wide), rows + wide * long - 1)) for i in near]
        rows += wide * long
    if draw(st.booleans()):
        pairs += [tuple(pair) for pair in rng.integers(0, rows, size=(draw(st.integers(0, 30)), 2))]
    shuffled = rng.permutation(rows) if draw(st.booleans()) else np.arange(rows)
    return rows, shuffled[np.array(pairs, np.int64).reshape(-1, 2)]


def strips_of_rows(strips):
    """The strip of every row, in the new order."""
    return np.repeat(np.arange(len(strips.start) - 1), np.diff(strips.start))


def assert_sound(rows, pairs):
    """Check all that elimination relies on; returns the number of strips."""
    start, column = pattern(rows, pairs)
    order, strips = strips_of(start, column)
    assert sorted(order) == list(range(rows))
    count = len(strips.start) - 1
    assert strips.start[0] == 0 and strips.start[-1] == rows and (np.diff(strips.start) > 0).all()
    assert 1 <= count <= max(min(MOST, rows // FEWEST_ROWS), 1) and strips.reds == (count + 1) // 2

    number = np.argsort(order)
    i, j = number[np.repeat(np.arange(rows), np.diff(start))], number[column]
    strip, red = strips_of_rows(strips), np.arange(count) < strips.reds
    across = strip[i] != strip[j]
    assert (red[strip[i]] != red[strip[j]])[across].all()  # strips of one colour do not touch
    touched = np.unique(np.column_stack([i, strip[j]])[across], axis=0)
    assert (np.bincount(touched[:, 0], minlength=rows) <= 1).all()  # no row touches both neighbours of its strip
    return count


@settings(deadline=None, max_examples=60)
@given(graphs())
def test_strips_are_sound(graph):
    assert_sound(*graph)


@pytest.mark.parametrize(("wide", "long", "count"), [
    (1, 300, 4), (3, 200, 9), (6, 50, 4), (1, 127, 1), (1, 128, 2), (20, 60, 16), (64, 1, 1), (200, 3, 9)])
def test_grids_fall_into_as_many_strips_as_have_rows_for_them(wide, long, count):
    assert assert_sound(wide * long, grid(wide, long)) == count


def test_what_has_few_levels_has_few_strips():
    for centre in (0, 500):  # two levels and three
        assert assert_sound(1000, [(centre, i) for i in range(1000)]) == 1
    assert assert_sound(1000, []) == 15  # every row a level


def test_strips_of_a_chain_have_about_the_same_size():
    sizes = np.diff(strips_of(*pattern(1000, chain(1000)))[1].start)
    assert np.ptp(sizes) <= 2


def test_components_are_levels_of_their_own():
    """Where one grid ends and the next begins, nothing touches; a strip may hold rows of both."""
    assert assert_sound(400, grid(2, 100) + grid(2, 100, 200)) == 6
    assert assert_sound(400, grid(20, 19) + chain(1) + grid(2, 10, 380)) == 6


def test_one_row():
    order, strips = strips_of(*pattern(1, []))
    np.testing.assert_array_equal(order, [0])
    np.testing.assert_array_equal(strips.start, [0, 1])
    assert strips.reds == 1


@settings(deadline=None, max_examples=30)
@given(graphs(), st.integers(0, 1000))
def test_a_pattern_is_permuted_by_rows_and_columns(graph, seed):
    rows, pairs = graph
    start, column = pattern(rows, pairs)
    order = np.random.default_rng(seed).permutation(rows)
    number = np.argsort(order)
    new_start, new_column, diagonal = permuted(start, column, order, number)
    wanted_start, wanted_column = pattern(rows, number[pairs])
    np.testing.assert_array_equal(new_start, wanted_start)
    np.testing.assert_array_equal(new_column, wanted_column)
    np.testing.assert_array_equal(new_column[diagonal], np.arange(rows))
