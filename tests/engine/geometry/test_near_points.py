"""Points near each other: as all pairs one by one say, wherever space repeats."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.geometry.near_points import near_points
from tests.engine.threads import on_one_and_two_threads

periods = st.tuples(*[st.sampled_from([0, 3, 7])] * 3)  # in what the widest two reach


def reference(x, asked, reach, period):
    """The neighbours of each point, one by one."""
    near = [set() for _ in x]
    for i in np.flatnonzero(asked):
        for j in range(len(x)):
            r = x[i] - x[j]
            r = [d - p * round(d / p) if p > 0.0 else d for d, p in zip(r, period, strict=True)]
            if i != j and np.dot(r, r) <= (reach[i] + reach[j]) ** 2:
                near[i].add(j)
    return near


@settings(deadline=None, max_examples=60)  # the first example compiles
@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.sampled_from([0.05, 0.25, 1.0]), periods)
def test_neighbours_are_those_of_all_pairs(seed, count, widest, cells):
    rng = np.random.default_rng(seed)
    x, asked = rng.uniform(-4.0, 4.0, (count, 3)), rng.random(count) < 0.7
    x[rng.random(count) < 0.2] = 1.5  # some at one place
    reach = widest * rng.uniform(0.0, 1.0, count)
    period = 2.02 * widest * np.array(cells)
    start, near = near_points(x, asked, reach, period)
    found = [near[a:b] for a, b in pairwise(start)]
    assert all(len(set(points)) == len(points) for points in found)
    assert [set(points.tolist()) for points in found] == reference(x, asked, reach, period)


def test_a_period_that_is_too_short_is_refused():
    with pytest.raises(ValueError, match="less than three times"):
        near_points(np.zeros((2, 3)), np.ones(2, bool), np.full(2, 0.5), np.array([0.0, 2.9, 0.0]))


def test_any_number_of_threads_finds_the_same_in_the_same_order():
    rng = np.random.default_rng(1)
    x, reach = rng.random((20_000, 3)), np.full(20_000, 0.025)
    one, two = on_one_and_two_threads(lambda: near_points(x, np.ones(len(x), bool), reach, np.array([1.0, 0.0, 1.0])))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a, b)
