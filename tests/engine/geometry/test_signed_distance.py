"""Signed distances against the nearest point of the solid, and their gradients against differences."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine.geometry.signed_distance import BOX, CYLINDER, PLANE, SPHERE, signed_distance

SOLIDS = pytest.mark.parametrize("kind", [PLANE, BOX, SPHERE, CYLINDER], ids=["plane", "box", "sphere", "cylinder"])
COORDINATE = st.integers(-3 * 2**30, 3 * 2**30).map(lambda n: n * 2.0**-30)  # no squares that underflow
PLACES = st.tuples(COORDINATE, COORDINATE, COORDINATE).map(np.array)
SIZES = st.tuples(*[st.floats(0.2, 2.0)] * 3).map(np.array)
TURNS = st.tuples(*[st.floats(-np.pi, np.pi)] * 3).map(lambda v: Rotation.from_rotvec(v).as_matrix())
STRAIGHT, ORIGIN = np.eye(3), np.zeros(3)


def distance_to_rectangle(p, half):
    """Reference: distance of p to the box |p_i| <= half_i in any dimension."""
    excess = np.abs(p) - half
    return np.linalg.norm(p - np.clip(p, -half, half)) if (excess > 0).any() else excess.max()


def reference(kind, size, p):
    """Distance in the solid's own frame."""
    if kind == PLANE:
        return p[2]
    if kind == SPHERE:
        return np.linalg.norm(p) - size[0]
    if kind == CYLINDER:
        return distance_to_rectangle(np.array([np.linalg.norm(p[:2]), p[2]]), size[:2])
    return distance_to_rectangle(p, size)


def distance_and_normal(kind, size, x, centre=ORIGIN, rotation=STRAIGHT):
    normal = np.full(3, np.nan)
    return signed_distance(kind, centre, rotation, size, np.asarray(x, float), normal), normal


@SOLIDS
@settings(deadline=None)
@given(centre=PLACES, rotation=TURNS, size=SIZES, x=PLACES)
def test_the_distance_to_the_nearest_point(kind, centre, rotation, size, x):
    distance, normal = distance_and_normal(kind, size, x, centre, rotation)
    assert distance == pytest.approx(reference(kind, size, rotation.T @ (x - centre)), abs=1e-12)
    assert np.linalg.norm(normal) == pytest.approx(1.0)


@SOLIDS
@settings(deadline=None)
@given(rotation=TURNS, size=SIZES, x=PLACES)
def test_the_normal_is_the_gradient(kind, rotation, size, x):
    step = 1e-6

    def differences(step):
        return np.array([
            distance_and_normal(kind, size, x + step * e, ORIGIN, rotation)[0]
            - distance_and_normal(kind, size, x - step * e, ORIGIN, rotation)[0] for e in np.eye(3)]) / (2.0 * step)

    slope = differences(step)
    assume(np.allclose(slope, differences(100.0 * step), atol=1e-3))  # not at a ridge inside
    assume(abs(np.linalg.norm(slope) - 1.0) < 1e-6)
    np.testing.assert_allclose(distance_and_normal(kind, size, x, ORIGIN, rotation)[1], slope, atol=1e-5)


@SOLIDS
@settings(deadline=None)
@given(size=SIZES, x=PLACES, y=PLACES)
def test_a_distance_changes_no_faster_than_the_place(kind, size, x, y):
    difference = distance_and_normal(kind, size, x)[0] - distance_and_normal(kind, size, y)[0]
    assert abs(difference) <= np.linalg.norm(x - y) + 1e-12


@SOLIDS
@settings(deadline=None)
@given(size=SIZES, x=PLACES)
def test_the_surface_lies_at_the_distance_along_the_normal(kind, size, x):
    distance, normal = distance_and_normal(kind, size, x)
    assert distance_and_normal(kind, size, x - distance * normal)[0] == pytest.approx(0.0, abs=1e-12)


SIZE = np.array([1.0, 2.0, 3.0])
ROOT2, ROOT3 = np.sqrt(2.0), np.sqrt(3.0)


@pytest.mark.parametrize(("kind", "x", "distance", "normal"), [
    (BOX, (2, 0, 0), 1.0, (1, 0, 0)),
    (BOX, (-2, -3, 0), ROOT2, (-1 / ROOT2, -1 / ROOT2, 0)),
    (BOX, (2, 3, -4), ROOT3, (1 / ROOT3, 1 / ROOT3, -1 / ROOT3)),
    (BOX, (0, 1.9, 0), -0.1, (0, 1, 0)),
    (BOX, (1, 2, 3), 0.0, (1, 0, 0)),
    (BOX, (0, 0, 0), -1.0, (1, 0, 0)),
    (SPHERE, (0, 0, 0), -1.0, (0, 0, 1)),
    (CYLINDER, (2, 0, 3), ROOT2, (1 / ROOT2, 0, 1 / ROOT2)),
    (CYLINDER, (0, 0, -1.75), -0.25, (0, 0, -1)),
    (CYLINDER, (0, 0, 0), -1.0, (1, 0, 0)),
    (CYLINDER, (0, 0, 5), 3.0, (0, 0, 1)),
    (CYLINDER, (0, 1, 2), 0.0, (0, 0, 1)),
    (PLANE, (7, -7, -2), -2.0, (0, 0, 1)),
])
def test_faces_edges_corners_and_centres(kind, x, distance, normal):
    found = distance_and_normal(kind, SIZE, x)
    assert found[0] == pytest.approx(distance, abs=1e-15)
    np.testing.assert_allclose(found[1], normal, atol=1e-15)
