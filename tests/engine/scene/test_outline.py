"""Patches cut to polygons, against loops over crossings and sides."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from engine.scene.build import build, estimate
from engine.scene.load import load_scene
from engine.scene.outline import LEAST_END, cut, touching_sides
from engine.scene.weave import weave
from engine.yarns.model import PointKind
from tests.engine.scene.scenes import cloth, scene_of

COUNTS, SPACINGS = (9, 8), (0.01, 0.012)
GRID = dict(warps=9, wefts=8, spacing=[0.01, 0.012])


@st.composite
def outlines(draw):
    """Star-shaped polygons, mostly concave, about a point near the centre; some with corners on yarns and crossings."""
    n = draw(st.integers(3, 9))
    angles = (np.arange(n) + np.array(draw(st.lists(st.floats(0.05, 0.9), min_size=n, max_size=n)))) * 2 * np.pi / n
    radii = np.array(draw(st.lists(st.floats(0.01, 0.08), min_size=n, max_size=n)))
    corners = np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])
    if draw(st.booleans()):
        corners = np.round(corners / [0.01, 0.006]) * [0.01, 0.006]
    assume(next(touching_sides(corners), None) is None and cut(corners, COUNTS, SPACINGS)[0].any())
    return corners


def is_inside(outline, place):
    """Whether a place lies in a polygon, by winding; None on or near its boundary."""
    total = 0.0
    for p, q in zip(outline - place, np.roll(outline, -1, axis=0) - place, strict=True):
        along = np.clip(-(p @ (q - p)) / ((q - p) @ (q - p)), 0, 1)
        if np.linalg.norm(p + along * (q - p)) < 1e-9:
            return None
        total += np.arctan2(p[0] * q[1] - p[1] * q[0], p @ q)
    return abs(total) > np.pi


def crosses(outline, start, end):
    """Whether the straight line between two places meets the polygon's boundary well between them."""
    line = end - start
    for p, q in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        matrix = np.column_stack([line, p - q])
        if abs(np.linalg.det(matrix)) > 1e-12:
            s, t = np.linalg.solve(matrix, p - start)
            if 1e-6 < s < 1 - 1e-6 and 1e-6 < t < 1 - 1e-6:
                return True
    return False


@settings(deadline=None)
@given(outlines())
def test_crossings_inside_are_kept_and_yarns_follow_the_outline(outline):
    kept, warps, wefts = cut(outline, COUNTS, SPACINGS)
    corner = -np.multiply(COUNTS, SPACINGS) / 2
    for i, j in np.ndindex(*COUNTS):
        inside = is_inside(outline, corner + (np.array([i, j]) + 0.5) * SPACINGS)
        assert inside is None or inside == kept[i, j]
    for axis, pieces, mine in ((0, warps, kept), (1, wefts, kept.T)):
        spacing, seen = SPACINGS[1 - axis], np.zeros_like(mine, int)
        at = (np.arange(mine.shape[1]) + 0.5) * spacing
        for line, low, high in zip(pieces.line, pieces.low, pieces.high, strict=True):
            within = np.flatnonzero((low < at) & (at < high))
            assert len(within) and mine[line, within].all()
            seen[line, within] += 1
            for end in (at[within[0]] - low, high - at[within[-1]]):
                assert (LEAST_END - 1e-9) * spacing <= end <= (0.5 + 1e-9) * spacing
            ends = np.full((2, 2), (line + 0.5) * SPACINGS[axis])
            ends[:, 1 - axis] = at[within[[0, -1]]]
            assert len(within) == 1 or not crosses(outline, *(corner + ends))
        np.testing.assert_array_equal(seen, mine)
        assert (np.diff(pieces.line) >= 0).all()


@settings(max_examples=30, deadline=None)
@given(outlines(), outlines(), st.floats(-180, 180))
def test_patches_with_outlines_build_to_their_estimate(lower, upper, angle):
    fabrics = [cloth("a", **GRID, outline=lower.tolist()),
               cloth("b", **GRID, outline=upper.tolist(), rotation=[0, 0, angle], position=[0.003, 0.001, 0])]
    table = {"shape": "box", "size": [0.04, 0.04, 0.02], "position": [0, 0, -0.01], "edges": True}
    scene = load_scene(scene_of(fabrics=[*fabrics, cloth("c")], obstacles=[table], contacts=[
        {"lower": "a", "upper": "b", "seams": [{"edge": "left"}]}, {"lower": "b", "upper": "c"}]))
    made, size = build(scene), estimate(scene)
    assert (made.yarns.node_count, made.yarns.point_count) == (size.nodes, size.points)
    model, state = made.yarns, made.state
    ends = np.flatnonzero(model.u_fixed[model.node_start[:-1]] & (state.u[model.node_start[:-1]] == 0))
    assert len(ends) == model.yarn_count, "every yarn begins with its end"
    for yarn in range(model.yarn_count):
        nodes = np.arange(model.node_start[yarn], model.node_start[yarn + 1])
        x = state.x[model.node_point[nodes]]
        np.testing.assert_allclose(np.linalg.norm(x - x[0], axis=1), state.u[nodes], atol=1e-12)
        assert state.u[nodes[-1]] == model.length[yarn]


def test_contacts_of_patches_with_outlines_are_those_of_whole_ones_on_their_yarns():
    notched = [[-0.04, -0.04], [0.04, -0.04], [0.04, 0.04], [0.011, 0.041], [0.0, -0.02], [-0.011, 0.04]]
    parts = dict(contacts=[{"lower": "a", "upper": "b", "min_angle": 20}])
    upper = cloth("b", warps=6, wefts=6, spacing=0.007, rotation=[0, 0, 25], position=[0.002, 0.013, 0])
    whole = build(load_scene(scene_of(fabrics=[cloth("a", **GRID), upper], **parts)))
    part = build(load_scene(scene_of(fabrics=[cloth("a", **GRID, outline=notched), upper], **parts)))
    patch = weave(load_scene(scene_of(fabrics=[cloth("a", **GRID, outline=notched)])).fabrics[0])

    def places(made):
        return made.state.x[made.yarns.point_kind == PointKind.CONTACT][:, :2]

    def on_a_yarn(place):
        for axis, family in enumerate(patch.families):
            across = family.lines.start[axis] + family.pieces.line * family.lines.pitch
            along = place[1 - axis] - family.lines.start[1 - axis]
            if (np.abs(across - place[axis]) < 1e-9)[(family.pieces.low < along) & (along < family.pieces.high)].any():
                return True
        return False

    kept = [place for place in places(whole) if on_a_yarn(place)]
    assert 0 < len(kept) < len(places(whole))
    np.testing.assert_allclose(np.sort(places(part), axis=0), np.sort(kept, axis=0), atol=1e-12)


def test_a_slit_between_two_warps_cuts_the_wefts_that_it_meets():
    slit = [[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [0.001, 0.05], [0.0, 0.0], [-0.001, 0.05], [-0.05, 0.05]]
    patch = weave(load_scene(scene_of(fabrics=[cloth("a", warps=8, wefts=8, spacing=0.01, outline=slit)])).fabrics[0])
    assert patch.crossing_count == 64 and patch.warps.count == 8
    assert patch.wefts.pieces.line.tolist() == [0, 1, 2, 3, 4, 4, 5, 5, 6, 6, 7, 7]


@pytest.mark.parametrize("outline, sides", [
    ([[0, 0], [1, 0], [1, 1], [0, 1]], None),
    ([[0, 0], [2, 0], [2, 2], [1, 0.5], [0, 2]], None),
    ([[0, 0], [1, 1], [1, 0], [0, 1]], (0, 2)),
    ([[0, 0], [2, 0], [2, 2], [1, 0], [0, 2]], (0, 2)),
    ([[0, 0], [1, 0], [0.5, 0], [0.5, 1]], (0, 1)),
    ([[0, 0], [1, 0], [1, 1], [1, 1], [0, 1]], (1, 3)),
    ([[0, 0], [0, 1], [0, 2]], (0, 2)),
])
def test_sides_that_meet(outline, sides):
    assert next(touching_sides(np.array(outline, float)), None) == sides
