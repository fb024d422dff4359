"""Anchors of friction: what slides drags them along."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.yarns import friction

NUMBERS = st.floats(-10.0, 10.0)


@settings(deadline=None)
@given(u=NUMBERS, anchor=NUMBERS, spring=st.floats(0.1, 10.0), limit=st.floats(0.0, 10.0))
def test_the_force_of_a_dragged_anchor_is_that_of_the_step_within_the_limit(u, anchor, spring, limit):
    nodes, springs, limits = np.array([0]), np.array([spring]), np.array([limit])
    before, moved, place = np.array([anchor]), np.array([anchor]), np.array([u])
    gradient, still = np.zeros((1, 4)), np.zeros(1)
    friction.add_gradient(nodes, springs, limits, before, still, still, place, gradient)
    friction.drag_anchors(nodes, springs, limits, place, moved)
    force = spring * (u - moved[0])
    assert abs(force) <= limit * (1.0 + 1e-12) + 1e-12
    np.testing.assert_allclose(force, gradient[0, 3], atol=1e-11)
    if spring * abs(u - anchor) < limit:
        assert moved[0] == anchor  # what sticks does not creep
    friction.drag_anchors(nodes, springs, limits, place, before)
    np.testing.assert_array_equal(moved, before)


@settings(deadline=None)
@given(u=NUMBERS, u0=NUMBERS, hold=st.floats(0.0, 10.0))
def test_the_hold_acts_where_there_is_no_friction(u, u0, hold):
    gradient, none = np.zeros((1, 4)), np.zeros(1)
    energy = friction.add_gradient(
        np.array([0]), np.ones(1), none, none, np.array([hold]), np.array([u0]), np.array([u]), gradient)
    np.testing.assert_allclose(energy, 0.5 * hold * (u - u0) ** 2, atol=1e-12)
    np.testing.assert_allclose(gradient, [[0.0, 0.0, 0.0, hold * (u - u0)]], atol=1e-12)
