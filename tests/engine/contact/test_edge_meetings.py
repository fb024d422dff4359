"""Meetings of edges: near at the start or touching on the way, and who has the contact."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.contact.edge_meetings import DEEP, LEVEL, LOOP, _middle, beside, find, length_beside
from engine.geometry.segment_distance import nearest_on_segments

RADIUS, NEAR = 0.05, 0.055
CROSS = np.array([[-1.0, 0, 0], [1.0, 0, 0], [0.2, -1.0, 0.5], [0.2, 1.0, 0.5]])
TWO = np.array([0, 0, 1, 1])


def meetings(x, motion, pairs=((0, 2),), strand=TWO, known=()):
    """Edges, shares, times and distances at the start of meetings."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))])
    keys = np.sort(np.array([(a << 32) + b for a, b in known], np.int64))
    return find(np.array(pairs), x, motion, np.full(len(x), RADIUS), np.full(len(x), NEAR), strand, along, keys)


def falling(depth: float):
    """The second edge of CROSS comes down."""
    return np.where(TWO[:, None] == 1, [0.0, 0.0, -depth], 0.0)


def test_edges_meet_where_and_when_they_touch():
    edge, share, time, before = meetings(CROSS, falling(1.0))
    np.testing.assert_array_equal(edge, [[0, 2]])
    np.testing.assert_allclose(share, [[0.6, 0.5]])
    assert 0.399 <= time[0] <= 0.4 and before[0] == pytest.approx(0.5)


def test_edges_that_stay_away_do_not_meet():
    assert not len(meetings(CROSS, falling(0.39))[0])
    assert not len(meetings(CROSS, np.full((4, 3), -10.0))[0])


@pytest.mark.parametrize(
    ("depth", "times"), [(0.0, [0.0]), (0.0008, [0.0]), (0.008, [0.0, 1.0]), (0.2, [0.0, 0.05]), (-1.0, [0.0])])
def test_edges_that_are_near_meet_at_once_and_again_where_they_come_nearer(depth, times):
    near = CROSS - np.where(TWO[:, None] == 1, [0.0, 0.0, 0.4], 0.0)
    edge, _, time, before = meetings(near, falling(depth))
    np.testing.assert_array_equal(edge, [[0, 2]] * len(times))
    np.testing.assert_allclose(time, times, atol=0.01)
    np.testing.assert_allclose(before, 0.1)


@pytest.mark.parametrize("contacts", range(4))
def test_known_contacts_are_found_again_where_they_end_too_near_or_are_passed(contacts):
    known = [(0, 2)] * contacts + [(0, 3), (1, 2)]
    assert len(meetings(CROSS, falling(0.4008), known=known)[0]) == (contacts == 0)
    nearer = meetings(CROSS, falling(0.408), known=known)
    np.testing.assert_allclose(nearer[2], 1.0 if contacts else 0.4 / 0.408, atol=0.01)
    through = meetings(CROSS, falling(1.0), known=known)
    assert len(through[0]) == 1
    if contacts:
        assert (0.5 - through[2][0]) / (2 * RADIUS) == pytest.approx(DEEP, rel=0.02)


@settings(deadline=None)  # the first example compiles
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, 30.0]))
def test_all_that_come_near_meet(seed, speed):
    """Single edges, so that no other one can have the contact, against dense samples."""
    rng = np.random.default_rng(seed)
    x, motion = rng.normal(size=(4, 3)), speed * rng.normal(size=(4, 3))
    edge, share, time, _ = meetings(x, motion)
    samples = [nearest_on_segments(*(x + t * motion))[2] for t in np.linspace(0.0, 1.0, 201)]
    if np.sqrt(min(samples)) < 2 * RADIUS:
        assert len(edge)
    for (s, t), when in zip(share, time, strict=True):
        a, b, c, d = x + when * motion
        distance = np.linalg.norm((1 - s) * a + s * b - (1 - t) * c - t * d)
        assert distance <= 2 * NEAR * (1 + 1e-9) or speed > 1.0  # the fast count as near where they graze each other


def test_a_strand_that_folds_back_meets_itself_beyond_a_loop_only():
    """Edges 0 and 2 lie side by side, apart by edge 1, which is shorter or longer than half a turn at that distance."""
    for length, meets in ((0.99 * LOOP * 2 * RADIUS, False), (1.01 * LOOP * 2 * RADIUS, True)):
        up = np.sqrt(length**2 - (2 * RADIUS) ** 2)
        x = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0 + up, 2 * RADIUS, 0], [0.5, 2 * RADIUS, 0]])
        assert (len(meetings(x, 0 * x, strand=np.zeros(4, np.int64))[0]) > 0) == meets


def test_a_vertex_between_two_edges_has_one_contact():
    """Which is that of the edge that begins there; at the end of a strand it is that of the last edge."""
    x = np.array([[-1.0, 0, -1.0], [0.0, 0, 0], [1.0, 0, -1.0], [0.0, -1.0, 0.1], [0.0, 1.0, 0.1]])
    strand = np.array([0, 0, 0, 1, 1])
    edge, share, *_ = meetings(x, 0 * x, pairs=((0, 3), (1, 3)), strand=strand)
    np.testing.assert_array_equal(edge, [[1, 3]])
    np.testing.assert_allclose(share, [[0.0, 0.5]])
    edge, share, *_ = meetings(x[[0, 1, 3, 4]], np.zeros((4, 3)))
    np.testing.assert_array_equal(edge, [[0, 2]])
    np.testing.assert_allclose(share, [[1.0, 0.5]])


def test_what_goes_round_a_vertex_and_through_the_edge_before_it_is_not_passed_over():
    """The other edge touches edge 1 at the start, passes the vertex no nearer than DEEP, and goes through edge 0."""
    x = np.array([[-1.0, 0, 0.5], [0.0, 0, 0], [1.0, 0, 0], [0.5, -1.0, 0.1], [0.5, 1.0, 0.1]])
    motion = np.array([[0.0, 0, 0]] * 3 + [[-1.0, 0, -0.06]] * 2)
    edge, *_ = meetings(x, motion, pairs=((0, 3), (1, 3)), strand=np.array([0, 0, 0, 1, 1]))
    assert [0, 3] in edge.tolist()


@pytest.mark.parametrize("overlap", [0.0, 0.002, -0.003])
@pytest.mark.parametrize("way", [-1.0, 1.0])
@pytest.mark.parametrize("upper_first", [False, True])
def test_what_slides_over_a_vertex_of_a_straight_strand_meets_nothing_that_leans(upper_first, way, overlap):
    """The edge ahead is nearest at the vertex until what slides is above it."""
    lower = np.array([[-1.0, 0, 0], [0.0, 0, 0], [1.0, 0, 0]])
    upper = np.array([[-0.02 * way, -1.0, 2 * RADIUS - overlap], [-0.02 * way, 1.0, 2 * RADIUS - overlap]])
    x = np.concatenate([upper, lower] if upper_first else [lower, upper])
    of_upper = np.isin(np.arange(5), (0, 1) if upper_first else (3, 4))
    pairs = ((0, 2), (0, 3)) if upper_first else ((0, 3), (1, 3))
    for far in (0.015, 0.06, 0.4):
        motion = np.where(of_upper[:, None], [far * way, 0.0, 0.0], 0.0)
        edge, share, time, _ = meetings(x, motion, pairs, of_upper.astype(np.int64))
        assert len(edge)
        for (a, b), (s, t), when in zip(edge, share, time, strict=True):
            there = x + when * motion
            apart = (1 - s) * there[a] + s * there[a + 1] - (1 - t) * there[b] - t * there[b + 1]
            np.testing.assert_allclose(apart / np.linalg.norm(apart), [0, 0, 1.0 if upper_first else -1.0], atol=1e-12)


def test_a_vertex_that_stands_out_of_its_strand_is_met():
    """Neither of its edges is nearer than the vertex, at which both begin or end."""
    x = np.array([[-1.0, 0, -1.0], [0.0, 0, 0], [1.0, 0, -1.0], [0.01, -1.0, 0.3], [0.01, 1.0, 0.3]])
    motion = np.where(np.arange(5)[:, None] > 2, [0.0, 0.0, -0.25], 0.0)
    edge, share, *_ = meetings(x, motion, ((0, 3), (1, 3)), np.array([0, 0, 0, 1, 1]))
    assert [1, 3] in edge.tolist()
    np.testing.assert_allclose(share[edge[:, 0] == 1, 0], 0.0)


def side_by_side(shift: float, tilt: float = 0.0):
    """Edge 0 of length 1, and one beside it at the distance of touch, from `shift` on, which climbs by `tilt`."""
    return np.array([[0.0, 0, 0], [1.0, 0, 0], [shift, 2 * RADIUS, 0], [shift + 1.0, 2 * RADIUS, tilt]])


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_an_edge_lies_beside_another_between_the_feet_of_its_ends(seed):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(4, 3))
    first, last = beside(x, 0, 2)
    feet = [nearest_on_segments(x[0], x[1], end, end)[0] for end in x[2:]]
    np.testing.assert_allclose([first, last], sorted(feet), atol=1e-12)
    length = (last - first) * np.linalg.norm(x[1] - x[0])
    np.testing.assert_allclose(length_beside(x, np.array([[0, 2]])), length)
    turned = x[[1, 0, 3, 2]]
    np.testing.assert_allclose(length_beside(turned, np.array([[0, 2]])), length, atol=1e-12)


@pytest.mark.parametrize("shift", [-1.5, -0.8, -0.25, 0.0, 0.3, 0.75, 1.2])
def test_edges_side_by_side_touch_in_the_middle_of_what_they_have_in_common(shift):
    x = side_by_side(shift)
    common = max(1.0 - abs(shift), 0.0)
    np.testing.assert_allclose(length_beside(x, np.array([[0, 2], [2, 0]])), common, atol=1e-12)
    edge, share, time, before = meetings(x, 0 * x)
    assert len(edge) == (common > 0.0)
    if common:
        middle = 0.5 * (max(shift, 0.0) + min(shift + 1.0, 1.0))
        np.testing.assert_allclose(share, [[middle, middle - shift]], atol=1e-12)
        assert (time[0], before[0]) == (0.0, pytest.approx(2 * RADIUS))


def test_edges_that_point_against_each_other_touch_in_the_middle_too():
    x = side_by_side(0.4)[[0, 1, 3, 2]]
    np.testing.assert_allclose(meetings(x, 0 * x)[1], [[0.7, 0.7]])


@pytest.mark.parametrize(("tilt", "middle"), [(0.0, True), (0.03, True), (0.035, False), (0.5, False)])
def test_edges_apart_at_an_end_touch_where_they_are_nearest(tilt, middle):
    """Only what is within LEVEL of the distance of touch all along is side by side."""
    x = side_by_side(0.0, tilt)
    s, t, square = nearest_on_segments(*x)
    at_end = np.hypot(2 * RADIUS, tilt)
    assert (at_end <= np.sqrt(square) + LEVEL * 2 * RADIUS) == middle
    wanted = (0.5, 0.5) if middle else (s, t)
    np.testing.assert_allclose(_middle(x, 0, 2, s, t, np.sqrt(square) + LEVEL * 2 * RADIUS), wanted, atol=1e-2)


def test_edges_that_cross_touch_where_they_cross():
    x = CROSS - np.where(TWO[:, None] == 1, [0.0, 0.0, 0.4], 0.0)
    np.testing.assert_allclose(meetings(x, 0 * x)[1], [[0.6, 0.5]])
    assert length_beside(x, np.array([[0, 2]]))[0] == pytest.approx(0.0, abs=1e-12)


def test_edges_that_cross_at_nearly_right_angles_touch_where_they_are_nearest():
    """The middle of what the feet of the second one's ends leave of the first is not where they cross."""
    x = np.array([[-1.0, 0, 0], [1.0, 0, 0], [-0.01, -0.4, 2 * RADIUS], [0.03, 1.2, 2 * RADIUS]])
    s, t, _ = nearest_on_segments(*x)
    np.testing.assert_allclose(meetings(x, 0 * x)[1], [[s, t]])


@pytest.mark.parametrize("noise", [0.0, 1e-12, 1e-4])
@pytest.mark.parametrize("shift", [0.0, 0.1, 0.5, 0.9])
def test_all_of_strands_side_by_side_is_in_contact_once(shift, noise):
    """What their pairs of edges have in common adds up to what strands have."""
    edges, rng = 5, np.random.default_rng(7)
    s = np.arange(edges + 1.0)
    x = np.concatenate([np.column_stack([s, 0 * s, 0 * s]), np.column_stack([s + shift, 0 * s + 2 * RADIUS, 0 * s])])
    x += noise * rng.normal(size=x.shape)
    pairs = [(a, b) for a in range(edges) for b in range(edges + 1, 2 * edges + 1)]
    edge, *_ = meetings(x, 0 * x, pairs, np.repeat([0, 1], edges + 1))
    assert length_beside(x, edge).sum() == pytest.approx(edges - shift, rel=1e-3)
    assert len(np.unique(edge, axis=0)) == len(edge)
