"""What is drawn of many strands: within the budget, some of every group, as they are or as thick as those they stand for."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.run.frames import StrandFrame
from tests.viewer import strands as made
from viewer import layers, shapes
from viewer.detail import AUTO, FINE
from viewer.strand_detail import PIECES, coarse, extent, part, region, segment_count, vertex_strands

NOWHERE = np.zeros(3)


@st.composite
def tufts(draw) -> StrandFrame:
    """Strands of different lengths in groups of different sizes, side by side along y, one straight line of z each."""
    counts = draw(st.lists(st.integers(2, 400), min_size=1, max_size=60))
    groups = draw(st.lists(st.integers(0, 4), min_size=len(counts), max_size=len(counts)))
    y = np.repeat(np.arange(len(counts)), counts)
    z = np.concatenate([np.arange(n) for n in counts])
    values = z.astype(np.float32)
    return StrandFrame(
        np.stack([0 * y, y, z], axis=1).astype(np.float32), np.cumsum([0, *counts]), np.full(len(z), 0.1, np.float32),
        np.array(groups), values, values, values,
    )


def strand(strands: StrandFrame, number: int) -> np.ndarray:
    return strands.positions[strands.offsets[number] : strands.offsets[number + 1]]


@settings(deadline=None)
@given(tufts(), st.integers(800, 8000))
def test_budgets_are_kept_and_ends_stay(strands, segments):
    drawn = coarse(strands, segments)
    assert 0 < segment_count(drawn) <= segments
    assert len(drawn.offsets) == len(drawn.group) + 1 and drawn.offsets[-1] == len(drawn.positions)
    assert len({len(values) for name, values in vars(drawn).items() if name not in ("offsets", "group")}) == 1
    for number in range(len(drawn.group)):
        mine = strand(drawn, number)
        whole = strand(strands, int(mine[0, 1]))
        assert np.array_equal(mine[[0, -1]], whole[[0, -1]])
        assert len(mine) >= min(len(whole), PIECES + 1), "curls are not lost"
        assert drawn.group[number] == strands.group[int(mine[0, 1])]
    if segments > 2 * PIECES * len(set(strands.group)):
        assert set(drawn.group) == set(strands.group)


@settings(deadline=None)
@given(tufts())
def test_what_is_within_the_budget_is_drawn_as_it_is(strands):
    assert coarse(strands, segment_count(strands)) is strands
    assert part(strands, "full", NOWHERE).strands is strands


def test_vertices_of_long_strands_are_left_out_first():
    strands = made.curled(50, 1001)
    drawn = coarse(strands, 20_000)
    assert len(drawn.group) == 50 and set(np.diff(drawn.offsets)) == {335}
    assert (drawn.radius == strands.radius[0]).all()


def test_strands_that_are_drawn_have_the_section_of_all_in_their_group():
    strands = replace(made.curled(6000, 16), group=np.array([0] * 5990 + [1] * 10))
    drawn = coarse(strands, 9000)
    assert np.diff(drawn.offsets).tolist() == [16] * 600
    first = drawn.offsets[:-1]
    for group in (0, 1):
        whole = np.count_nonzero(strands.group == group) * 4e-5**2
        assert np.sum(drawn.radius[first][drawn.group == group].astype(float) ** 2) == pytest.approx(whole, rel=1e-4)
    assert np.count_nonzero(drawn.group == 1) == 1, "a small group is not lost"


def test_strands_that_are_drawn_are_spread_evenly_and_the_same_in_every_frame():
    strands = made.large()
    drawn = coarse(strands, 20_000)
    for axis in range(3):
        middle = np.median(strands.positions[::16, axis])
        assert 0.47 < np.mean(drawn.positions[drawn.offsets[:-1], axis] > middle) < 0.53
    later = coarse(replace(strands, positions=strands.positions + np.float32(0.1), strain=-strands.strain), 20_000)
    assert np.array_equal(later.group, drawn.group) and np.allclose(later.positions, drawn.positions + 0.1, atol=1e-6)
    finer = coarse(strands, 60_000)
    roots = {tuple(root) for root in finer.positions[finer.offsets[:-1]].tolist()}
    assert all(tuple(root) in roots for root in drawn.positions[drawn.offsets[:-1]].tolist()), "finer adds to coarser"


@settings(deadline=None)
@given(tufts(), st.floats(0, 60), st.floats(0, 400), st.integers(20, 2000))
def test_a_region_is_the_frame_itself_near_its_middle(strands, y, z, vertices):
    centre = np.array((0.0, y, z))
    drawn = region(strands, centre, vertices)
    assert len(drawn.positions) <= vertices
    if not len(drawn.positions):
        return  # more than that are equally near
    distance = np.linalg.norm(strands.positions - centre, axis=1)
    assert np.linalg.norm(drawn.positions - centre, axis=1).min() == pytest.approx(distance.min(), abs=1e-4)
    for number in range(len(drawn.group)):
        mine = strand(drawn, number)
        assert len(set(mine[:, 1])) == 1 and (np.diff(mine[:, 2]) == 1).all(), "a piece of one strand without gaps"
        assert drawn.group[number] == strands.group[int(mine[0, 1])]


@pytest.mark.parametrize(("level", "budget"), [("auto", AUTO), ("fine", FINE), ("region", AUTO)])
@pytest.mark.parametrize("paint", ["group", "force"])
def test_the_largest_frame_passes_through_the_layers(level, budget, paint):
    strands = made.large()
    drawn = part(strands, level, np.array((0.0, 0.0, 0.1))).strands
    segments = layers.strand_segments(drawn, paint, layers.paint_limit(strands, paint), budget.segments)
    assert 0.5 * budget.segments < len(segments.points) <= budget.segments
    update = vars(shapes.tubes(segments)).values()
    assert sum(array.nbytes for array in update) < 5e6 and all(np.isfinite(array).all() for array in update)


def test_what_is_drawn_is_said():
    strands = made.large()
    said = part(strands, "auto", NOWHERE).said
    assert said.startswith("shown 19,995 of 480,000 segments; 1,333 of 32,000 strands, as thick as all of them together")
    assert part(strands, "full", NOWHERE).said == "shown all 480,000 segments"
    assert part(strands, "region", NOWHERE).said.startswith("shown 1")


@pytest.mark.parametrize("level", ["auto", "fine"])
def test_thin_strands_are_drawn_thick_enough_to_be_seen_and_that_is_said(level):
    hair = made.curled(100, 16)
    drawn = part(hair, level, NOWHERE)
    assert np.allclose(drawn.strands.radius, extent(hair) / 3000) and "none drawn thinner than 0." in drawn.said
    thick = replace(hair, radius=np.full_like(hair.radius, 1e-3))
    assert np.array_equal(part(thick, level, NOWHERE).strands.radius, thick.radius)
    assert part(thick, level, NOWHERE).said == "shown all 1,500 segments"
    for real in ("region", "full"):
        assert np.array_equal(part(hair, real, NOWHERE).strands.radius, hair.radius)


def test_every_vertex_knows_its_strand():
    assert vertex_strands(made.curled(3, 4)).tolist() == [0] * 4 + [1] * 4 + [2] * 4
