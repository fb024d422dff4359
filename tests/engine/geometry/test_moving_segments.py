"""Segments that move: nothing is passed over, against dense samples of the way."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.geometry.moving_segments import CLOSE, first_near
from engine.geometry.segment_distance import nearest_on_segments

SEEDS = st.integers(0, 2**32 - 1)
TIMES = np.linspace(0.0, 1.0, 401)


def distance_at(x, motion, time: float) -> float:
    return np.sqrt(nearest_on_segments(*(x + time * motion))[2])


@settings(deadline=None)  # the first example compiles
@given(SEEDS, st.floats(1e-3, 0.5), st.sampled_from([0.1, 1.0, 30.0]))
def test_nothing_is_passed_over(seed, distance, speed):
    rng = np.random.default_rng(seed)
    x, motion, ends = rng.normal(size=(4, 3)), speed * rng.normal(size=(4, 3)), np.empty((4, 3))
    time = first_near(x, motion, 0, 2, distance, ends)
    before = [t for t in TIMES if t < time]
    assert all(distance_at(x, motion, t) > distance for t in before)
    if np.isfinite(time) and distance > 0.02 * speed:  # else those that graze each other may count as near
        assert distance_at(x, motion, time) <= (1.0 + CLOSE) * distance * (1.0 + 1e-9)
        np.testing.assert_allclose(ends, x + time * motion)


@settings(deadline=None)
@given(SEEDS)
def test_segments_that_meet_are_found_however_thin(seed):
    rng = np.random.default_rng(seed)
    x, motion, shares = rng.normal(size=(4, 3)), rng.normal(size=(4, 3)), rng.random(2)
    weights = np.array([1.0 - shares[0], shares[0], shares[1] - 1.0, -shares[1]])
    meeting = rng.random()
    x[:2] -= weights @ (x + meeting * motion)
    assert distance_at(x, motion, meeting) < 1e-12
    assert first_near(x, motion, 0, 2, 1e-4, np.empty((4, 3))) <= meeting


def test_segments_that_move_alike_keep_their_distance():
    x = np.array([[0.0, 0, 0], [1.0, 0, 0], [0.5, -1.0, 1.0], [0.5, 1.0, 1.0]])
    motion = np.full((4, 3), 1e6)
    assert first_near(x, motion, 0, 2, 0.9, np.empty((4, 3))) == np.inf
    assert first_near(x, motion, 0, 2, 1.0, np.empty((4, 3))) == 0.0


@pytest.mark.parametrize("speed", [1.0, 100.0])
def test_the_time_is_that_at_which_they_touch(speed):
    x = np.array([[0.0, 0, 0], [1.0, 0, 0], [0.5, -1.0, 1.0], [0.5, 1.0, 1.0]])
    motion = np.array([[0.0, 0, 0], [0.0, 0, 0], [0.0, 0, -speed], [0.0, 0, -speed]])
    time = first_near(x, motion, 0, 2, 0.2, np.empty((4, 3)))
    assert 0.798 / speed <= time <= 0.8 / speed
