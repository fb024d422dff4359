"""What is drawn of a large frame: within the budget, rare states first, the same weave."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.run.frames import YarnFrame
from engine.scene.load import load_scene
from engine.yarns.model import NodeState
from tests.viewer import synthetic
from viewer import layers, shapes
from viewer.detail import AUTO, FINE, Detail, coarse, line_yarns, part, region, segment_count, statement
from viewer.lay import lay_out, layout_of

NOWHERE = np.zeros(3)


def cloth(warps: int, wefts: int, singles: int = 0, fabrics: int = 1) -> YarnFrame:
    """Flat woven fabrics of spacing 1 side by side, and single yarns of as many nodes beside them, by formula."""
    lines, points, fabric = [], [], []
    for here in range(fabrics):
        at = here * warps * wefts
        for i in range(warps):
            lines.append([(i + here * 2 * warps, j, 0.0) for j in range(wefts)])
            points.append([at + i * wefts + j for j in range(wefts)])
        for j in range(wefts):
            lines.append([(i + here * 2 * warps, j, 0.0) for i in range(warps)])
            points.append([at + i * wefts + j for i in range(warps)])
        fabric += [here] * (warps + wefts)
    count = fabrics * warps * wefts
    for s in range(singles):
        lines.append([(-3.0 - s, j, 0.0) for j in range(wefts)])
        points.append([count + s * wefts + j for j in range(wefts)])
        fabric.append(-1)
    count += singles * wefts
    positions, line_points = np.concatenate(lines), np.concatenate(points).astype(np.int32)
    places = np.zeros((count, 3))
    places[line_points] = positions
    return YarnFrame(
        line_positions=positions, line_offsets=np.cumsum([0, *map(len, lines)]), line_strain=np.zeros(len(positions)),
        line_points=line_points, radius=np.full(len(lines), 0.3), fabric=np.array(fabric), node_positions=places,
        node_states=np.full(count, NodeState.EOL, np.uint8), node_points=np.arange(count, dtype=np.int32),
        u=np.zeros(len(positions)),
    )


def divided(yarns: YarnFrame, segments: int) -> YarnFrame:
    """The frame with further points, so that so many segments lie between neighbouring crossings."""
    inner = line_yarns(yarns)[:-1] == line_yarns(yarns)[1:]
    steps = np.append(np.where(inner, segments, 1), 1)
    start = np.repeat(np.arange(len(steps)), steps)
    share = (np.arange(len(start)) - np.repeat(np.cumsum(steps) - steps, steps)) / steps[start]
    after = np.minimum(start + 1, len(steps) - 1)
    places = yarns.line_positions
    new = share > 0
    points = np.where(new, len(yarns.node_points) + np.cumsum(new) - 1, yarns.line_points[start]).astype(np.int32)
    return replace(
        yarns, line_positions=(1 - share[:, None]) * places[start] + share[:, None] * places[after], line_points=points,
        line_strain=np.zeros(len(start)), line_offsets=np.append(np.cumsum(steps) - steps, len(start))[yarns.line_offsets],
    )


cloths = st.builds(cloth, st.integers(2, 40), st.integers(2, 40), st.integers(0, 5), st.integers(1, 3))


@settings(deadline=None)
@given(cloths, st.integers(20, 3000), st.integers(5, 3000), st.integers(0, 5))
def test_budgets_are_kept_and_ends_stay(yarns, segments, nodes, seed):
    states = np.random.default_rng(seed).choice([0, 1, 2, 3], len(yarns.node_points), p=[0.05, 0.9, 0.03, 0.02])
    yarns = replace(yarns, node_states=states.astype(np.uint8))
    drawn = coarse(yarns, Detail(segments, nodes))
    assert 0 < segment_count(drawn) <= segments
    assert len(drawn.node_points) <= nodes
    assert len(drawn.line_offsets) == len(yarns.line_offsets) and drawn.line_offsets[-1] == len(drawn.line_positions)
    assert len(drawn.line_positions) == len(drawn.line_points) == len(drawn.line_strain)
    for y in np.flatnonzero(np.diff(drawn.line_offsets)):
        for end in (0, -1):
            assert np.array_equal(
                drawn.line_positions[drawn.line_offsets[y] : drawn.line_offsets[y + 1]][end],
                yarns.line_positions[yarns.line_offsets[y] : yarns.line_offsets[y + 1]][end],
            )
    assert (np.diff(drawn.line_offsets)[yarns.fabric < 0] >= 2).all(), "single yarns stay"
    assert set(yarns.fabric[line_yarns(drawn)]) == set(yarns.fabric), "and some yarn of each fabric"


@given(cloths)
def test_what_is_within_the_budget_is_drawn_as_it_is(yarns):
    assert coarse(yarns, Detail(segment_count(yarns), len(yarns.node_points))) is yarns
    assert statement(yarns, yarns, nodes=True).startswith("shown all")


@given(st.integers(2, 400), st.integers(0, 60), st.integers(0, 60), st.integers(1, 500))
def test_rare_states_are_kept_and_chosen_nodes_do_not_depend_on_order(side, eol_eil, eil_eil, budget):
    side = side // 10 + 2
    yarns = cloth(side, side)
    states = yarns.node_states.copy()
    states[:eol_eil] = NodeState.EOL_EIL
    states[len(states) - eil_eil :] = NodeState.EIL_EIL
    yarns = replace(yarns, node_states=states)
    drawn = coarse(yarns, Detail(1 << 40, budget))
    assert len(drawn.node_points) == min(budget, len(states))
    for state in (NodeState.EOL_EIL, NodeState.EIL_EIL):
        count = np.count_nonzero(states == state)
        assert np.count_nonzero(drawn.node_states == state) >= min(count, budget // len(NodeState))
    turned = replace(
        yarns, node_positions=yarns.node_positions[::-1], node_states=states[::-1], node_points=yarns.node_points[::-1]
    )
    assert set(coarse(turned, Detail(1 << 40, budget)).node_points) == set(drawn.node_points)


def test_a_coarse_cloth_is_a_cloth_of_every_fifth_yarn():
    yarns = cloth(101, 101)
    drawn = coarse(yarns, Detail(2000, 1 << 40))
    used = np.flatnonzero(np.diff(drawn.line_offsets))
    assert set(np.diff(used[used < 101])) == {5} and set(np.diff(used[used >= 101])) == {5}
    assert np.allclose(drawn.radius, 5 * yarns.radius)
    crossings = np.bincount(drawn.line_points)
    inner = np.ones(len(drawn.line_points), bool)
    inner[drawn.line_offsets[used]] = inner[drawn.line_offsets[used + 1] - 1] = False
    assert (crossings[drawn.line_points[inner]] == 2).all(), "nodes are crossings with yarns that are drawn"


@pytest.mark.parametrize("segments", [2, 5, 8])
def test_points_between_crossings_are_left_out_first(segments):
    yarns = divided(cloth(101, 101), segments)
    assert segment_count(yarns) == 2 * 101 * 100 * segments
    for budget, apart in ((2000, 5), (45_000, 1)):
        drawn = coarse(yarns, Detail(budget, 1 << 40))
        used = np.flatnonzero(np.diff(drawn.line_offsets))
        warps, wefts = used[used < 101], used[used >= 101] - 101
        assert set(np.diff(warps)) == {apart} and np.allclose(drawn.radius, apart * yarns.radius)
        crossings = (warps[:, None] * 101 + wefts).ravel()
        assert (np.bincount(drawn.line_points)[crossings] == 2).all(), "all crossings of what is drawn"
        assert segment_count(drawn) <= budget


def test_long_single_yarns_lose_nodes_not_thickness():
    yarns = cloth(2, 5000, singles=3)
    drawn = coarse(yarns, Detail(1000, 1 << 40))
    assert np.array_equal(drawn.radius[yarns.fabric < 0], yarns.radius[yarns.fabric < 0])
    steps = np.diff(drawn.line_positions[drawn.line_offsets[-2] : drawn.line_offsets[-1], 1])
    assert 1 < steps.max() <= 200


@settings(deadline=None)
@given(cloths, st.floats(0, 40), st.floats(0, 40), st.integers(20, 300))
def test_a_region_is_the_frame_itself_near_its_middle(yarns, x, y, budget):
    centre = np.array((x, y, 0.0))
    drawn = region(yarns, centre, Detail(budget, budget))
    assert len(drawn.line_positions) <= budget and len(drawn.node_points) <= budget
    assert np.array_equal(drawn.radius, yarns.radius) and len(drawn.line_offsets) == len(yarns.line_offsets)
    distance = np.linalg.norm(yarns.line_positions - centre, axis=1)
    assert np.linalg.norm(drawn.line_positions - centre, axis=1).min() == distance.min()
    for yarn in np.flatnonzero(np.diff(drawn.line_offsets)):
        mine = drawn.line_points[drawn.line_offsets[yarn] : drawn.line_offsets[yarn + 1]]
        whole = yarns.line_points[yarns.line_offsets[yarn] : yarns.line_offsets[yarn + 1]]
        first = int(np.flatnonzero(whole == mine[0])[0])
        assert np.array_equal(whole[first : first + len(mine)], mine), "one piece of the yarn"


@pytest.mark.parametrize(("level", "budget"), [("auto", AUTO), ("fine", FINE), ("region", AUTO)])
def test_the_largest_frame_passes_through_the_layers(level, budget):
    built, yarns = synthetic.large()
    assert segment_count(yarns) > 1_200_000 and len(yarns.node_points) > 645_000
    drawn = part(yarns, level, NOWHERE)
    laid = layout_of(load_scene(synthetic.LARGE_SCENE), built)(drawn, budget.segments)
    segments, points = layers.yarn_segments(laid), layers.node_points(drawn)
    assert 0.5 * budget.segments < len(segments.points) <= budget.segments * 1.01
    assert len(points.points) <= budget.nodes
    update = [*vars(shapes.tubes(segments)).values(), *vars(shapes.balls(points)).values()]
    assert sum(array.nbytes for array in update) < 5e6 and all(np.isfinite(array).all() for array in update)


def test_the_largest_cloth_is_still_a_plain_weave_where_contacts_have_no_eol_nodes():
    built, yarns = synthetic.large()
    assert np.isin([NodeState.EOL_EIL, NodeState.EIL_EIL], yarns.node_states).all()
    drawn = coarse(yarns, AUTO)
    laid = lay_out(drawn, 0, built.yarns, np.zeros(len(yarns.radius)))
    crossing = np.bincount(drawn.line_points)[drawn.line_points] == 2
    fabric = yarns.fabric[line_yarns(drawn)]
    pair_fabric = np.zeros(drawn.line_points.max() + 1, np.int64)
    np.maximum.at(pair_fabric, drawn.line_points, fabric)
    both = np.bincount(drawn.line_points, weights=fabric)[drawn.line_points] == 2 * pair_fabric[drawn.line_points]
    height = (laid.line_positions - drawn.line_positions)[:, 2]
    flat = np.linalg.norm(drawn.line_positions[:, :2], axis=1) < 0.045
    yarn = line_yarns(drawn)
    for y in np.unique(yarn)[::9]:
        above = height[(yarn == y) & crossing & both & flat] > 0
        assert (above[1:] != above[:-1]).all(), "over and under take turns"


def test_the_statement_says_how_much_is_shown():
    yarns = cloth(101, 101)
    said = statement(yarns, coarse(yarns, Detail(2000, 500)), nodes=True)
    assert re.fullmatch(r"shown [\d,]+ of 20,200 segments, 500 of 10,201 nodes; every 5th yarn, 5 times as thick", said)
