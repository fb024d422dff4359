import numpy as np
import pytest

from engine.contact.obstacles import posed
from engine.geometry.handles import no_handles
from engine.run.frames import StrandFrame
from tests.viewer import strands as made
from tests.viewer import synthetic
from tests.viewer.test_layers import assert_joins_consecutive
from viewer import layers
from viewer.scales import SCALES, Scale, colours_of, in_words, limit_of, newtons
from viewer.strand_detail import vertex_strands


@pytest.fixture(scope="module")
def strands() -> StrandFrame:
    return made.frame(5).strands


def test_segments_are_the_edges_of_each_strand(strands):
    assert_joins_consecutive(layers.strand_segments(strands), strands.positions, strands.offsets, made.RADIUS)


def test_small_frames_are_drawn_as_curves_through_the_vertices(strands):
    edges = len(layers.strand_segments(strands).points)
    segments = layers.strand_segments(strands, most=4 * edges)
    assert len(segments.points) == 3 * edges, "as many pieces as have room"
    assert np.array_equal(segments.points[::3, 0], layers.strand_segments(strands).points[:, 0])
    joined = segments.points[1:, 0] == segments.points[:-1, 1]
    assert joined.all(axis=1).sum() == len(segments.points) - len(strands.group), "each strand in one piece"


def test_a_taper_is_drawn():
    hair = made.curled(2, 5)
    hair.radius[:] = np.tile([5, 4, 3, 2, 2], 2) * np.float32(1e-5)
    assert np.allclose(layers.strand_segments(hair).radii, np.tile([5e-5, 4e-5, 3e-5, 2e-5], 2))


def test_groups_have_distinct_hues_and_strands_shades(strands):
    colours = layers.group_colours(strands.group).astype(float)
    assert len(np.unique(colours, axis=0)) > len(colours) / 2
    hue = colours / colours.max(axis=1, keepdims=True)
    for group in (0, 1):
        assert np.ptp(hue[strands.group == group], axis=0).max() < 0.05
    assert np.abs(hue[strands.group == 0][0] - hue[strands.group == 1][0]).max() > 0.3


@pytest.mark.parametrize("paint", ["strain", "curvature", "force"])
def test_numbers_paint_vertices(strands, paint):
    limit = layers.paint_limit(strands, paint)
    values = layers.paint_values(strands, paint)
    segments = layers.strand_segments(strands, paint, limit)
    assert np.array_equal(segments.colours[0, 0], colours_of(values[:1], SCALES[paint], limit)[0])
    first = np.flatnonzero(vertex_strands(strands)[:-1] == vertex_strands(strands)[1:])
    assert np.array_equal(segments.colours[:, 1], colours_of(values[first + 1], SCALES[paint], limit))
    assert len(np.unique(segments.colours.reshape(-1, 3), axis=0)) > 2


def test_what_nothing_touches_is_grey():
    hair = made.without_contact(made.curled(4, 6))
    colours = layers.strand_segments(hair, "force", layers.paint_limit(hair, "force")).colours
    assert (colours == SCALES["force"].stops[0]).all()


@pytest.mark.parametrize(("most", "limit"), [(0.9e-3, 1e-3), (1e-3, 1e-3), (1.1e-3, 2e-3), (3.0, 5.0), (7.0, 10.0), (0.0, 1e-9)])
def test_limits_are_round_numbers_that_hold_a_frame(most, limit):
    assert limit_of(np.array([0.0, most / 2, most]), SCALES["force"]) == limit


def test_a_few_outliers_do_not_hide_the_rest():
    values = np.concatenate([np.zeros(1000), np.linspace(0.1, 1.0, 1000), [1e6]])
    assert limit_of(values, SCALES["force"]) == 1.0


@pytest.mark.parametrize("name", SCALES)
def test_scales_run_from_end_to_end_and_saturate(name):
    scale: Scale = SCALES[name]
    low = -2.0 if scale.signed else 0.0
    ends = colours_of(np.array([low, 2.0, 4.0, -4.0]), scale, 2.0)
    assert tuple(ends[0]) == tuple(ends[3]) == scale.stops[0] and tuple(ends[1]) == tuple(ends[2]) == scale.stops[-1]
    if not scale.signed:
        light = colours_of(np.linspace(0, 2, 50), scale, 2.0).astype(float) @ (0.2126, 0.7152, 0.0722)
        assert (np.diff(light) < 0.5).all(), "ever darker"


def test_scales_are_put_in_words():
    assert in_words(SCALES["strain"], 5e-4) == "stretch strain from −0.05% (blue) to +0.05% (red)"
    assert in_words(SCALES["force"], 2e-3) == "contact force from 0 (grey) to 2 mN (dark red)"
    assert in_words(SCALES["curvature"], 500.0) == "curvature from 0 (grey) to 500/m (dark blue)"
    assert [newtons(value) for value in (20.0, 5e-6, 1e-9)] == ["20 N", "5 µN", "1 nN"]


def test_colours_that_are_offered_are_those_of_what_the_scene_has():
    assert layers.paints_of(made.frame(0)) == ("group", "strain", "curvature", "force")
    assert layers.paints_of(synthetic.frame(0)) == ("fabric", "strain")


def test_bounds_hold_strands_and_near_obstacles():
    frame, obstacles = made.frame(0), made.built().obstacles
    low, high = layers.scene_bounds(frame, posed(obstacles, no_handles(), 0.0))
    assert (low < frame.strands.positions.min(axis=0)).all() and (high > frame.strands.positions.max(axis=0)).all()
    assert high[2] == pytest.approx(made.RADIUS) and high[0] == pytest.approx(0.03 + made.RADIUS)


def test_no_strands_give_no_segments():
    none = np.zeros(0, np.float32)
    empty = StrandFrame(np.zeros((0, 3), np.float32), np.zeros(1, np.int64), none, np.zeros(0, np.int64), none, none, none)
    assert len(layers.strand_segments(empty).points) == 0
    assert layers.paint_limit(empty, "strain") > 0
