"""Distances to triangle surfaces: exact ones against brute force and closed forms, sampled ones by their order."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine.contact.surface import Surface, sampled
from engine.geometry.sampled_distance import sampled_distance
from engine.geometry.triangle_distance import signed_distances, triangle_tree

BOX = trimesh.creation.box((1.0, 2.0, 3.0))
RING = 0.4  # radius of a torus about the circle in its middle, whose radius is 1


def surface_of(mesh) -> Surface:
    return Surface(np.array(mesh.vertices, float), np.array(mesh.faces, np.int64))


def ball(points):
    return np.linalg.norm(points, axis=1) - 1.0


def torus(points):
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1.0, points[:, 2]) - RING


def interpolated(found, points):
    lattice, normal = np.array([0, *found.samples.shape]), np.empty(3)
    values, gradients = np.empty(len(points)), np.empty((len(points), 3))
    for i, x in enumerate(points):
        values[i] = sampled_distance(lattice, found.samples.ravel(), np.zeros(3), np.eye(3), found.size, x, normal)
        gradients[i] = normal
    return values, gradients


def test_a_box_is_as_far_as_its_faces_edges_and_corners(seed=0):
    surface = surface_of(BOX)
    points = np.random.default_rng(seed).uniform(-3.0, 3.0, (2000, 3))
    beyond = np.abs(points) - [0.5, 1.0, 1.5]
    exact = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
    np.testing.assert_allclose(signed_distances(triangle_tree(surface.vertices, surface.faces), points, 0.0), exact, atol=1e-14)


@pytest.mark.parametrize("step", [0.0, 0.2, 10.0])
def test_a_tree_finds_what_looking_at_every_triangle_finds(step, seed=1):
    """Also where successive points are near each other, and where some pretend to be."""
    rng = np.random.default_rng(seed)
    surface = surface_of(trimesh.creation.torus(1.0, RING, major_sections=24, minor_sections=12))
    points = np.cumsum(rng.uniform(-0.1, 0.1, (500, 3)), axis=0)
    points[::7] = rng.uniform(-2.0, 2.0, points[::7].shape)
    found = signed_distances(triangle_tree(surface.vertices, surface.faces), points, step)
    a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    exact = [np.linalg.norm(trimesh.triangles.closest_point(np.stack([a, b, c], 1), np.tile(x, (len(a), 1))) - x, axis=1).min()
             for x in points]
    np.testing.assert_allclose(np.abs(found), exact, atol=1e-14)
    sure = np.abs(torus(points)) > 0.05
    np.testing.assert_array_equal(np.sign(found[sure]), np.sign(torus(points)[sure]))


@pytest.mark.parametrize(("exact", "mesh"), [
    (ball, lambda n: trimesh.creation.icosphere(n + 2)),
    (torus, lambda n: trimesh.creation.torus(1.0, RING, major_sections=24 * 2**n, minor_sections=12 * 2**n)),
], ids=["ball", "torus"])
def test_samples_are_right_to_second_order(exact, mesh):
    """Triangles and samples are refined alike, so that both errors fall by four."""
    points = np.random.default_rng(2).uniform(-1.5, 1.5, (20000, 3))
    points = points[np.abs(exact(points)) < 0.15]
    errors, slopes = [], []
    for n in range(3):
        values, gradients = interpolated(sampled(surface_of(mesh(n)), 0.2 / 2**n, 0.2), points)
        errors.append(np.abs(values - exact(points)).max())
        slopes.append(np.abs(np.linalg.norm(gradients, axis=1) - 1.0).max())
    order = np.log2(errors[0] / errors[2]) / 2.0
    assert order >= 1.8 and errors[2] < 0.005, errors
    assert slopes[2] < 0.05


@settings(deadline=None, max_examples=30)
@given(st.tuples(*[st.floats(-2.5, 2.5)] * 3), st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_the_gradient_is_that_of_the_interpolated_value(place, turn):
    """Everywhere: inside, outside, and beyond the grid, however the body is turned."""
    found, rotation = sampled(surface_of(BOX), 0.2, 0.3), Rotation.from_rotvec(turn).as_matrix()
    lattice, gradient, unused = np.array([0, *found.samples.shape]), np.empty(3), np.empty(3)

    def value(x, normal):
        return sampled_distance(lattice, found.samples.ravel(), np.zeros(3), rotation, found.size, x, normal)

    x, step = np.array(place), 1e-6
    value(x, gradient)
    ahead, back = (np.array([value(x + sign * step * e, unused) for e in np.eye(3)]) for sign in (1, -1))
    np.testing.assert_allclose(gradient, (ahead - back) / (2 * step), atol=1e-4)
