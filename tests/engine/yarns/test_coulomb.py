"""Coulomb's law for a slip in space: its potential is smooth, and its pull is the force over the limit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.yarns.coulomb import follow, huber


@settings(deadline=None)
@given(slip=st.floats(0.0, 10.0), spring=st.floats(0.1, 10.0), limit=st.floats(0.1, 10.0))
def test_the_force_is_the_slope_of_the_energy_and_never_above_the_limit(slip, spring, limit):
    energy, over_slip = huber(slip, spring, limit)
    step = 1e-6
    further, before = huber(slip + step, spring, limit)[0], huber(max(slip - step, 0.0), spring, limit)[0]
    assert (further - before) / (slip + step - max(slip - step, 0.0)) == pytest.approx(over_slip * slip, abs=1e-5)
    assert over_slip * slip <= limit * (1.0 + 1e-12) and energy >= 0.0


def test_nothing_that_may_not_be_held_is_held():
    assert huber(2.0, 1.0, 0.0) == (0.0, 0.0)
    assert huber(0.0, 1.0, 0.0)[0] == 0.0


@settings(deadline=None)
@given(s=st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array), reach=st.floats(1e-6, 2.0))
def test_the_pull_without_an_update_is_the_slip_over_the_larger_of_slip_and_reach(s, reach):
    pull, length = np.full(3, 0.3), np.linalg.norm(s)
    follow(s, np.zeros(3), length, reach, pull)
    np.testing.assert_allclose(pull, s / max(length, reach), atol=1e-12)
