"""Roots on bodies that change their shape: they stay on their triangles, and turn as these do."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine.contact.obstacles import ObstacleKind, Obstacles, motion, posed
from engine.contact.surface import Surface, packed, sampled
from engine.contact.surface_roots import follow, rooted
from engine.geometry.handles import Handles, no_handles
from engine.geometry.solids import distance_to, moved_along
from engine.strands.assembly import StrandAssembly, StrandMaterial

BALL = trimesh.creation.icosphere(subdivisions=1, radius=0.1)
SURFACE = Surface(np.array(BALL.vertices), np.array(BALL.faces))
HAIR = StrandMaterial(density=1300.0, young=3e9, shear=1e9)
LENGTH = 0.02
CHANGES = st.lists(st.floats(-0.3, 0.3), min_size=9, max_size=9).map(lambda e: np.eye(3) + np.reshape(e, (3, 3)))
TURNS = st.tuples(*[st.floats(-3, 3)] * 3)


def body(*later, faces=SURFACE.faces, turn=(0.0, 0.0, 0.0), place=(0.0, 0.0, 0.0)) -> Obstacles:
    """A ball that turns into its vertices `later`, one second after the other."""
    surface = Surface(SURFACE.vertices, faces)
    mesh = sampled(surface, 0.01, 0.01, [(1.0 + k, vertices) for k, vertices in enumerate(later)])
    rotation = Rotation.from_rotvec(turn).as_matrix()
    return Obstacles(np.array([ObstacleKind.MESH]), (np.array(place) + rotation @ mesh.middle)[None], rotation[None],
                     mesh.size[None], np.array([0.3]), surfaces=packed([mesh]))


def fur(obstacles: Obstacles):
    """A hair on the middle of every triangle, its root clamped, and what the body holds of it."""
    rotation, assembly = obstacles.rotation[0], StrandAssembly()
    held = np.zeros((3, 4), np.bool_)
    held[:2, :3] = held[0, 3] = True
    vertices = obstacles.surfaces.vertices(0, 0.0)
    for middle, normal in zip(vertices[SURFACE.faces].mean(axis=1), BALL.face_normals, strict=True):
        x = middle + LENGTH * np.array([[0.0], [0.5], [1.0]]) * normal
        assembly.strand(x @ rotation.T + obstacles.centre[0], 1e-4, HAIR, held=held)
    model, state = assembly.build()
    root = np.repeat(model.start[:-1], 2)
    return model, state, rooted(obstacles, 0, state.x, root, root + np.tile([0, 1], len(root) // 2))


@settings(deadline=None, max_examples=20)
@given(TURNS, TURNS)
def test_roots_on_what_only_turns_turn_with_it(turn, stands):
    change = Rotation.from_rotvec(turn).as_matrix()
    obstacles = body(SURFACE.vertices @ change.T + [0.01, 0.0, 0.0], turn=stands, place=(1.0, 2.0, 3.0))
    _, state, held = fur(obstacles)
    rotation, middle = obstacles.rotation[0], np.array([1.0, 2.0, 3.0])
    places, turned = held.at(obstacles, no_handles(), 1.0)
    local = (state.x[held.vertex] - middle) @ rotation
    np.testing.assert_allclose(places, (local @ change.T + [0.01, 0.0, 0.0]) @ rotation.T + middle, atol=1e-12)
    np.testing.assert_allclose(turned, np.broadcast_to(rotation @ change, turned.shape), atol=1e-12)


@settings(deadline=None, max_examples=20)
@given(CHANGES, st.floats(0.0, 2.5))
def test_roots_stay_on_their_triangles_and_edges_keep_their_length(change, time):
    obstacles = body(SURFACE.vertices @ change.T, SURFACE.vertices)
    _, state, held = fur(obstacles)
    places, turned = held.at(obstacles, no_handles(), time)
    now = obstacles.surfaces.vertices(0, time) + obstacles.centre[0]
    np.testing.assert_allclose(places[::2], now[SURFACE.faces].mean(axis=1), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(places[1::2] - places[::2], axis=1), LENGTH / 2, rtol=1e-9)
    np.testing.assert_allclose(turned @ turned.transpose(0, 2, 1), np.broadcast_to(np.eye(3), turned.shape), atol=1e-12)
    assert (np.linalg.det(turned) > 0).all()
    if time in (0.0, 2.0, 2.5):
        np.testing.assert_allclose(places, state.x[held.vertex], atol=1e-12)


@settings(deadline=None, max_examples=10)
@given(CHANGES)
def test_which_corner_comes_first_makes_no_difference(change):
    one, other = body(SURFACE.vertices @ change.T), body(SURFACE.vertices @ change.T, faces=np.roll(SURFACE.faces, 1, axis=1))
    for a, b in zip(fur(one)[2].at(one, no_handles(), 0.7), fur(other)[2].at(other, no_handles(), 0.7), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)


def test_held_edges_turn_about_themselves_as_their_triangles_do():
    spin = Rotation.from_rotvec([0.0, 0.0, 0.2]).as_matrix()
    obstacles = body(SURFACE.vertices @ spin.T)
    model, state, held = fur(obstacles)
    x, turn = state.x.copy(), np.zeros(len(state.x))
    follow(held, model, state, obstacles, no_handles(), 0.0, 1.0, x, turn)
    up = BALL.face_normals[:, 2]
    # a turn about z of an edge that stands along n: what is about n of it, beyond the shortest way from n to where it goes
    np.testing.assert_allclose(turn[held.vertex[::2]], 2.0 * np.arctan(up * np.tan(0.1)), atol=1e-12)
    free = np.setdiff1d(np.arange(len(turn)), held.vertex[::2])
    assert not turn[free].any()
    np.testing.assert_array_equal(x[np.setdiff1d(free, held.vertex)], state.x[np.setdiff1d(free, held.vertex)])


def test_handles_carry_what_changes():
    handles = Handles(np.array([0, 2]), np.array([0.0, 1.0]), np.array([[0.0, 0, 0], [0.0, 0.0, 0.5]]),
                      np.array([[0.0, 0, 0], [0.0, 90.0, 0.0]]), np.zeros((1, 3)))
    still = body(1.1 * SURFACE.vertices)
    carried = replace(still, handle=np.array([0]))
    _, _, held = fur(still)
    grown, _ = held.at(still, no_handles(), 1.0)
    turn = Rotation.from_euler("y", 90.0, degrees=True).as_matrix()
    np.testing.assert_allclose(held.at(carried, handles, 1.0)[0], grown @ turn.T + [0.0, 0.0, 0.5], atol=1e-12)


@pytest.mark.parametrize("time", [0.0, 0.3, 1.0, 1.7, 5.0])
def test_the_distance_is_that_to_the_shape_of_the_moment(time):
    """Of a ball that swells: blended distances are those of the ball in between, and what is carried keeps its own."""
    obstacles = body(1.2 * SURFACE.vertices, 0.9 * SURFACE.vertices)
    radius = np.interp(time, [0.0, 1.0, 2.0], [0.1, 0.12, 0.09])
    solids, outward = posed(obstacles, no_handles(), time), np.empty(3)
    for normal, middle in zip(BALL.face_normals, SURFACE.vertices[SURFACE.faces].mean(axis=1), strict=True):
        place = middle * radius / 0.1 + 0.003 * normal
        assert distance_to(solids, 0, place, outward) == pytest.approx(0.003, abs=1e-4)
        assert outward @ normal > 0.99
    step = motion(obstacles, no_handles(), time, 0.05)
    places = 1.02 * radius / 0.1 * SURFACE.vertices[SURFACE.faces].mean(axis=1)
    there = moved_along(step.begin, step.end, 0, places)
    np.testing.assert_allclose([distance_to(step.end, 0, place, outward) for place in there],
                               [distance_to(step.begin, 0, place, outward) for place in places], atol=1e-9)
    grown = np.interp(time + 0.05, [0.0, 1.0, 2.0], [0.1, 0.12, 0.09]) / radius
    np.testing.assert_allclose(there, grown * places, atol=2e-4)
