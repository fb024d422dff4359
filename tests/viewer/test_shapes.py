import numpy as np
import pytest

from engine.contact.obstacles import ObstacleKind, Obstacles, posed
from engine.contact.surface import Surface, packed, sampled
from engine.geometry.handles import Handles
from viewer.layers import Segments
from viewer.shapes import box, changed_vertices, cylinder, moves, obstacle_mesh, sphere, tubes


def volume(shape) -> float:
    """Volume inside a closed mesh with outward triangles; negative if they face inwards."""
    vertices, faces = shape
    a, b, c = (vertices[faces[:, k]].astype(float) for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize(
    ("shape", "exact"), [(box(), 8.0), (cylinder(256), np.pi), (sphere(64), 4 / 3 * np.pi)], ids=["box", "rod", "ball"]
)
def test_closed_shapes_face_outwards(shape, exact):
    assert volume(shape) == pytest.approx(exact, rel=2e-3)


def test_obstacles_are_where_the_scene_puts_them():
    turn = np.array([(0, -1, 0), (1, 0, 0), (0, 0, 1)], float)
    obstacles = Obstacles(
        kind=np.array([ObstacleKind.BOX, ObstacleKind.CYLINDER, ObstacleKind.SPHERE]),
        centre=np.array([(1, 2, 3), (0, 0, 0), (5, 0, 0)], float),
        rotation=np.stack([turn, np.eye(3), np.eye(3)]),
        size=np.array([(1, 2, 3), (0.5, 4, 0), (2, 0, 0)], float),
        friction=np.zeros(3),
    )
    extents = [((-1, 1, 0), (3, 3, 6)), ((-0.5, -0.5, -4), (0.5, 0.5, 4)), ((3, -2, -2), (7, 2, 2))]
    for index, (low, high) in enumerate(extents):
        mesh = obstacle_mesh(obstacles, index, np.zeros(3), np.ones(3))
        assert np.allclose(mesh.vertices.min(axis=0), low, atol=1e-6)
        assert np.allclose(mesh.vertices.max(axis=0), high, atol=1e-6)


def test_a_tilted_plane_is_drawn_in_itself_around_the_scene():
    angle = 0.3
    tilt = np.array([(np.cos(angle), 0, np.sin(angle)), (0, 1, 0), (-np.sin(angle), 0, np.cos(angle))])
    plane = Obstacles(
        np.array([ObstacleKind.PLANE]), np.array([(0, 0, -1.0)]), tilt[None], np.zeros((1, 3)), np.zeros(1)
    )
    low, high = np.array((9.0, 0, 0)), np.array((11.0, 1, 1))
    mesh = obstacle_mesh(plane, 0, low, high)
    assert np.allclose((mesh.vertices - (0, 0, -1)) @ tilt[:, 2], 0, atol=1e-5)
    foot = mesh.vertices.mean(axis=0) - (low + high) / 2
    assert np.allclose(np.cross(foot, tilt[:, 2]), 0, atol=1e-4)


def rotated(wxyz: np.ndarray, vector: np.ndarray) -> np.ndarray:
    w, v = wxyz[0], wxyz[1:]
    return vector + 2 * np.cross(v, np.cross(v, vector) + w * vector)


def test_obstacles_are_drawn_where_they_have_moved():
    turn = np.array([(0, -1, 0), (1, 0, 0), (0, 0, 1)], float)
    kind = np.array([ObstacleKind.BOX, ObstacleKind.SPHERE])
    obstacles = Obstacles(kind, np.array([(1.0, 2, 3), (0, 0, 0)]), np.stack([turn, np.eye(3)]), np.ones((2, 3)),
                          np.zeros(2), np.array([0, -1]))
    handles = Handles(np.array([0, 2]), np.array([0.0, 1.0]), np.array([(0.0, 0, 0), (0, 0, 4.0)]))
    found = moves(obstacles, handles, 0.5)
    assert set(found) == {0}
    drawn = obstacle_mesh(obstacles, 0, np.zeros(3), np.ones(3)).vertices
    shown = np.array([rotated(found[0].wxyz, vertex) for vertex in drawn]) + found[0].position
    assert np.allclose(shown.mean(axis=0), posed(obstacles, handles, 0.5).centre[0], atol=1e-6)
    assert moves(Obstacles(kind, *[np.zeros((2, 3))] * 3, np.zeros(2)), handles, 0.5) == {}


def test_tubes_span_their_segments(seed: int = 3):
    rng = np.random.default_rng(seed)
    ends = rng.normal(size=(20, 2, 3)).astype(np.float32)
    ends[0] = [(0, 0, 1), (0, 0, -1)]  # straight down: the rotation from z is not unique
    tube = tubes(Segments(ends, np.zeros((20, 2, 3), np.uint8), np.full(20, 0.1, np.float32)))
    for k in range(20):
        tip = tube.positions[k] + rotated(tube.wxyzs[k], np.array((0, 0, tube.scales[k, 2] / 2)))
        assert np.allclose(tip, ends[k, 1], atol=1e-5)


def test_tubes_that_go_on_meet_at_their_outer_sides():
    ends = np.array([[(0, 0, 0), (1, 0, 0)], [(1, 0, 0), (1, 1, 0)]], np.float32)
    bend = np.radians(90)
    radius = 0.1
    tube = tubes(Segments(ends, np.zeros((2, 2, 3), np.uint8), np.full(2, radius, np.float32)))
    assert tube.scales[:, 2] == pytest.approx(1 + radius * min(np.tan(bend / 2), 0.6))
    assert np.isfinite(tube.wxyzs).all()


def test_a_segment_without_length_is_harmless():
    tube = tubes(Segments(np.zeros((1, 2, 3), np.float32), np.zeros((1, 2, 3), np.uint8), np.ones(1, np.float32)))
    assert np.isfinite(tube.wxyzs).all() and tube.scales[0, 2] == 0


def mesh_obstacle(surface: Surface, later=()) -> Obstacles:
    mesh = sampled(surface, 0.5, 0.1, later)
    return Obstacles(np.array([ObstacleKind.MESH]), mesh.middle[None], np.eye(3)[None], mesh.size[None], np.zeros(1),
                     surfaces=packed([mesh]))


def test_a_mesh_is_drawn_as_it_is():
    corners, faces = box()
    surface = Surface(corners.astype(float) + 3.0, faces.astype(np.int64))
    obstacles = mesh_obstacle(surface)
    drawn = obstacle_mesh(obstacles, 0, np.zeros(3), np.ones(3))
    assert np.allclose(drawn.vertices, surface.vertices) and (drawn.faces == faces).all()
    assert changed_vertices(obstacles, 1.0) == {}


def test_a_mesh_that_changes_is_drawn_as_it_is_then():
    corners, faces = box()
    surface = Surface(corners.astype(float) + 3.0, faces.astype(np.int64))
    wider = surface.vertices * (1.1, 1.0, 1.0)
    obstacles = mesh_obstacle(surface, [(2.0, wider)])
    assert np.allclose(obstacle_mesh(obstacles, 0, np.zeros(3), np.ones(3)).vertices, surface.vertices)
    for time, places in ((0.0, surface.vertices), (1.0, (surface.vertices + wider) / 2), (2.0, wider), (3.0, wider)):
        assert np.allclose(changed_vertices(obstacles, time)[0], places)
