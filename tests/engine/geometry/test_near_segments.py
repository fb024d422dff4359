"""Pairs of segments that come near each other: none is missing, against all pairs one by one."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.geometry.near_segments import NearSegments, near_pairs
from engine.geometry.segment_distance import nearest_on_segments

TIMES = np.linspace(0.0, 1.0, 21)


def lines(rng, count: int, length: float):
    """Vertices of random lines, and the first vertices of their segments."""
    sizes = rng.integers(2, 6, count)
    parts = [rng.normal(size=3) + np.cumsum(rng.normal(scale=length, size=(n, 3)), axis=0) for n in sizes]
    last = np.cumsum(sizes) - 1
    return np.concatenate(parts), np.setdiff1d(np.arange(sizes.sum()), last)


@settings(deadline=None, max_examples=60)  # the first example compiles
@given(st.integers(0, 2**32 - 1), st.integers(1, 8), st.sampled_from([0.01, 0.3, 3.0]), st.sampled_from([0.0, 0.1, 5.0]))
def test_no_pair_is_missing(seed, count, length, speed):
    rng = np.random.default_rng(seed)
    x, segment = lines(rng, count, length)
    motion, reach = speed * rng.normal(size=x.shape), rng.uniform(0.0, 0.2, len(segment))
    found = near_pairs(x, motion, segment, reach)
    pairs = {(int(a), int(b)) for a, b in found}
    assert len(pairs) == len(found) and sorted(pairs) == [tuple(pair) for pair in found.tolist()]
    assert all(a < b for a, b in pairs)
    for i, j in combinations(range(len(segment)), 2):
        a, b = segment[i], segment[j]
        near = any(nearest_on_segments(*(x + t * motion)[[a, a + 1, b, b + 1]])[2] < (reach[i] + reach[j]) ** 2 for t in TIMES)
        assert not near or (i, j) in pairs


def test_what_is_far_is_left_out():
    x = np.array([[0.0, 0, 0], [1.0, 0, 0], [0.0, 50.0, 0], [1.0, 50.0, 0], [0.0, 0.05, 0], [1.0, 0.05, 0]])
    found = near_pairs(x, np.zeros_like(x), np.array([0, 2, 4]), np.full(3, 0.1))
    np.testing.assert_array_equal(found, [[0, 2]])


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_have_no_pairs(count):
    x = np.zeros((2, 3))
    assert near_pairs(x, x, np.arange(count), np.ones(count)).shape == (0, 2)


def test_one_that_is_a_thousand_times_longer_is_found_all_along():
    rng = np.random.default_rng(0)
    x = np.zeros((202, 3))
    x[:2] = [-500.0, 0, 0], [500.0, 0.3, 0.2]
    x[2::2, 0] = x[3::2, 0] = rng.uniform(-400, 400, 100)
    x[2::2, 1], x[3::2, 1] = -0.5, 0.5
    segment = np.arange(0, len(x), 2)
    found = near_pairs(x, np.zeros_like(x), segment, np.full(len(segment), 0.2))
    assert {(0, j) for j in range(1, len(segment))} <= {tuple(pair) for pair in found.tolist()}


def all_of(found):
    return {tuple(pair) for pair in found.tolist()}


def test_what_is_found_for_a_way_serves_ways_about_it_and_the_start():
    rng = np.random.default_rng(3)
    x, segment = lines(rng, 8, 0.3)
    motion, reach, margin = rng.normal(size=x.shape), np.full(len(segment), 0.1), 0.05
    near = NearSegments(segment, reach, margin)
    near.look_ahead(x, motion)
    found = near.pairs
    drift = np.array([5.0, 0.0, 0.0])  # of all of them alike
    off = rng.normal(size=x.shape)
    off *= 0.4 * margin / np.linalg.norm(off, axis=1).max()
    for way in (motion, np.zeros_like(x), motion + off, motion + drift):
        assert near.along(x, way) is found
        assert all_of(near_pairs(x, way, segment, reach)) <= all_of(found)
    assert near.along(x, motion * 1.5) is not found
    assert near.along(x + 1e-9, np.zeros_like(x)) is not found


def test_there_is_room_for_more_pairs_than_expected():
    x = np.zeros((120, 3))
    x[1::2, 0] = 1.0
    x[:, 1] = np.repeat(np.linspace(0.0, 0.01, 60), 2)
    segment = np.arange(0, 120, 2)
    found = near_pairs(x, np.zeros_like(x), segment, np.full(60, 0.1))
    np.testing.assert_array_equal(found, np.array(list(combinations(range(60), 2))))
