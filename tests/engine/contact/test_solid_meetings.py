"""Meetings of strands with solids that rest, move and turn: none is missing, against dense samples of way and edge."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine.contact.obstacles import ObstacleKind, Obstacles, motion
from engine.contact.solid_meetings import DEEP, at_vertices, within_edges
from engine.contact.surface import Surface, packed, sampled
from engine.geometry.handles import Handles
from engine.geometry.solids import distance_to, moved_along

RADIUS, VERTICES = 0.05, 6
TIMES, SHARES = np.linspace(0.0, 1.0, 101), np.linspace(0.0, 1.0, 41)
NONE_KNOWN = np.zeros(VERTICES, np.int64)
MESH = trimesh.creation.icosphere(subdivisions=3, radius=0.4)
BALL = sampled(Surface(np.asarray(MESH.vertices), np.asarray(MESH.faces)), spacing=0.05, margin=0.3)


def moving_solid(rng, kind: ObstacleKind, moves: bool):
    """How a solid about the origin moves in a step, which may shift and turn it."""
    size = BALL.size if kind == ObstacleKind.MESH else rng.uniform(0.2, 0.5, 3)
    angles, offset = moves * rng.uniform(-40.0, 40.0, 3), moves * rng.normal(scale=0.3, size=3)
    handles = Handles(np.array([0, 2]), np.array([0.0, 1.0]), np.array([np.zeros(3), offset]), np.array([np.zeros(3), angles]),
                      rng.normal(scale=0.3, size=(1, 3)))
    solid = Obstacles(np.array([kind]), np.zeros((1, 3)), Rotation.random(rng=rng).as_matrix()[None], size[None], np.zeros(1),
                      np.zeros(1, np.int64), packed([BALL]) if kind == ObstacleKind.MESH else None)
    return motion(solid, handles, 0.0, 1.0)


def distances(solids, places):
    """Distances of places [..., 3] to the solid."""
    normal = np.empty(3)
    return np.array([distance_to(solids, 0, place, normal) for place in places.reshape(-1, 3)]).reshape(places.shape[:-1])


def samples(solids, there, way):
    """Distances at all times and shares of the edges of a strand as seen from a solid, shape [times, shares, edges]."""
    places = there + TIMES[:, None, None] * way
    shares = SHARES[:, None, None]
    return distances(solids, (1 - shares) * places[:, None, :-1] + shares * places[:, None, 1:])


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("kind", ObstacleKind)
@settings(deadline=None, max_examples=15)  # the first example compiles
@given(seed=st.integers(0, 2**32 - 1), speed=st.sampled_from([0.1, 1.0, 10.0]))
def test_no_place_comes_into_a_solid_without_a_contact_beside_it(kind, moves, seed, speed):
    rng = np.random.default_rng(seed)
    moved = moving_solid(rng, kind, moves)
    x = rng.normal(scale=0.8, size=3) + np.cumsum(rng.normal(scale=0.3, size=(VERTICES, 3)), axis=0)
    there = moved_along(moved.begin, moved.end, 0, x)
    np.testing.assert_allclose(distances(moved.end, there), distances(moved.begin, x), atol=1e-12)
    way = x + speed * rng.normal(size=3) + 0.3 * rng.normal(size=x.shape) - there
    radius = np.full(VERTICES, RADIUS)
    vertex, time, normal, distance, before = at_vertices(moved.end, 0, there, way, radius, 1.05 * radius, NONE_KNOWN)
    edges = np.arange(VERTICES - 1)
    edge, share, *within = within_edges(moved.end, 0, there, way, radius, 1.05 * radius, edges, NONE_KNOWN)
    least = samples(moved.end, there, way).min(axis=0)  # of every place on its way
    at_ends = np.append(least[0], least[-1, -1])
    seen = in_grid(moved.end, there) if kind == ObstacleKind.MESH else np.ones(VERTICES, np.bool_)
    assert set(np.flatnonzero((at_ends < 0.99 * RADIUS) & seen)) <= set(vertex)
    for e in np.flatnonzero((least.min(axis=0) < 0.9 * RADIUS) & seen[:-1] & seen[1:]):
        assert {e, e + 1} & set(vertex) or e in edge
    for v, t, n, d, b in zip(vertex, time, normal, distance, before, strict=True):
        assert np.linalg.norm(n) == pytest.approx(1.0)
        assert distances(moved.end, there[v] + t * way[v]) == pytest.approx(d)
        assert distances(moved.end, there[v]) == pytest.approx(b)
    for e, s, t, d in zip(edge, share, within[0], within[2], strict=True):
        place = (1 - s) * (there[e] + t * way[e]) + s * (there[e + 1] + t * way[e + 1])
        assert 0.0 < s < 1.0 and distances(moved.end, place) == pytest.approx(d, abs=1e-9)


def in_grid(solids, places):
    """Which places [n, 3] are on the grid of samples."""
    return (np.abs((places - solids.centre[0]) @ solids.rotation[0]) < 0.95 * solids.size[0]).all(axis=1)


def test_what_comes_from_beyond_the_grid_of_a_mesh_is_found():
    """A distance that falls by more than what a place moves is not one to advance by; here one is passed over."""
    rng = np.random.default_rng(4450689)
    moved = moving_solid(rng, ObstacleKind.MESH, moves=True)
    x = rng.normal(scale=0.8, size=3) + np.cumsum(rng.normal(scale=0.3, size=(VERTICES, 3)), axis=0)
    there = moved_along(moved.begin, moved.end, 0, x)
    way = x + rng.normal(size=3) + 0.3 * rng.normal(size=x.shape) - there
    assert distances(moved.end, there + way)[2] < 0.0 and not in_grid(moved.end, there)[2]
    radius = np.full(VERTICES, RADIUS)
    assert 2 in at_vertices(moved.end, 0, there, way, radius, 1.05 * radius, NONE_KNOWN)[0]


def rail():
    """A cylinder along y, thinner than an edge of the strand is long."""
    lying = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    solid = Obstacles(np.array([ObstacleKind.CYLINDER]), np.zeros((1, 3)), lying[None], np.array([[0.1, 5.0, 0.0]]), np.zeros(1),
                      np.zeros(1, np.int64))
    return motion(solid, Handles(np.array([0, 1]), np.zeros(1), np.zeros((1, 3))), 0.0, 1.0).end


def over_rail(height: float, fall: float, known: int = 0):
    x = np.array([[-1.0, 0, height], [0.6, 0, height]])
    radius = np.full(2, RADIUS)
    way = np.tile([0.0, 0.0, -fall], (2, 1))
    return within_edges(rail(), 0, x, way, radius, 1.05 * radius, np.array([0]), np.array([known, 0]))


def test_an_edge_meets_a_rail_between_its_vertices():
    edge, share, time, normal, distance, before = over_rail(0.35, 1.0)
    np.testing.assert_array_equal(edge, [0])
    np.testing.assert_allclose(share, 1.0 / 1.6, atol=1e-3)
    np.testing.assert_allclose(normal, [[0.0, 0.0, 1.0]], atol=1e-2)
    assert time[0] == pytest.approx(0.2, abs=1e-3) and before[0] == pytest.approx(0.25)
    assert RADIUS <= distance[0] <= 1.01 * RADIUS


def test_an_edge_whose_vertex_touches_a_rail_first_is_found_where_it_follows():
    x = np.array([[-1.65, 0, 0.151], [-0.05, 0, 0.151]])
    way, radius, none = np.tile([0.8, 0.0, -0.1], (2, 1)), np.full(2, RADIUS), np.zeros(2, np.int64)
    vertex, first, *_ = at_vertices(rail(), 0, x, way, radius, radius, none)
    np.testing.assert_array_equal(vertex, [1])
    edge, share, time, normal, _, before = within_edges(rail(), 0, x, way, radius, radius, np.array([0]), none)
    np.testing.assert_array_equal(edge, [0])
    assert first[0] < time[0] == 1.0 and before[0] > RADIUS
    np.testing.assert_allclose(share, 0.85 / 1.6, atol=1e-3)
    np.testing.assert_allclose(normal, [[0.0, 0.0, 1.0]], atol=1e-2)


def test_a_place_deep_inside_is_found_again_only_where_it_gets_deeper():
    assert not len(over_rail(0.05, 0.0005, known=1)[0])
    _, _, time, *_ = over_rail(0.05, 0.002, known=1)
    np.testing.assert_array_equal(time, [1.0])


def test_a_vertex_goes_through_a_rail_in_one_step_and_is_found():
    x, way = np.array([[0.01, 0.0, 40.0]]), np.array([[0.0, 0.0, -80.0]])
    one = np.full(1, RADIUS)
    vertex, time, _, distance, _ = at_vertices(rail(), 0, x, way, one, one, np.zeros(1, np.int64))
    np.testing.assert_array_equal(vertex, [0])
    assert time[0] == pytest.approx((40.0 - 0.15) / 80.0, abs=1e-4) and distance[0] <= 1.01 * RADIUS


@pytest.mark.parametrize("known", range(4))
def test_known_contacts_are_found_again_where_they_end_too_near_or_are_passed(known):
    assert len(over_rail(0.35, 0.2004, known)[0]) == (known == 0)
    _, _, time, *_ = over_rail(0.35, 0.21, known)
    np.testing.assert_allclose(time, 1.0 if known else 0.2 / 0.21, atol=0.01)
    _, _, time, *_ = over_rail(0.35, 1.0, known)
    assert len(time) == 1
    if known:
        assert (0.25 - time[0]) / RADIUS == pytest.approx(DEEP, abs=0.02)


def test_a_straight_edge_along_a_plane_has_contacts_at_its_vertices_only():
    plane = motion(Obstacles(np.array([ObstacleKind.PLANE]), np.zeros((1, 3)), np.eye(3)[None], np.ones((1, 3)), np.zeros(1)),
                   Handles(np.zeros(1, np.int64), np.zeros(0), np.zeros((0, 3))), 0.0, 1.0).end
    x = np.array([[0.0, 0, 0.2], [1.0, 0, 0.2], [2.0, 0, 0.2]])
    way, radius, none = np.tile([0.0, 0.0, -1.0], (3, 1)), np.full(3, RADIUS), np.zeros(3, np.int64)
    np.testing.assert_array_equal(at_vertices(plane, 0, x, way, radius, radius, none)[0], [0, 1, 2])
    assert not len(within_edges(plane, 0, x, way, radius, radius, np.array([0, 1]), none)[0])
