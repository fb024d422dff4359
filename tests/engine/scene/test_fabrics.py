"""Counts, stripes, seams and holds of woven patches."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.scene.build import build, estimate
from engine.scene.load import SceneError, load_scene
from engine.scene.stack import contact_count, touches
from engine.scene.weave import weave
from engine.yarns.model import PointKind
from tests.engine.scene.scenes import cloth, scene_of

THIN = {"radius": 1e-3, "linear_density": 2e-3, "stretch_stiffness": 3.0}
SCRIPT = {"handles": [{"name": name, "keyframes": [{"time": 1, "offset": [1, 0, 0]}]} for name in ("g", "h")]}


def built(**parts):
    return build(load_scene(scene_of(**parts)))


def held_at(made, handle):
    """Places of the points that a handle carries, sorted."""
    places = made.state.x[made.yarns.handle == handle][:, :2]
    return sorted(np.round(places, 9).tolist())


@settings(max_examples=30, deadline=None)
@given(warps=st.integers(2, 9), wefts=st.integers(2, 9), between=st.tuples(*[st.floats(1e-3, 1e-2)] * 2))
def test_warps_and_wefts_may_lie_at_different_distances(warps, wefts, between):
    made = built(fabrics=[cloth(warps=warps, wefts=wefts, spacing=list(between))])
    model, state = made.yarns, made.state
    along = np.repeat([between[1], between[0]], [warps, wefts])
    np.testing.assert_array_equal(model.rest_segment, along)
    np.testing.assert_allclose(model.length, along * np.repeat([wefts, warps], [warps, wefts]))
    for yarn in range(model.yarn_count):
        nodes = slice(model.node_start[yarn], model.node_start[yarn + 1])
        share = np.diff(state.u[nodes]) / along[yarn]
        np.testing.assert_allclose(share, [0.5] + [1.0] * (len(share) - 2) + [0.5])
        np.testing.assert_allclose(np.linalg.norm(np.diff(state.x[model.node_point[nodes]], axis=0), axis=1),
                                   np.diff(state.u[nodes]), rtol=1e-11)


def test_counts_per_inch():
    given_count = dict(cloth(), yarns_per_inch=[44, 22])
    del given_count["spacing"]
    made, wanted = (built(fabrics=[patch]) for patch in (given_count, cloth(spacing=[0.0254 / 44, 0.0254 / 22])))
    np.testing.assert_array_equal(made.state.x, wanted.state.x)
    given_count["yarns_per_inch"] = 10
    assert built(fabrics=[given_count]).yarns.rest_segment == pytest.approx(0.00254)


def test_stripes_repeat_over_the_yarns_of_a_family():
    made = built(fabrics=[cloth(warps=5, wefts=4, warp_stripes=["thin", "cotton-thick", "cotton-thick"],
                                weft_stripes=["cotton-thick", "thin"])], materials={"thin": THIN})
    thick = 2.25e-3
    assert made.yarns.radius.tolist() == [1e-3, thick, thick, 1e-3, thick, thick, 1e-3, thick, 1e-3]


@pytest.mark.parametrize("angle", [0.0, 90.0, 30.0])
def test_seams_sew_what_touches_within_them(angle):
    upper = cloth("b", warps=6, wefts=6, spacing=0.004, rotation=[0, 0, angle])
    seams = [{"edge": "left"}, {"edge": "bottom", "width": 0.003}]
    made = built(fabrics=[cloth("a", warps=12, wefts=12), upper],
                 contacts=[{"lower": "a", "upper": "b", "seams": seams}])
    model, state = made.yarns, made.state
    touching = np.isin(model.point_kind, (PointKind.CONTACT, PointKind.STITCH))
    turn = np.radians(angle)
    place = state.x[touching][:, :2] @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    sewn = (place[:, 0] <= -0.012 + 0.008) | (place[:, 1] <= -0.012 + 0.003)
    np.testing.assert_array_equal(model.point_kind[touching] == PointKind.STITCH, sewn)
    assert sewn.any() and not sewn.all()
    assert model.u_fixed[model.point_nodes[model.point_kind == PointKind.STITCH]].all()
    unsewn = built(fabrics=[cloth("a", warps=12, wefts=12), upper], contacts=[{"lower": "a", "upper": "b"}])
    assert unsewn.yarns.point_count == model.point_count


@pytest.mark.parametrize("edge, ends, beside", [
    ("left", [[-0.02, -0.015], [-0.02, -0.005], [-0.02, 0.005], [-0.02, 0.015]], [0.005, 0.0]),
    ("right", [[0.02, -0.015], [0.02, -0.005], [0.02, 0.005], [0.02, 0.015]], [-0.005, 0.0]),
    ("bottom", [[-0.015, -0.02], [-0.005, -0.02], [0.005, -0.02], [0.015, -0.02]], [0.0, 0.005]),
    ("top", [[-0.015, 0.02], [-0.005, 0.02], [0.005, 0.02], [0.015, 0.02]], [0.0, -0.005]),
])
def test_holds_carry_the_ends_on_an_edge(edge, ends, beside):
    patch = dict(warps=4, wefts=4, spacing=0.01)
    made = built(fabrics=[cloth(**patch, holds=[{"edge": edge, "handle": "h"}])], script=SCRIPT)
    assert held_at(made, 1) == ends
    assert not made.yarns.free_directions[made.yarns.handle == 1].any()
    made = built(fabrics=[cloth(**patch, holds=[{"edge": edge, "hold": "clamped", "handle": "h"}])], script=SCRIPT)
    assert held_at(made, 1) == sorted(ends + np.round(np.add(ends, beside), 9).tolist())
    clamped = made.yarns.point_nodes[(made.yarns.handle == 1) & (made.yarns.point_kind == PointKind.CROSSING)]
    assert not made.yarns.u_fixed[clamped].any(), "yarns slide through a clamped crossing as through any other"
    half = {"edge": edge, "extent": [0.5, 1.0], "handle": "g"}
    made = built(fabrics=[cloth(**patch, holds=[{"edge": edge, "handle": "h"}, half])], script=SCRIPT)
    assert (held_at(made, 1), held_at(made, 0)) == (ends[:2], ends[2:])
    made = built(fabrics=[cloth(**patch, holds=[{"edge": edge}], pins="corners")])
    assert (~made.yarns.free_directions.any(axis=(1, 2))).sum() == 8 + 2 and (made.yarns.handle == -1).all()


def test_holds_follow_an_outline():
    triangle = [[-0.02, -0.02], [0.02, -0.02], [0.0, 0.02]]
    made = built(fabrics=[cloth(warps=4, wefts=4, spacing=0.01, outline=triangle, holds=[{"edge": "top", "handle": "h"}])],
                 script=SCRIPT)
    assert held_at(made, 1) == [[-0.015, -0.01], [-0.005, 0.01], [0.005, 0.01], [0.015, -0.01]]


def test_yarns_within_reach_may_come_to_touch():
    fabrics = [cloth("a", warps=4, wefts=4, spacing=0.01), cloth("b", warps=3, wefts=3, spacing=0.01, position=[0.021, 0.003, 0])]
    contact = {"lower": "a", "upper": "b"}
    near = built(fabrics=fabrics, contacts=[contact])
    made = built(fabrics=fabrics, contacts=[contact | {"reach": 0.0105}])
    waiting = np.flatnonzero(~made.state.active)
    assert made.state.active.sum() == near.state.active.sum() and near.state.active.all()
    assert (made.yarns.point_kind[waiting] == PointKind.CONTACT).all()
    # along x, the second warp of b lies behind all wefts of a, and the third warp of a before all wefts of b; along y, the
    # first weft of a lies before the warps of b, of which the first crosses it within its ends
    assert len(waiting) == 4 + 3 + 1
    np.testing.assert_array_equal(made.yarns.side[made.state.active], near.yarns.side)
    nodes = made.yarns.point_nodes[waiting]
    length = made.yarns.length[made.yarns.node_yarn[nodes]]
    assert ((made.state.u[nodes] == 0.0) | (made.state.u[nodes] == length)).any(axis=1).all()


def test_contacts_at_any_angle_are_counted_without_looking_at_each():
    fabrics = [cloth("a", warps=600, wefts=600, spacing=0.001),
               cloth("b", warps=420, wefts=420, spacing=[0.0011, 0.0009], rotation=[0, 0, 20])]
    scene = load_scene(scene_of(fabrics=fabrics, contacts=[{"lower": "a", "upper": "b", "min_angle": 20}]))
    contact, (lower, upper) = scene.contacts[0], map(weave, scene.fabrics)
    tracemalloc.start()
    count = contact_count(contact, lower, upper)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert count > 245_000 and peak < 1e6
    assert count == sum(len(touch.below) for touch in touches(contact, lower, upper))


TRIANGLE = [[-0.01, -0.012], [0.011, -0.01], [0.0, 0.013]]
DART = [[-0.02, 0.0], [0.0, -0.01], [0.02, 0.0], [0.0, 0.03]]


@settings(max_examples=30, deadline=None)
@given(segments=st.integers(1, 8), warps=st.integers(6, 9), wefts=st.integers(6, 9),
       outline=st.sampled_from([None, TRIANGLE, DART]), between=st.tuples(*[st.floats(3e-3, 6e-3)] * 2))
def test_points_between_crossings_divide_yarns_evenly(segments, warps, wefts, outline, between):
    patch = cloth(warps=warps, wefts=wefts, spacing=list(between), outline=outline)
    scene = load_scene(scene_of(fabrics=[patch | {"segments_per_crossing": segments}]))
    made, undivided = build(scene), build(load_scene(scene_of(fabrics=[patch])))
    model, state, size = made.yarns, made.state, estimate(scene)
    assert (model.node_count, model.point_count) == (size.nodes, size.points)
    np.testing.assert_array_equal(state.x[: undivided.yarns.point_count], undivided.state.x)
    np.testing.assert_array_equal(model.crossing_spacing, undivided.yarns.rest_segment)
    np.testing.assert_allclose(model.rest_segment, model.crossing_spacing / segments)
    alone = np.arange(model.point_count) >= undivided.yarns.point_count
    assert (model.point_kind[alone] == PointKind.LAGRANGIAN).all() and (model.point_nodes[alone, 1] == -1).all()
    for yarn in range(model.yarn_count):
        nodes = slice(model.node_start[yarn], model.node_start[yarn + 1])
        length, crosses = np.diff(state.u[nodes]), np.flatnonzero(~model.u_fixed[nodes])
        assert (np.diff(crosses) == segments).all()
        np.testing.assert_allclose(length[crosses[0] : crosses[-1]], model.rest_segment[yarn])
        assert length.max() <= model.rest_segment[yarn] * (1 + 1e-9)
        np.testing.assert_allclose(np.linalg.norm(np.diff(state.x[model.node_point[nodes]], axis=0), axis=1), length, rtol=1e-9)


def test_points_between_crossings_are_held_with_what_is_clamped():
    patch = cloth(warps=4, wefts=4, spacing=0.01, segments_per_crossing=4)
    made = built(fabrics=[patch | {"holds": [{"edge": "left", "hold": "clamped", "handle": "h"}]}], script=SCRIPT)
    assert {x for x, _ in held_at(made, 1)} == {-0.02, -0.0175, -0.015} and len(held_at(made, 1)) == 4 * 3
    made = built(fabrics=[patch | {"holds": [{"edge": "left", "handle": "h"}]}], script=SCRIPT)
    assert {x for x, _ in held_at(made, 1)} == {-0.02}
    assert not built(fabrics=[patch | {"kinematic": True}]).yarns.free_directions.any()


def test_seams_and_contacts_leave_points_between_crossings_as_they_are():
    fabrics = [cloth("a", warps=8, wefts=8, segments_per_crossing=3),
               cloth("b", position=[0.0028, 0.0028, 0], segments_per_crossing=2)]
    made = built(fabrics=fabrics, contacts=[{"lower": "a", "upper": "b", "seams": [{"edge": "left"}]}])
    size = estimate(load_scene(scene_of(fabrics=fabrics, contacts=[{"lower": "a", "upper": "b"}])))
    assert (made.yarns.node_count, made.yarns.point_count) == (size.nodes, size.points)
    resting = made.state.eil & (made.yarns.point_kind == PointKind.LAGRANGIAN)[made.yarns.node_point]
    assert resting.any(), "contacts that are close to them push them aside"


@pytest.mark.parametrize("segments", [1, 2])
def test_crimp_raises_centre_lines_and_lengthens_yarns(segments):
    patch = cloth(warps=4, wefts=4, spacing=0.01, segments_per_crossing=segments)
    flat, bent, pressed = (built(fabrics=[patch | {"crimp": crimp}]).yarns for crimp in ("flat", "set", "free"))
    crossing = (flat.point_kind == PointKind.CROSSING)[flat.node_point]
    assert not flat.height.any() and not flat.set_angle.any() and not pressed.set_angle.any()
    for model in (bent, pressed):
        np.testing.assert_allclose(np.abs(model.height), np.where(crossing, model.radius[model.node_yarn], 0.0))
        assert (model.length > flat.length).all()
    assert (bent.set_angle[crossing] != 0.0).all() and not bent.set_angle[~crossing].any()


@pytest.mark.parametrize("segments", [0, 9, 1.5])
def test_numbers_of_segments_out_of_bounds_are_named(segments):
    with pytest.raises(SceneError, match=r"fabrics\[0\].segments_per_crossing"):
        load_scene(scene_of(fabrics=[cloth(segments_per_crossing=segments)]))
