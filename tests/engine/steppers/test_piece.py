"""A piece of a potential is, for what may move in it, the whole one; and Newton by pieces comes to where Newton comes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.linalg.block_matrix import BLOCK
from engine.steppers import newton as by_pieces
from engine.steppers.newton import newton, settle_pieces
from engine.steppers.newton_system import NewtonSystem
from engine.steppers.piece import piece_of, points_around
from engine.steppers.step_report import Stopwatch
from engine.yarns.settings import YarnSettings
from tests.engine.steppers.test_newton_system import cloths, condensable
from tests.engine.yarns.stacks import perturbed, places, random_stack, unknowns
from tests.engine.yarns.terms import full_hessian


def some_piece(seed, all_condensed=False):
    """A potential on which every energy but crimp occurs, a piece of it around some of its points, and a place."""
    if all_condensed:
        stack, (x, u) = condensable(2 * seed)
    else:
        stack = random_stack(2 * (seed % 2))
        x, u = perturbed(stack, seed)
    whole = stack.potential()
    layout = whole.lay_out(np.float64)
    free = np.zeros(len(x), np.bool_)
    free[np.random.default_rng(seed).choice(layout.point, 4 + seed % 12, replace=False)] = True
    return whole, piece_of(whole, free), x, u


def moves(piece):
    """Which unknowns of which points are free in a piece, shape [p, 5]."""
    return np.einsum("pii->pi", piece.potential.projector) > 0.0


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 10_000), all_condensed=st.booleans())
def test_a_piece_has_the_gradient_and_the_hessian_of_the_whole(seed, all_condensed):
    whole, piece, x, u = some_piece(seed, all_condensed)
    own_x, own_u = x[piece.points], u[piece.nodes]
    free = moves(piece)
    assert free.any()
    gradient, own = whole.gradient(x, u)[1], piece.potential.gradient(own_x, own_u)[1]
    np.testing.assert_allclose(own[free], gradient[piece.points][free], atol=1e-12 * np.abs(gradient).max())
    still = ~free.any(axis=1)
    assert not own[still].any()

    at = (BLOCK * piece.points[:, None] + np.arange(BLOCK))[free]
    for convex in (False, True):
        hessian, of_piece = full_hessian(whole, x, u, convex), full_hessian(piece.potential, own_x, own_u, convex)
        np.testing.assert_allclose(of_piece[np.ix_(free.ravel(), free.ravel())], hessian[np.ix_(at, at)],
                                   atol=1e-12 * np.abs(hessian).max())


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 10_000), all_condensed=st.booleans())
def test_the_energy_of_a_piece_changes_with_that_of_the_whole(seed, all_condensed):
    whole, piece, x, u = some_piece(seed, all_condensed)
    own_x, own_u = x[piece.points], u[piece.nodes]
    step = np.where(moves(piece), np.random.default_rng(seed).normal(scale=1e-3, size=(len(piece.points), BLOCK)), 0.0)
    step = np.einsum("pij,pj->pi", piece.potential.projector, step)
    there = places(piece.potential.model, unknowns(piece.potential.model, own_x, own_u) + step)
    before, own_before = whole.gradient(x, u)[0], piece.potential.gradient(own_x, own_u)[0]
    own_after = piece.potential.gradient(*there)[0]
    rest = x.copy(), u.copy()
    piece.put_back(*there, x, u, whole)
    np.testing.assert_allclose(own_after - own_before, whole.gradient(x, u)[0] - before, atol=1e-11 * (1.0 + abs(before)))
    elsewhere = np.setdiff1d(np.arange(len(x)), piece.points[moves(piece).any(axis=1)])
    np.testing.assert_array_equal(x[elsewhere], rest[0][elsewhere])


@pytest.mark.parametrize("seed", range(4))
def test_the_friction_that_newton_follows_is_taken_along_and_brought_back(seed):
    whole, piece, x, u = some_piece(11 + 12 * seed)
    here = x[piece.points], u[piece.nodes]
    np.testing.assert_array_equal(piece.potential.pull, whole.pull[piece.points])
    piece.potential.update_pull(*here, np.full((len(piece.points), BLOCK), 0.1))
    before = whole.pull.copy(), whole.obstacle_pull.copy()
    piece.put_back(*here, x, u, whole)
    still = np.setdiff1d(np.arange(len(x)), piece.moving)
    for own, found, old in zip((piece.potential.pull, piece.potential.obstacle_pull), (whole.pull, whole.obstacle_pull), before,
                               strict=True):
        np.testing.assert_array_equal(own[piece.moves], found[piece.moving])
        np.testing.assert_array_equal(found[still], old[still])


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 100), rings=st.integers(0, 4))
def test_points_around_others_are_as_many_couplings_away(seed, rings):
    stack, _ = condensable(seed % 3)
    layout = stack.potential().lay_out(np.float64)
    a = layout.matrix
    seeds = np.random.default_rng(seed).choice(np.flatnonzero(stack.state.active), 3, replace=False)
    reached = set()
    for seed_point in seeds:
        e = layout.condensed[seed_point]
        reached |= {int(p) for p in ([seed_point] if e < 0 else layout.others[e])}
    for _ in range(rings):
        reached |= {int(layout.point[j]) for p in reached for j in a.column[a.start[layout.row[p]] : a.start[layout.row[p] + 1]]}
    assert set(np.flatnonzero(points_around(seeds, rings, layout))) == reached


def bent_cloths():
    """Two cloths on each other, as good as solved but for a pull on some contacts, with their system and the goal of Newton."""
    stack, _, _ = cloths(4000)
    potential = stack.potential(replace(YarnSettings(), linear_tolerance=1e-6), h=1e-3)
    system = NewtonSystem(potential, potential.settings, Stopwatch())
    goal = 1e-8 * stack.model.stretch_stiffness.max()
    at = (stack.state.x, stack.state.u, *potential.gradient(stack.state.x, stack.state.u))
    at = converged(potential, system, at, goal)
    pulled = potential.split[:: len(potential.split) // 2]
    potential.multiplier[pulled] += 0.01 * stack.model.stretch_stiffness.max()
    system.forget_factor()
    return potential, system, (*at[:2], *potential.gradient(*at[:2])), goal


def converged(potential, system, at, goal):
    for _ in range(50):
        at, _ = newton(potential, system, at, goal)
        if np.abs(at[3]).max() <= goal:
            return at
    raise AssertionError(np.abs(at[3]).max() / goal)


def test_a_piece_settles_what_is_worst_and_leaves_the_rest():
    potential, system, at, goal = bent_cloths()
    found = settle_pieces(potential, system, at, goal)
    assert found[2] < at[2]
    assert np.abs(found[3]).max() < 0.1 * np.abs(at[3]).max()
    moved = (found[0] != at[0]).any(axis=1)
    assert 0 < np.count_nonzero(moved) < 0.5 * len(moved)
    fresh = potential.gradient(*found[:2])
    assert fresh[0] == found[2]
    np.testing.assert_array_equal(fresh[1], found[3])


def test_newton_by_pieces_ends_where_newton_ends_and_solves_for_all_less_often(monkeypatch):
    def iterations():
        potential, system, at, goal = bent_cloths()
        for count in range(50):
            if np.abs(at[3]).max() <= goal:
                return count, at
            at, _ = newton(potential, system, at, goal)
        raise AssertionError

    pieces, with_pieces = iterations()
    monkeypatch.setattr(by_pieces, "FEWEST_ROWS", np.inf)
    whole, without = iterations()
    assert pieces < whole
    moved = np.abs(with_pieces[0] - bent_cloths()[2][0]).max()
    np.testing.assert_allclose(with_pieces[0], without[0], atol=1e-2 * moved)


def test_no_descent_anywhere_is_told_and_not_taken_for_progress(monkeypatch):
    potential, system, at, goal = bent_cloths()
    monkeypatch.setattr(by_pieces, "line_search", lambda *_, **__: None)
    assert settle_pieces(potential, system, at, goal) is at
    assert newton(potential, system, at, goal)[0] is None
