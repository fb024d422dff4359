"""Multigrid for seven-point systems against dense solves, in space that repeats, with sealed components, on any threads."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.linalg.cell_blocks import blocks_of
from engine.linalg.multigrid import BOTTOM, multigrid, solve
from engine.linalg.sealed import sealed_components
from engine.linalg.seven_point import SevenPoint
from tests.engine.threads import on_one_and_two_threads

NEVER = np.zeros(3, np.int64)


def system_of(inside, rng, period=NEVER, openness=0.1, walls=0.3, shuffled=False):
    """Cells where `inside` [x, y, z] is set, with fractions of faces, some of them walls, and conductances to air."""
    place = np.argwhere(inside)
    blocks = place // 4
    place = place[np.lexsort((*place.T, *blocks.T))]
    if shuffled:
        place = rng.permutation(place)
    number = {tuple(cell): i for i, cell in enumerate(place)}
    beside = np.full((len(place), 6), -1, np.int32)
    coupling, diagonal = np.zeros((len(place), 3)), np.zeros(len(place))
    for i, cell in enumerate(place):
        for d in range(6):
            to = cell.copy()
            to[d // 2] += 2 * (d % 2) - 1
            to = np.where(period > 0, to % np.maximum(period, 1), to)
            beside[i, d] = number.get(tuple(to), -1)
            if beside[i, d] == i:
                beside[i, d] = -1
    for i in range(len(place)):
        for a in range(3):
            j = beside[i, 2 * a + 1]
            if j >= 0 and rng.random() > walls:
                coupling[i, a] = rng.random() ** 2
                diagonal[i] += coupling[i, a]
                diagonal[j] += coupling[i, a]
    at_air = rng.random(len(place)) < openness
    diagonal[at_air] += 1.0 / rng.uniform(0.01, 1.0, at_air.sum())
    return SevenPoint(place.astype(np.int32), beside, coupling, diagonal)


def dense(system):
    """The matrix, entry by entry."""
    full = np.diag(system.diagonal)
    for i in range(len(full)):
        for a in range(3):
            j = system.beside[i, 2 * a + 1]
            if j >= 0:
                full[i, j] -= system.coupling[i, a]
                full[j, i] -= system.coupling[i, a]
    return full


@st.composite
def systems(draw):
    """Random cells in boxes of all shapes, some of them rings; too many for the dense bottom level, most of the time."""
    rng = np.random.default_rng(draw(st.integers(0, 1000)))
    shape = np.array([draw(st.integers(1, 13)) for _ in range(3)])
    period = np.where([draw(st.booleans()) for _ in range(3)], shape, 0)
    inside = rng.random(shape) < draw(st.sampled_from([0.4, 0.9, 1.0]))
    inside[0, 0, 0] = True
    return system_of(inside, rng, period, draw(st.sampled_from([0.0, 0.02, 0.3])), draw(st.sampled_from([0.0, 0.5, 0.9])),
                     draw(st.booleans())), period


@settings(deadline=None, max_examples=60)
@given(systems(), st.integers(0, 1000))
def test_the_product_and_the_solution_of_the_full_matrix(of, seed):
    system, period = of
    full, rng = dense(system), np.random.default_rng(seed)
    x, out = rng.normal(size=len(full)), np.empty(len(full))
    system.multiply(x, out)
    np.testing.assert_allclose(out, full @ x, atol=1e-12 * np.abs(full).max())
    p = rng.normal(size=len(full))
    solved = solve(multigrid(system, period), full @ x, p, 1e-10, 200)
    assert solved.residual <= 1e-10
    # within 200 iterations: what closed faces cut into many components, which coarse cells join, was seen to take 72;
    # `liq-projection` has the bar of domains that liquid makes
    np.testing.assert_allclose(full @ p, full @ x, atol=2e-10 * max(np.abs(full @ x).max(), 1e-30) + 1e-13)


@settings(deadline=None, max_examples=60)
@given(systems())
def test_blocks_of_one_colour_do_not_touch(of):
    system, period = of
    order, start, colour = blocks_of(system.place, period)
    assert sorted(order) == list(range(len(order)))
    block_of = np.empty(len(order), int)
    block_of[order] = np.repeat(np.arange(len(start) - 1), np.diff(start))
    colour_of = np.repeat(np.arange(len(colour) - 1), np.diff(colour))[block_of]
    for d in range(6):
        i = np.flatnonzero(system.beside[:, d] >= 0)
        j = system.beside[i, d]
        assert ((block_of[i] == block_of[j]) | (colour_of[i] != colour_of[j])).all()
    corners = {tuple(cell) for cell in system.place >> 2}
    assert len(start) - 1 == len(corners)  # none is in two pieces


@settings(deadline=None, max_examples=60)
@given(systems())
def test_sealed_components_are_the_null_space(of):
    system, _ = of
    sealed = sealed_components(system)
    full = dense(system)
    null = np.zeros((len(sealed.start) - 1, len(full)))
    for c in range(len(null)):
        null[c, sealed.cell[sealed.start[c] : sealed.start[c + 1]]] = 1.0
    np.testing.assert_allclose(full @ null.T, 0.0, atol=1e-12)
    assert (null.sum(axis=0) <= 1).all()
    lowest = np.linalg.eigvalsh(full)
    assert (lowest[: len(null)] < 1e-10).all() and (lowest[len(null) :] > 1e-10).all()


def test_a_sealed_component_loses_its_mean():
    rng = np.random.default_rng(0)
    inside = np.ones((20, 10, 9), bool)
    inside[10] = False  # two tanks; the second has air
    system = system_of(inside, rng, openness=0.0, walls=0.0)
    second = system.place[:, 0] > 10
    system.diagonal[np.flatnonzero(second)[:40]] += 1.0
    load, p = rng.normal(size=len(second)), rng.normal(size=len(second))
    assert solve(multigrid(system, NEVER), load, p, 1e-9, 100).residual <= 1e-9
    balanced = load.copy()
    balanced[~second] -= load[~second].mean()
    out = np.empty_like(p)
    system.multiply(p, out)
    np.testing.assert_allclose(out, balanced, atol=2e-9 * np.abs(load).max())
    assert abs(p[~second].mean()) <= 1e-12 * np.abs(p).max() and abs(p[second].mean()) > 1e-6


def test_no_load_has_no_solution_but_zero():
    system = system_of(np.ones((9, 9, 9), bool), np.random.default_rng(1))
    p = np.ones(729)
    assert solve(multigrid(system, NEVER), np.zeros(729), p, 1e-8, 100) == (0, 0.0) and not p.any()
    closed = system_of(np.ones((9, 9, 9), bool), np.random.default_rng(1), openness=0.0, walls=0.0)
    p[:] = 1.0
    assert solve(multigrid(closed, NEVER), np.ones(729), p, 1e-8, 100) == (0, 0.0) and not p.any()


def test_no_cells():
    nothing = SevenPoint(np.zeros((0, 3), np.int32), np.zeros((0, 6), np.int32), np.zeros((0, 3)), np.zeros(0))
    assert solve(multigrid(nothing, NEVER), np.zeros(0), np.zeros(0), 1e-8, 100) == (0, 0.0)


def test_scattered_drops_need_no_coarse_levels():
    inside = np.zeros((40, 40, 40), bool)
    inside[::3, ::3, ::3] = True
    system = system_of(inside, np.random.default_rng(2), openness=1.0)
    m = multigrid(system, NEVER)
    assert len(system.place) > BOTTOM and len(m.levels) == 1 and len(m.inverse) == 0
    assert solve(m, np.ones(len(system.place)), np.zeros(len(system.place)), 1e-12, 100).iterations == 1


def test_a_good_guess_and_too_few_iterations():
    rng = np.random.default_rng(3)
    system = system_of(np.ones((12, 12, 12), bool), rng)
    x, load, p = rng.normal(size=1728), np.empty(1728), np.zeros(1728)
    system.multiply(x, load)
    solved = solve(multigrid(system, NEVER), load, p, 1e-10, 2)
    assert solved.iterations == 2 and 1e-10 < solved.residual < 1.0
    assert solve(multigrid(system, NEVER), load, x, 1e-10, 100).iterations == 0


def test_the_same_to_the_bit_on_any_number_of_threads():
    rng = np.random.default_rng(4)
    system = system_of(rng.random((24, 24, 24)) < 0.95, rng)  # more cells than one thread is for
    load = rng.normal(size=len(system.place))

    def found():
        p = np.zeros_like(load)
        solved = solve(multigrid(system, NEVER), load, p, 1e-8, 100)
        return p, solved

    (one, _), (two, solved) = on_one_and_two_threads(found)
    np.testing.assert_array_equal(one, two)
    assert solved.residual <= 1e-8


@pytest.mark.parametrize("move", [-37, 100_000])
def test_cells_may_be_anywhere(move):
    rng = np.random.default_rng(5)
    system = system_of(np.ones((12, 12, 12), bool), rng)
    p = np.zeros(1728)
    moved = system._replace(place=system.place + np.int32(move))
    assert solve(multigrid(moved, NEVER), rng.normal(size=1728), p, 1e-8, 100).iterations <= 30
