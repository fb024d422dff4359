from dataclasses import replace

import numpy as np
import pytest

from engine.contact.obstacles import ObstacleKind, Obstacles, posed
from engine.geometry.handles import no_handles
from engine.run.frames import Frame, LiquidFrame
from tests.viewer import liquids, strands, synthetic
from viewer import layers, panel, shapes
from viewer.scales import SCALES, colours_of, pascals, per_second


@pytest.fixture(scope="module")
def liquid() -> LiquidFrame:
    return liquids.basin(0.04)


def test_particles_are_balls_of_one_colour(liquid):
    points = layers.liquid_points(liquid)
    assert points.points is liquid.positions and points.radii is liquid.radius
    assert (points.colours == layers.LIQUID_COLOUR).all() and points.colours.dtype == np.uint8
    volume = 4 / 3 * np.pi * np.sum(points.radii.astype(float) ** 3)
    assert volume == pytest.approx(len(points.points) * liquids.SPACING**3, rel=1e-5)


@pytest.mark.parametrize("paint", ["speed", "pressure", "shear"])
def test_numbers_paint_particles(liquid, paint):
    limit = layers.paint_limit(liquid, paint)
    colours = layers.liquid_points(liquid, paint, limit).colours
    assert np.array_equal(colours, colours_of(getattr(liquid, paint), SCALES[paint], limit))
    assert len(np.unique(colours, axis=0)) > 2


def test_suction_is_blue_and_pressure_red(liquid):
    colours = layers.liquid_points(liquid, "pressure", layers.paint_limit(liquid, "pressure")).colours.astype(int)
    assert (colours[liquid.pressure < -20] @ (-1, 0, 1) > 0).all() and (colours[liquid.pressure > 200] @ (1, 0, -1) > 0).all()


def test_what_has_yielded_is_told_from_what_has_not(liquid):
    assert 0 < np.count_nonzero(liquid.yielded) < len(liquid.yielded)
    colours = layers.liquid_points(liquid, "yielded").colours
    for state in (False, True):
        assert (colours[liquid.yielded == state] == layers.YIELD_COLOURS[int(state)]).all()


@pytest.mark.parametrize("paint", layers.LIQUID_PAINTS)
def test_liquid_at_rest_has_colours_too(liquid, paint):
    still = liquids.at_rest(liquid)
    assert len(np.unique(layers.liquid_points(still, paint, layers.paint_limit(still, paint)).colours, axis=0)) == 1


def test_no_liquid_gives_no_points(liquid):
    names = ("positions", "radius", "speed", "pressure", "shear", "yielded")
    empty = replace(liquid, **{name: getattr(liquid, name)[:0] for name in names})
    for paint in layers.LIQUID_PAINTS:
        assert len(layers.liquid_points(empty, paint, layers.paint_limit(empty, paint)).points) == 0
    low, high = layers.scene_bounds(Frame(0, 0.0, 0, liquid=empty), _nothing())
    assert (low < high).all()


def test_colours_that_are_offered_are_those_of_what_the_scene_has():
    assert layers.paints_of(liquids.frame(0)) == ("liquid", "speed", "pressure", "shear", "yielded")
    wet = replace(strands.frame(0), liquid=liquids.basin(0.0))
    assert layers.paints_of(wet) == layers.STRAND_PAINTS + layers.LIQUID_PAINTS
    assert layers.paints_of(Frame(0, 0.0, 0)) == layers.YARN_PAINTS
    for paint in ("fabric", "group", None):
        assert layers.paint_among(layers.LIQUID_PAINTS, paint) == "liquid"
    assert layers.paint_among(layers.LIQUID_PAINTS, "shear") == "shear"


def test_colours_are_put_in_words():
    frame = liquids.frame(2)
    assert layers.colours_in_words(frame, "shear") == ["shear stress from 0 (grey) to 1 kPa (dark purple)"]
    assert layers.colours_in_words(frame, "pressure") == ["pressure from −2 kPa (blue) to +2 kPa (red)"]
    assert layers.colours_in_words(frame, "yielded") == ["yielded (orange) or not (grey)"]
    for paint in ("liquid", "curvature", None):
        assert layers.colours_in_words(frame, paint) == []
    assert layers.colours_in_words(synthetic.frame(1), "strain") == []
    assert [pascals(value) for value in (2e6, 5e3, 20.0, 1e-3)] == ["2 MPa", "5 kPa", "20 Pa", "1 mPa"]
    assert [per_second(value) for value in (2.0, 0.05, 1e-3, 2e-6)] == ["2 m/s", "5 cm/s", "1 mm/s", "2 µm/s"]


def test_keys_say_what_colours_mean():
    frame = liquids.frame(2)
    assert panel.legend_html(frame, "liquid") == ""
    assert "1 kPa" in panel.legend_html(frame, "shear") and "shear stress" in panel.legend_html(frame, "shear")
    yielded = panel.legend_html(frame, "yielded")
    assert all(label in yielded for label in layers.YIELD_LABELS) and "rgb(236,150,36)" in yielded
    assert all(paint in panel.PAINTS.values() for paint in layers.LIQUID_PAINTS)


def test_bounds_hold_liquid_and_near_obstacles(liquid):
    ball = Obstacles(
        np.array([ObstacleKind.SPHERE]), np.array([[0.3, 0.15, 0.5]]), np.eye(3)[None], np.full((1, 3), 0.05), np.zeros(1)
    )
    low, high = layers.scene_bounds(Frame(0, 0.0, 0, liquid=liquid), posed(ball, no_handles(), 0.0))
    assert (low < liquid.positions.min(axis=0)).all() and (high > liquid.positions.max(axis=0)).all()
    assert high[2] == pytest.approx(0.55)


def test_the_surface_is_a_mesh_of_the_same_colour():
    liquid = liquids.basin(0.02, surfaced=True)
    mesh = shapes.surface(liquid)
    assert mesh.colour == layers.LIQUID_COLOUR
    assert mesh.vertices is liquid.surface_vertices and np.array_equal(mesh.faces, liquid.surface_faces)
    assert mesh.faces.dtype == np.uint32


def test_instances_are_given_light_for_srgb():
    grey = np.array([[0, 10, 188], [255, 255, 255]], np.uint8)
    assert shapes.light(grey).tolist() == [[0, 1, 128], [255, 255, 255]]


def test_many_balls_are_drawn_with_fewer_sides():
    assert shapes.ball(100) is shapes.UNIT_BALL and shapes.ball(10_000) is shapes.UNIT_BEAD
    assert np.allclose(np.linalg.norm(shapes.UNIT_BEAD[0], axis=1), 1, atol=1e-6)


def _nothing() -> Obstacles:
    return posed(Obstacles(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(0)),
                 no_handles(), 0.0)
