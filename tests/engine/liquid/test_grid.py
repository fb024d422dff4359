"""Blocks are those around the particles, in order, with the right neighbours; particles are sorted by them."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.liquid.grid import CELLS, COLOURS, SIDE, beside, sorted_grid, taken
from tests.engine.liquid.pools import SPACING, cells_of, lattice, liquid
from tests.engine.threads import on_one_and_two_threads

OFFSETS = list(product((-1, 0, 1), repeat=3))
PERIODS = st.tuples(*[st.sampled_from([0, 4, 8, 24])] * 3)
ORIGIN = np.array([-0.003, 0.7, 0.0])


def scattered(seed, count, period, reach=60.0):
    """Places anywhere, and some on the edges of blocks; within the period along the axes that have one."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(-reach, reach, (count, 3))
    at[::3] = np.round(at[::3] / SIDE) * SIDE
    period = np.array(period)
    return np.where(period > 0, at % np.maximum(period, 1), at), period


def reference_blocks(at, period):
    """The set of blocks of cell coordinates `at` and of those around them, by wrapping every one."""
    blocks = period // SIDE

    def wrapped(block):
        return tuple(int(b % n if n else b) for b, n in zip(block, blocks, strict=True))

    own = [tuple(map(int, np.floor(p / SIDE))) for p in at]
    return own, {wrapped(np.add(block, offset)) for block in own for offset in OFFSETS}, wrapped


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**31), st.integers(0, 40), PERIODS)
def test_blocks_and_their_neighbours(seed, count, period):
    at, period = scattered(seed, count, period)
    model = liquid(spacing=1.0, period=period)
    grid, order = sorted_grid(model, at)
    own, every, wrapped = reference_blocks(at, period)
    place = [tuple(map(int, p)) for p in grid.place]
    assert place == sorted(every)
    number = {block: b for b, block in enumerate(place)}
    for b, block in enumerate(place):
        assert grid.near[b].tolist() == [number.get(wrapped(np.add(block, offset)), -1) for offset in OFFSETS]
    held = np.array([number[block] for block in own], np.int64)
    assert order.tolist() == np.argsort(held, kind="stable").tolist(), "of one block, in the order in which they came"
    assert grid.start.tolist() == np.searchsorted(held[order], np.arange(len(place) + 1)).tolist()
    assert sorted(grid.turn) == sorted(set(held)) and grid.turns[0] == 0 and grid.turns[COLOURS] == len(grid.turn)
    assert (grid.near[grid.turn] >= 0).all(), "particles reach nothing that is not there"


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**31), PERIODS)
def test_blocks_of_one_colour_reach_no_cell_in_common(seed, period):
    at, period = scattered(seed, 60, period, reach=16.0)
    grid, _ = sorted_grid(liquid(spacing=1.0, period=period), at)
    for colour in range(COLOURS):
        reached = set()
        for b in grid.turn[grid.turns[colour] : grid.turns[colour + 1]]:
            cells = {tuple(int(c % n if n else c) for c, n in zip(SIDE * grid.place[b] + offset, period, strict=True))
                     for offset in product(range(-1, SIDE + 2), repeat=3)}
            assert not cells & reached
            reached |= cells


def test_many_blocks_far_apart():
    """More than the tables hold at first, and coordinates up to the ends of what keys hold."""
    at, _ = scattered(5, 3000, (0, 0, 0), reach=4e6)
    grid, order = sorted_grid(liquid(spacing=1.0), at)
    own, every, _ = reference_blocks(at, np.zeros(3, int))
    assert [tuple(p) for p in grid.place.tolist()] == sorted(every)
    assert np.array_equal(grid.place[np.repeat(np.arange(len(grid.place)), np.diff(grid.start))], np.array(own)[order])


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**31), st.integers(1, 50))
def test_a_sorted_order_is_kept(seed, count):
    at, _ = scattered(seed, count, (0, 8, 0), reach=20.0)
    model = liquid(origin=ORIGIN, period=(0, 8, 0))
    x = ORIGIN + SPACING * at
    x[:, 1] = np.clip(x[:, 1], ORIGIN[1], ORIGIN[1] + 7.999 * SPACING)
    once = taken(x, sorted_grid(model, x)[1])
    assert np.array_equal(sorted_grid(model, once)[1], np.arange(count))


@pytest.mark.parametrize("period", [(0, 0, 0), (4, 8, 0)])
def test_beside(period):
    period = np.array(period)
    grid, _ = sorted_grid(liquid(spacing=1.0, period=period), np.array([[1.0, 5.0, -9.0], [2.0, 1.0, 7.0]]))
    cells = cells_of(grid)
    number = {tuple(cell): (n // CELLS, n % CELLS) for n, cell in enumerate(cells.reshape(-1, 3).tolist())}
    for b, c, axis, step in product(range(len(grid.place)), range(CELLS), range(3), (-1, 1)):
        there = cells[b, c] + step * np.eye(3, dtype=int)[axis]
        there = np.where(period > 0, there % np.maximum(period, 1), there)
        found = beside(grid.near[b], c, axis, step)
        assert found == number.get(tuple(there.tolist()), (-1, found[1]))


def test_no_particles_no_blocks():
    grid, order = sorted_grid(liquid(), np.zeros((0, 3)))
    assert len(grid.place) == len(grid.turn) == len(order) == 0 and grid.faces().shape == (3, 0, CELLS)


def test_rows_in_another_order_on_any_number_of_threads():
    x = lattice((0, 0, 0), (0.1, 0.1, 0.1))
    values, order = np.random.default_rng(1).random((len(x), 3, 3)), np.random.default_rng(2).permutation(len(x))
    one, two = on_one_and_two_threads(lambda: taken(values, order))
    assert np.array_equal(one, two) and np.array_equal(one, values[order])
    assert np.array_equal(taken(values[:, 0, 0].copy(), order), values[order, 0, 0])
