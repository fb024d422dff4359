"""Grooms: where roots lie, how evenly, and the ways that strands take from there."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from engine.scene.groom import APART, LEAST_RISE, at_even_distances, grown
from engine.scene.schema import Box, Cylinder, Mesh, Sphere
from engine.scene.strand_groups import Groom
from engine.scene.surfaces import ground, roots, spread

TURN, PLACE = (10.0, 20.0, 30.0), (0.1, 0.2, 0.3)
FRAME = Rotation.from_euler("xyz", TURN, degrees=True)
SOLID = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
BODIES = {
    "sphere": Sphere(shape="sphere", radius=0.1, position=PLACE, rotation=TURN),
    "cylinder": Cylinder(shape="cylinder", radius=0.05, height=0.2, position=PLACE, rotation=TURN),
    "box": Box(shape="box", size=(0.1, 0.2, 0.3), position=PLACE, rotation=TURN),
    "mesh": Mesh(shape="mesh", vertices=SOLID.vertices.tolist(), faces=SOLID.faces.tolist(), position=PLACE, rotation=TURN),
}
AREAS = {"sphere": 4 * np.pi * 0.01, "cylinder": 2 * np.pi * 0.05 * 0.2, "box": 0.22, "mesh": SOLID.area}


def of(**parts) -> Groom:
    return Groom(**{"on": "body", "count": 300, "length": 0.1} | parts)


def flat(**parts) -> Groom:
    return of(on=None, rectangle=(0.1, 0.05), **parts)


def rooted(groom, body=None, seed=0):
    return roots(groom, body, np.random.default_rng(seed))


def lengths(strands):
    return np.linalg.norm(np.diff(strands, axis=1), axis=2)


def outside(name, x):
    """Distances of places in the body's own frame from its surface."""
    if name == "sphere":
        return np.linalg.norm(x, axis=1) - 0.1
    if name == "cylinder":
        assert np.abs(x[:, 2]).max() <= 0.1 + 1e-12
        return np.hypot(x[:, 0], x[:, 1]) - 0.05
    if name == "box":
        return (np.abs(x) - [0.05, 0.1, 0.15]).max(axis=1)
    return np.einsum("nfk,fk->nf", x[:, None] - SOLID.triangles[:, 0], SOLID.face_normals).max(axis=1)  # it is convex


@pytest.mark.parametrize("name", BODIES)
def test_roots_lie_on_the_surface_and_normals_point_out(name):
    places, normals = rooted(of(), BODIES[name])
    assert places.shape == normals.shape == (300, 3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    local = FRAME.inv().apply(places - np.array(PLACE))
    np.testing.assert_allclose(outside(name, local), 0.0, atol=1e-9)
    assert (np.einsum("nk,nk->n", normals, places - np.array(PLACE)) > 0.0).all()


@pytest.mark.parametrize("name", BODIES)
def test_roots_are_spread_evenly(name):
    """No two are nearer than six tenths of what the densest of all grids would have, and none has no near neighbour."""
    places, _ = rooted(of(count=400), BODIES[name])
    nearest = cKDTree(places).query(places, k=2)[0][:, 1]
    densest = np.sqrt(2.0 / np.sqrt(3.0) * AREAS[name] / 400)
    assert nearest.min() > 0.6 * densest and nearest.max() < 1.5 * densest


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("facing, within", [((0.0, 0.0, 1.0), 50.0), ((1.0, 1.0, 0.0), 120.0)])
def test_roots_lie_only_where_the_surface_faces(name, facing, within):
    groom = of(facing=facing, within=within)
    if ground(groom, BODIES[name]) is not None:
        _, normals = rooted(groom, BODIES[name])
        assert (normals @ facing / np.linalg.norm(facing) > np.cos(np.radians(within)) - 1e-9).all()


def test_one_side_of_a_box_is_no_other():
    _, normals = rooted(of(facing=FRAME.apply([0, 0, -1]).tolist()), BODIES["box"])
    np.testing.assert_allclose(FRAME.inv().apply(normals), np.tile([0, 0, -1], (300, 1)), atol=1e-12)


@settings(max_examples=20, deadline=None)
@given(within=st.floats(1e-3, 180.0), facing=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda way: np.linalg.norm(way) > 1e-3))
def test_any_cap_of_a_ball_has_a_ground(within, facing):
    places, normals = rooted(of(count=20, facing=facing, within=within), BODIES["sphere"])
    assert np.isfinite(places).all()
    assert (normals @ facing / np.linalg.norm(facing) >= np.cos(np.radians(within)) - 1e-9).all()


def test_thinning_keeps_what_it_should():
    places = np.random.default_rng(1).random((200, 3))
    np.testing.assert_array_equal(spread(places, 200), np.arange(200))
    for count in (1, 2, 150):
        kept = spread(places, count)
        assert len(kept) == count and (np.diff(kept) > 0).all()
    assert len(spread(np.zeros((50, 3)), 7)) == 7, "places that coincide"


def test_the_seed_says_all_that_is_random():
    groom = flat(length_spread=0.3)
    one, same, other = (grown(g, None, 8, 1e-5) for g in (groom, groom.model_copy(), groom.model_copy(update={"seed": 1})))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other) and not one.flags.writeable


def test_strands_stand_upright_by_default():
    strands = grown(of(count=50), BODIES["sphere"], 5, 1e-5)
    _, normals = rooted(of(count=50), BODIES["sphere"])
    np.testing.assert_allclose(lengths(strands), 0.1 / 4)
    np.testing.assert_allclose(np.diff(strands, axis=1)[:, 0] / 0.025, normals, atol=1e-9)


@pytest.mark.parametrize("lean", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("direction", [(0.0, 0.0, -1.0), (1.0, 0.0, 0.0)])
def test_combed_strands_rise_from_the_surface(lean, direction):
    groom = of(direction=direction, lean=lean, count=200)
    strands = grown(groom, BODIES["sphere"], 4, 1e-5)
    _, normals = rooted(groom, BODIES["sphere"])
    way = np.diff(strands, axis=1)[:, 0] / lengths(strands)[:, :1]
    assert (np.einsum("nk,nk->n", way, normals) > LEAST_RISE - 1e-9).all()
    assert (np.linalg.norm(strands[:, 1:] - np.array(PLACE), axis=2) > 0.1).all(), "a ball has no strands in it"
    if lean == 1.0:
        assert np.median(way @ direction) > 0.3


def test_a_strand_combed_straight_against_its_ground_stands():
    strands = grown(flat(direction=(0.0, 0.0, -1.0), lean=1.0), None, 4, 1e-5)
    np.testing.assert_allclose(strands[:, -1] - strands[:, 0], np.tile([0, 0, 0.1], (300, 1)), atol=1e-12)


def test_lengths_are_spread():
    total = lengths(grown(flat(length_spread=0.2), None, 6, 1e-5)).sum(axis=1)
    assert 0.08 <= total.min() < 0.084 and 0.116 < total.max() <= 0.12 + 1e-12


def test_curls_are_helices_of_the_length_that_is_asked_for():
    strands = grown(flat(curl={"radius": 0.004, "pitch": 0.01}, count=20), None, 200, 1e-5)
    assert lengths(strands).sum(axis=1) == pytest.approx(0.1, rel=2e-3)
    np.testing.assert_allclose(lengths(strands), 0.1 / 199, rtol=1e-2)
    off = np.linalg.norm((strands - strands[:, :1])[:, :, :2], axis=2)
    late = strands[:, :, 2] > 0.01
    np.testing.assert_allclose(off[late], 0.004, rtol=2e-2)
    # all turn alike: they are one strand, shifted
    np.testing.assert_allclose(strands - strands[:, :1], np.broadcast_to(strands[0] - strands[0, 0], strands.shape), atol=1e-12)


@pytest.mark.parametrize("name", BODIES)
def test_curls_wind_about_any_way(name):
    strands = grown(of(curl={"radius": 0.004, "pitch": 0.01}), BODIES[name], 100, 1e-5)
    assert np.isfinite(strands).all() and lengths(strands).min() > 0.0


def test_tufts_draw_tips_together():
    loose, tufted = (grown(flat(clump=clump), None, 8, 1e-5) for clump in (None, {"count": 12, "strength": 0.8}))
    np.testing.assert_allclose(tufted[:, 0], loose[:, 0])
    np.testing.assert_allclose(lengths(tufted).sum(axis=1), 0.1, rtol=1e-3)
    near = [np.median(cKDTree(strands[:, -1]).query(strands[:, -1], k=2)[0][:, 1]) for strands in (loose, tufted)]
    assert near[1] < 0.3 * near[0]


def test_strands_in_a_tuft_keep_apart_by_their_thickness():
    radius = 5e-4
    tips = grown(flat(clump={"count": 1, "strength": 1.0}), None, 8, radius)[:, -1]
    roots_apart = cKDTree(rooted(flat())[0])
    nearest = cKDTree(tips).query(tips, k=2)[0][:, 1].min()
    assert roots_apart.query(roots_apart.data, k=2)[0][:, 1].min() > 2 * APART * radius, "there was room"
    assert nearest > 2 * radius


def test_tufts_of_opposite_ways_have_edges():
    strands = grown(of(clump={"count": 1, "strength": 1.0}), BODIES["sphere"], 10, 1e-5)
    assert np.isfinite(strands).all() and lengths(strands).min() > 1e-6


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 100), count=st.integers(2, 40))
def test_places_at_even_distances(seed, count):
    line = np.cumsum(np.random.default_rng(seed).normal(size=(6, 3)), axis=0)
    places = at_even_distances(line, count)
    np.testing.assert_allclose(places[[0, -1]], line[[0, -1]])
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() <= np.linalg.norm(np.diff(line, axis=0), axis=1).sum() / (
        count - 1) + 1e-12
