"""Distances of segments and of lines, against brute force."""

from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.geometry.segment_distance import nearest_on_segments, walk_to_nearest

PLACE = st.tuples(*[st.integers(-4, 4)] * 3).map(lambda p: np.array(p, float))


def reference_square(a, b, c, d):
    """The squared distance: inside both segments, or from one of four ends to the other segment."""

    def to_segment(p, q, r):
        along, length = (p - q) @ (r - q), (r - q) @ (r - q)
        share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
        return np.sum((p - q - share * (r - q)) ** 2)

    found = [to_segment(a, c, d), to_segment(b, c, d), to_segment(c, a, b), to_segment(d, a, b)]
    normal = np.cross(b - a, d - c)
    if normal.any():
        st, *_ = np.linalg.lstsq(np.column_stack([b - a, c - d, normal]), c - a, rcond=None)
        if 0.0 <= st[0] <= 1.0 and 0.0 <= st[1] <= 1.0:
            found.append(st[2] ** 2 * (normal @ normal))
    return min(found)


@settings(deadline=None)
@given(PLACE, PLACE, PLACE, PLACE)
def test_no_places_are_nearer(a, b, c, d):
    s, t, square = nearest_on_segments(a, b, c, d)
    assert 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0
    np.testing.assert_allclose(np.sum((a + s * (b - a) - c - t * (d - c)) ** 2), square, atol=1e-12)
    np.testing.assert_allclose(square, reference_square(a, b, c, d), rtol=1e-9, atol=1e-9)


@settings(deadline=None)
@given(st.integers(0, 2**31), st.integers(2, 12), st.integers(2, 12), st.floats(0.4, 2.7), st.data())
def test_the_walk_ends_at_the_nearest_places_of_lines_that_bend_little(seed, m, n, angle, data):
    rng = np.random.default_rng(seed)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    lines = []
    for count in (m, n):
        line = np.zeros((count, 3))
        line[:, 0] = np.cumsum(rng.uniform(0.3, 1.7, count))
        lines.append(line - [rng.uniform(0.0, line[-1, 0]), 0.0, 0.0] + rng.normal(scale=0.01, size=(count, 3)))
    x = np.concatenate([lines[0], lines[1] @ turn.T + [0.0, 0.0, rng.uniform(-0.1, 0.1)]])
    first, second = np.arange(m), m + np.arange(n)
    start = data.draw(st.integers(0, m - 2)), data.draw(st.integers(0, n - 2))
    i, j, s, t, square = walk_to_nearest(first, second, x, *start)
    every = [reference_square(x[a], x[a + 1], x[m + b], x[m + b + 1]) for a, b in product(range(m - 1), range(n - 1))]
    between = x[i] + s * (x[i + 1] - x[i]) - x[m + j] - t * (x[m + j + 1] - x[m + j])
    np.testing.assert_allclose([between @ between, square], min(every), rtol=1e-9, atol=1e-12)
