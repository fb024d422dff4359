"""Isotropic friction: its limit in every direction, anchors, and what it is for one yarn alone and for parallel ones."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from engine.yarns import friction, friction_circle
from tests.engine.yarns.stacks import SETTINGS, random_stack

POINT, NODES = np.array([0]), np.array([[0, 1]])
PLACES = st.tuples(*[st.floats(-10.0, 10.0)] * 2).map(np.array)
SLOPES = st.tuples(*[st.floats(-2.0, 2.0)] * 6).map(lambda n: np.array(n).reshape(2, 3))
ACROSS = np.eye(3)[:2]


def force(u, anchor, slope, spring, limit):
    """What the law pulls with on both Eulerian coordinates."""
    gradient = np.zeros((2, 4))
    friction_circle.add_gradient(POINT, NODES, np.array([spring]), np.array([limit]), slope, anchor, u, gradient)
    return gradient[:, 3]


@settings(deadline=None)
@given(u=PLACES, anchor=PLACES, slope=SLOPES, spring=st.floats(0.1, 10.0), limit=st.floats(0.0, 10.0))
def test_the_force_of_dragged_anchors_is_that_of_the_step_within_the_limit(u, anchor, slope, spring, limit):
    before, moved = force(u, anchor, slope, spring, limit), anchor.copy()
    friction_circle.drag_anchors(POINT, NODES, np.array([spring]), np.array([limit]), slope, u, moved)
    np.testing.assert_allclose(force(u, moved, slope, spring, limit), before, atol=1e-9)
    slip = slope[0] * (u - moved)[0] - slope[1] * (u - moved)[1]
    assert spring * np.linalg.norm(slip) <= limit * (1.0 + 1e-9) + 1e-12
    if spring * np.linalg.norm(slope[0] * (u - anchor)[0] - slope[1] * (u - anchor)[1]) < limit:
        np.testing.assert_array_equal(moved, anchor)  # what sticks does not creep


@settings(deadline=None)
@given(direction=st.floats(0.0, 2.0 * np.pi), angle=st.floats(0.2, 2.9))
def test_yarns_that_slide_are_held_alike_in_every_direction(direction, angle):
    slope = np.array([[1.0, 0.0, 0.0], [np.cos(angle), np.sin(angle), 0.0]])
    wanted = np.array([np.cos(direction), np.sin(direction)])
    u = np.linalg.solve(np.column_stack([slope[0], -slope[1]])[:2], 10.0 * wanted)
    found = force(u, np.zeros(2), slope, spring=1.0, limit=0.7)
    np.testing.assert_allclose(found, 0.7 * np.array([slope[0, :2] @ wanted, -slope[1, :2] @ wanted]), atol=1e-12)


@settings(deadline=None)
@given(u=st.floats(-10.0, 10.0), limit=st.floats(0.0, 5.0), axis=st.sampled_from([0, 1]))
def test_sliding_along_one_of_two_yarns_is_the_law_of_that_yarn(u, limit, axis):
    place, gradient = np.zeros(2), np.zeros((2, 4))
    place[axis] = u
    none = np.zeros(2)
    friction.add_gradient(np.arange(2), np.full(2, 2.0), np.full(2, limit), none, none, none, place, gradient)
    np.testing.assert_allclose(force(place, none, ACROSS, 2.0, limit), gradient[:, 3], atol=1e-12)


def test_of_parallel_yarns_both_anchors_act_in_series():
    along = np.array([[1.0, 0.0, 0.0]] * 2)
    np.testing.assert_allclose(force(np.array([3.0, 1.0]), np.zeros(2), along, 1.0, 0.7), [0.7, -0.7])
    np.testing.assert_allclose(force(np.array([3.0, 3.0]), np.zeros(2), along, 1.0, 0.7), 0.0)  # both go on together


def updated(pull, u, du, anchor, slope, spring, limit):
    """What `update_pull` makes of one point's pull."""
    pull = np.array([pull])
    friction_circle.update_pull(POINT, NODES, np.array([spring]), np.array([limit]), slope, anchor, u, du, pull)
    return pull[0]


def hessian(pull, u, anchor, slope, spring, limit):
    """The second derivatives that Newton sees at one point."""
    sliding = np.zeros((1, 2, 2))
    friction_circle.add_hessian(POINT, NODES, np.array([spring]), np.array([limit]), slope, anchor, np.array([pull]), u, sliding)
    return sliding[0]


@settings(deadline=None)
@given(u=PLACES, anchor=PLACES, slope=SLOPES, spring=st.floats(0.1, 10.0), limit=st.floats(0.1, 10.0))
def test_the_pull_without_an_update_is_the_force_over_its_limit(u, anchor, slope, spring, limit):
    pull = updated(np.zeros(3), u, np.zeros(2), anchor, slope, spring, limit)
    found = limit * np.array([slope[0] @ pull, -slope[1] @ pull])
    np.testing.assert_allclose(found, force(u, anchor, slope, spring, limit), atol=1e-9)


@settings(deadline=None)
@given(u=PLACES, du=PLACES, slope=SLOPES, before=st.tuples(*[st.floats(-0.5, 0.5)] * 3), limit=st.floats(0.0, 10.0))
@example(  # a slip whose square is no number any more, without friction
    u=np.array([7.4e-289, 0.0]), du=np.array([1.0, 0.0]), slope=np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]),
    before=(0.0, 0.0, 0.5), limit=0.0)
def test_no_pull_is_more_than_the_limit_or_makes_the_hessian_negative(u, du, slope, before, limit):
    pull = updated(np.array(before), u, du, np.zeros(2), slope, 1.0, limit)
    assert np.linalg.norm(pull) <= 1.0 + 1e-12
    found = hessian(pull, u + du, np.zeros(2), slope, 1.0, limit)
    assert np.linalg.eigvalsh(found)[0] >= -1e-9 * max(1.0, np.abs(found).max())


@settings(deadline=None)
@given(rest=st.tuples(*[st.floats(-1.0, 1.0)] * 2).map(np.array), start=st.tuples(*[st.floats(-1.0, 1.0)] * 2).map(np.array))
def test_newton_finds_whether_a_contact_sticks_though_it_starts_a_million_reaches_away(rest, start):
    spring, limit, u, pull = 1e6, 0.5, start, np.zeros(3)  # held by a unit spring at `rest`
    for _ in range(25):
        gradient = u - rest + force(u, np.zeros(2), ACROSS, spring, limit)
        if np.abs(gradient).max() < 1e-6:
            break
        du = np.linalg.solve(np.eye(2) + hessian(pull, u, np.zeros(2), ACROSS, spring, limit), -gradient)
        pull, u = updated(pull, u, du, np.zeros(2), ACROSS, spring, limit), u + du
    length = np.linalg.norm(rest)
    np.testing.assert_allclose(u, rest * max(0.0, 1.0 - limit / max(length, 1e-300)), atol=3e-6)


# a subnormal limit [N] over a way of its own size has lost its digits
@given(stiffest=st.floats(1e-3, 1e3), limit=st.floats(0.0, 1e3, allow_subnormal=False), rest_segment=st.floats(1e-4, 1.0))
def test_friction_reaches_its_limit_after_a_least_way(stiffest, limit, rest_segment):
    [spring] = friction.springs(np.array([stiffest]), np.array([limit]), np.array([rest_segment]))
    assert 0.0 < spring <= stiffest
    if limit > 0.0:
        assert limit / spring >= (1.0 - 1e-12) * friction.LEAST_REACH * rest_segment
    else:
        assert spring == stiffest


@pytest.mark.parametrize(("law", "some"), [("isotropic", True), ("box", False)])
def test_the_law_is_chosen_for_points_on_which_two_yarns_slide(law, some):
    stack = random_stack(0)
    p = stack.potential(replace(SETTINGS, friction_law=law))
    model = stack.model
    assert (len(p.rubbing) > 0) == some
    assert (model.point_nodes[p.rubbing] >= 0).all() and not model.u_fixed[model.point_nodes[p.rubbing]].any()
    shared = np.sort(np.concatenate([p.sliding_alone, model.point_nodes[p.rubbing].ravel()]))
    np.testing.assert_array_equal(shared, p.sliding)
    np.testing.assert_allclose(np.linalg.norm(p.slope[model.point_nodes[p.rubbing]], axis=2) > 0.1, True)
