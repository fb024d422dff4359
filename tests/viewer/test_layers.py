from itertools import pairwise

import numpy as np
import pytest

from engine.contact.obstacles import ObstacleKind, Obstacles, posed
from engine.geometry.handles import no_handles
from engine.run.frames import YarnFrame
from engine.yarns.model import NodeState, PointKind
from tests.viewer import synthetic
from viewer import layers
from viewer.lay import lay_out, layout_of, yarn_lifts


def assert_joins_consecutive(segments: layers.Segments, positions, offsets, radius: float) -> None:
    """One segment between each place and the next on the same line."""
    expected = [positions[k : k + 2] for first, end in pairwise(offsets) for k in range(first, end - 1)]
    assert np.array_equal(segments.points, np.array(expected, np.float32))
    assert segments.colours.shape == segments.points.shape and segments.colours.dtype == np.uint8
    assert np.allclose(segments.radii, radius)


@pytest.fixture(scope="module")
def yarns() -> YarnFrame:
    return synthetic.frame(5).yarns


def test_segments_join_consecutive_line_nodes_of_each_yarn(yarns):
    assert_joins_consecutive(layers.yarn_segments(yarns), yarns.line_positions, yarns.line_offsets, synthetic.RADIUS)


def test_fabrics_have_distinct_colours_green_lowest(yarns):
    colours = layers.fabric_colours(yarns.fabric)
    lowest = colours[yarns.fabric == 0][0]
    assert lowest[1] == lowest.max()
    assert len(np.unique(layers.fabric_colours(np.arange(-1, 6)), axis=0)) == 7


def test_every_other_yarn_is_darker_where_lines_are_not_shaded():
    told = layers.told_apart(np.full((4, 3), 100, np.uint8))
    assert told[:, 0].tolist() == [100, 78, 100, 78]


def test_strain_colours_are_pale_at_rest_and_saturate():
    limit = layers.STRAIN_LIMIT
    compressed, rest, stretched, beyond = layers.strain_colours(np.array([-limit, 0.0, limit, 10 * limit])).tolist()
    assert min(rest) > 240
    assert compressed[2] > compressed[0] and stretched[0] > stretched[2]
    assert stretched == beyond


def test_strain_paints_nodes_not_fabrics(yarns):
    segments = layers.yarn_segments(yarns, "strain")
    assert np.array_equal(segments.colours[0, 0], layers.strain_colours(yarns.line_strain[:1])[0])


def test_nodes_have_the_colour_of_their_state(yarns):
    points = layers.node_points(yarns)
    assert set(yarns.node_states) == {0, 1, 2, 3}, "the frame should show every state"
    for state, colour in layers.NODE_COLOURS.items():
        assert (points.colours[yarns.node_states == state] == colour).all()
    assert layers.NODE_COLOURS[NodeState.EOL] == (255, 255, 255)
    red, pink = layers.NODE_COLOURS[NodeState.EIL_EIL], layers.NODE_COLOURS[NodeState.EOL_EIL]
    assert red[0] > 200 and max(red[1:]) < 60
    assert pink[0] > 200 and min(pink[1:]) > 100


def test_no_yarns_give_no_segments():
    empty = YarnFrame(
        np.zeros((0, 3)), np.zeros(1, np.int64), np.zeros(0), np.zeros(0, np.int32), np.zeros(0), np.zeros(0, np.int64),
        np.zeros((0, 3)), np.zeros(0, np.uint8), np.zeros(0, np.int64), np.zeros(0),
    )  # fmt: skip
    assert len(layers.yarn_segments(empty).points) == 0
    assert len(layers.node_points(empty).points) == 0


def test_bounds_hold_yarns_and_near_obstacles_but_no_plane():
    frame, obstacles = synthetic.frame(0), synthetic.built().obstacles
    low, high = layers.scene_bounds(frame, posed(obstacles, no_handles(), 0.0))
    assert (low < frame.yarns.line_positions.min(axis=0)).all()
    assert (high > frame.yarns.line_positions.max(axis=0)).all()
    assert low[2] == pytest.approx(-0.04)
    assert high[0] == pytest.approx(0.046), "the ball"


def test_bounds_leave_out_an_obstacle_much_larger_than_the_yarns():
    wall = Obstacles(
        np.array([ObstacleKind.BOX]), np.zeros((1, 3)), np.eye(3)[None], np.full((1, 3), 50.0), np.zeros(1)
    )
    low, high = layers.scene_bounds(synthetic.frame(0), posed(wall, no_handles(), 0.0))
    assert (high - low).max() < 0.1


def test_the_eye_sees_the_whole_box():
    low, high = np.array((-1.0, -2.0, 0.0)), np.array((3.0, 1.0, 0.5))
    eye, target = layers.viewpoint(low, high)
    assert np.allclose(target, (low + high) / 2)
    assert eye[2] > high[2], "from above"


def test_yarns_of_a_crossing_lie_on_their_own_sides():
    """The upper yarn of every EoL crossing is drawn a diameter above the lower one, along the fabric's normal."""
    model, frame = synthetic.built().yarns, synthetic.frame(0).yarns
    lifts = yarn_lifts(synthetic.scene(), model)
    drawn = lay_out(frame, 60_000, model, lifts)
    nodes = model.point_nodes[frame.node_points]
    crossings = np.flatnonzero(
        (model.point_kind[frame.node_points] == PointKind.CROSSING) & (frame.node_states == NodeState.EOL))
    for point in crossings[::7]:
        heights = []
        for node in nodes[point]:
            yarn = model.node_yarn[node]
            line = drawn.line_positions[drawn.line_offsets[yarn] : drawn.line_offsets[yarn + 1]]
            near = np.argmin(np.linalg.norm(line[:, :2] - frame.node_positions[point, :2], axis=1))
            heights.append(line[near, 2] - frame.node_positions[point, 2] - lifts[yarn])
        assert heights == pytest.approx([-synthetic.RADIUS, synthetic.RADIUS], rel=1e-3)


def test_upper_fabrics_are_drawn_above_lower_ones():
    model = synthetic.built().yarns
    lifts = yarn_lifts(synthetic.scene(), model)
    assert np.allclose(lifts[model.fabric == 0], synthetic.RADIUS)
    assert np.allclose(lifts[model.fabric == 1], 5 * synthetic.RADIUS)


def test_drawn_curves_end_where_yarns_end_and_keep_their_count(yarns):
    drawn = layout_of(synthetic.scene(), synthetic.built())(yarns, 60_000)
    assert len(drawn.line_offsets) == len(yarns.line_offsets)
    assert drawn.line_offsets[-1] == len(drawn.line_positions) == len(drawn.line_strain)
    lengths, pieces = np.diff(yarns.line_offsets) - 1, np.diff(drawn.line_offsets) - 1
    assert (pieces % lengths == 0).all() and (pieces > lengths).all()
    starts, drawn_starts = yarns.line_offsets[:-1], drawn.line_offsets[:-1]
    shift = drawn.line_positions[drawn_starts] - yarns.line_positions[starts]
    assert np.linalg.norm(shift, axis=1).max() <= 6.01 * synthetic.RADIUS
    assert np.isfinite(drawn.line_positions).all()


def test_drawing_leaves_the_frame_alone():
    frame, again = synthetic.frame(3).yarns, synthetic.frame(3).yarns
    layout_of(synthetic.scene(), synthetic.built())(frame, 60_000)
    assert all(np.array_equal(value, getattr(again, name)) for name, value in vars(frame).items())
