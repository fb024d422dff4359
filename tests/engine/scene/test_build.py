"""What scenes become: weaves, stacks, edges, rods, handles, obstacles."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine.contact.obstacles import ObstacleKind
from engine.scene.build import build, estimate
from engine.scene.load import load_scene, shipped_scenes
from engine.scene.materials import PRESETS, yarn_material
from engine.scene.size import part_sizes
from engine.yarns.assembly import YarnAssembly, YarnMaterial
from engine.yarns.model import PointKind
from tests.engine.scene.scenes import cloth, groom, rod, scene_of

ANGLES = st.tuples(*[st.floats(-180, 180)] * 3)


def built(**parts):
    return build(load_scene(scene_of(**parts)))


def points_of(model, kind):
    return np.flatnonzero(model.point_kind == kind)


def distance_to_yarn(model, state, yarn, u, x):
    """Distance of x from the place u on the straight yarn between its end points."""
    first, last = model.node_start[yarn], model.node_start[yarn + 1] - 1
    start, end = state.x[model.node_point[first]], state.x[model.node_point[last]]
    return np.linalg.norm(start + (u / model.length[yarn])[:, None] * (end - start) - x, axis=1)


@pytest.mark.parametrize("path", shipped_scenes().values(), ids=shipped_scenes())
def test_shipped_scenes_build_to_their_estimate(path):
    scene = load_scene(path)
    made, size = build(scene), estimate(scene)
    if made.yarns is not None:
        assert (made.yarns.node_count, made.yarns.point_count, 0, 0) == (
            size.nodes, size.points, size.strands, size.strand_vertices)
    elif made.liquid_state is not None:
        let_out = sum(part.particles for part in part_sizes(scene) if "sources" in part.path)
        assert len(made.liquid_state.x) == pytest.approx(size.particles - let_out, rel=0.02)
    else:
        assert (0, 0, len(made.strands.start) - 1, len(made.strands.mass)) == (
            size.nodes, size.points, size.strands, size.strand_vertices)
    for state in filter(None, (made.state, made.strand_state, made.liquid_state)):
        for values in (values for values in vars(state).values() if values is not None):
            assert np.isfinite(values).all()


@settings(max_examples=30, deadline=None)
@given(warps=st.integers(2, 9), wefts=st.integers(2, 9), rotation=ANGLES, spacing=st.floats(1e-3, 1e-2))
def test_a_patch_is_a_plain_weave_at_rest(warps, wefts, rotation, spacing):
    size = dict(warps=warps, wefts=wefts, spacing=spacing)
    made = built(fabrics=[cloth(**size, rotation=rotation, position=[0.1, 0.2, 0.3])])
    model, state = made.yarns, made.state
    assert model.yarn_count == warps + wefts
    assert len(points_of(model, PointKind.CROSSING)) == warps * wefts
    assert len(points_of(model, PointKind.LAGRANGIAN)) == 2 * (warps + wefts)
    np.testing.assert_allclose(model.length, [wefts * spacing] * warps + [warps * spacing] * wefts)
    np.testing.assert_allclose(state.x.mean(axis=0), [0.1, 0.2, 0.3], atol=1e-12)
    for yarn in range(model.yarn_count):
        nodes = slice(model.node_start[yarn], model.node_start[yarn + 1])
        x, u = state.x[model.node_point[nodes]], state.u[nodes]
        np.testing.assert_allclose(np.linalg.norm(np.diff(x, axis=0), axis=1), np.diff(u), rtol=1e-11)
        np.testing.assert_allclose(np.diff(u), [spacing / 2] + [spacing] * (len(u) - 3) + [spacing / 2])
        # under, over, under ...: slot 0 of a crossing is the lower yarn
        slots = model.node_slot[nodes][1:-1]
        assert (np.diff(slots) != 0).all()


def test_warps_lie_along_y_and_sides_point_up():
    made = built(fabrics=[cloth()])
    model, state = made.yarns, made.state
    ends = state.x[model.node_point[[model.node_start[0], model.node_start[1] - 1]]]
    np.testing.assert_allclose(np.diff(ends, axis=0)[0], [0, 5 * 0.0056, 0], atol=1e-15)
    for point in points_of(model, PointKind.CROSSING):
        tangents = [np.eye(3)[1 if model.node_yarn[node] < 4 else 0] for node in model.point_nodes[point]]
        assert model.side[point] * np.cross(*tangents)[2] > 0


@settings(max_examples=40, deadline=None)
@given(turn=ANGLES, angle=st.floats(-180, 180), offset=st.tuples(*[st.floats(-0.01, 0.01)] * 2))
def test_contacts_lie_on_both_yarns(turn, angle, offset):
    frame = Rotation.from_euler("xyz", turn, degrees=True)
    upper = (frame * Rotation.from_euler("z", angle, degrees=True)).as_euler("xyz", degrees=True)
    made = built(
        fabrics=[cloth("a", rotation=turn), cloth("b", rotation=upper.tolist(),
                                                   position=frame.apply([*offset, 0.0]).tolist())],
        contacts=[{"lower": "a", "upper": "b", "friction": 0.25}],
    )
    model, state = made.yarns, made.state
    contacts = points_of(model, PointKind.CONTACT)
    assert (model.friction[contacts] == 0.25).all()
    assert len(contacts) > 0
    for slot, fabric in enumerate((0, 1)):
        nodes = model.point_nodes[contacts, slot]
        yarns = model.node_yarn[nodes]
        assert (model.fabric[yarns] == fabric).all()
        assert (state.u[nodes] >= 0).all() and (state.u[nodes] <= model.length[yarns]).all()
        apart = [distance_to_yarn(model, state, y, state.u[[n]], state.x[[p]])[0]
                 for n, y, p in zip(nodes, yarns, contacts, strict=True)]
        assert max(apart) < 1e-12


def test_aligned_patches_touch_where_warps_cross_wefts():
    made = built(fabrics=[cloth("a"), cloth("b")], contacts=[{"lower": "a", "upper": "b"}])
    assert len(points_of(made.yarns, PointKind.CONTACT)) == 2 * 4 * 5, "nodes that coincide are kept"


@pytest.mark.parametrize("min_angle, families", [(20, 4), (45, 2), (80, 0)])
def test_least_angle_of_contacts(min_angle, families):
    made = built(fabrics=[cloth("a"), cloth("b", warps=2, wefts=2, rotation=[0, 0, 30])],
                 contacts=[{"lower": "a", "upper": "b", "min_angle": min_angle}])
    pairs = made.yarns.point_nodes[points_of(made.yarns, PointKind.CONTACT)]
    directions = made.yarns.node_yarn[pairs]
    is_warp = (directions < 4) | ((directions >= 9) & (directions < 11))
    assert len(np.unique(is_warp, axis=0)) == families


def test_layers_keep_less_distance_from_obstacles_the_higher_they_are():
    contacts = [{"lower": "a", "upper": "b"}, {"lower": "b", "upper": "c"}, {"lower": "a", "upper": "c"}]
    made = built(fabrics=[cloth("c"), cloth("b"), cloth("a"), cloth("d", obstacle_distance=0.01)], contacts=contacts)
    radius = PRESETS["cotton-thick"].radius
    np.testing.assert_allclose(made.yarns.obstacle_distance[::9], np.array([0.81, 0.9, 1.0, 0.01 / radius]) * radius)


def test_fixed_patches_do_not_move_nor_slide():
    made = built(fabrics=[cloth(kinematic=True)])
    assert made.yarns.kinematic.all() and not made.yarns.free_directions.any() and made.yarns.u_fixed.all()


@pytest.mark.parametrize("pins, count", [("none", 0), ("corners", 8), ("edges", 18)])
def test_pins(pins, count):
    made = built(fabrics=[cloth(pins=pins)])
    pinned = np.flatnonzero(~made.yarns.free_directions.any(axis=(1, 2)))
    assert len(pinned) == count and (made.yarns.point_kind[pinned] == PointKind.LAGRANGIAN).all()


def test_yarns_slide_over_the_edges_of_a_table():
    table = {"shape": "box", "size": [0.02, 0.02, 0.1], "position": [0, 0, -0.05], "friction": 0.7, "edges": True}
    parts = dict(fabrics=[cloth("a", warps=8, wefts=8, position=[0, 0, 0.002]),
                          cloth("b", warps=8, wefts=8, position=[0, 0, 0.002]),
                          cloth("far", position=[0, 0, 0.05]), cloth("rigid", position=[0, 0, 0.001], kinematic=True)],
                 contacts=[{"lower": "a", "upper": "b", "friction": 0.1}])
    made = built(**parts, obstacles=[table])
    model, state = made.yarns, made.state
    edges = points_of(model, PointKind.EDGE)
    # yarns at +-2.8 and +-8.4 mm lie within the table's 20 mm: 4 warps and 4 wefts over two edges each, in two layers
    assert len(edges) == 2 * 16
    x = state.x[edges]
    np.testing.assert_allclose(np.abs(x[:, :2]).max(axis=1), 0.01, atol=1e-15)
    np.testing.assert_allclose(x[:, 2], 0.002)
    for point in edges:
        across = np.argmax(np.abs(state.x[point, :2]))
        along = np.eye(3)[1 - across]
        np.testing.assert_allclose(model.free_directions[point], np.outer(along, along), atol=1e-15)
    fabric = model.fabric[model.node_yarn[model.point_nodes[edges, 0]]]
    np.testing.assert_array_equal(model.friction[edges], np.where(fabric == 0, 0.7, 0.1))
    table["edges"] = False
    assert not len(points_of(built(**parts, obstacles=[table]).yarns, PointKind.EDGE))


def test_rods_are_divided_evenly_and_may_be_slack():
    made = built(yarns=[rod(points=[[0, 0, 0], [1, 0, 0], [1, 3, 0]], segments=8, length_factor=1.2)])
    np.testing.assert_allclose(made.state.u, np.linspace(0, 4.8, 9))
    np.testing.assert_allclose(made.yarns.rest_segment, 0.6)
    np.testing.assert_allclose(np.linalg.norm(np.diff(made.state.x, axis=0), axis=1), 0.5)
    assert made.yarns.u_fixed.all() and made.yarns.length[0] == pytest.approx(4.8)


@pytest.mark.parametrize("hold, pinned", [("free", []), ("pinned", [0]), ("clamped", [0, 1])])
def test_ends(hold, pinned):
    made = built(
        yarns=[rod(segments=4, start={"hold": hold} | ({} if hold == "free" else {"handle": "h"}))],
        script={"handles": [{"name": "g", "keyframes": [{"time": 1, "offset": [1, 2, 3]}]},
                            {"name": "h", "keyframes": [{"time": 0, "offset": [0, 0, 0]},
                                                        {"time": 2, "offset": [2, 0, 0]}]}]},
    )
    assert np.flatnonzero(~made.yarns.free_directions.any(axis=(1, 2))).tolist() == pinned
    assert np.flatnonzero(made.yarns.handle == 1).tolist() == pinned
    np.testing.assert_allclose(made.handles.offsets(1.0), [[1, 2, 3], [1, 0, 0]])


def test_eyelets_and_crossings_take_the_place_of_fixed_points():
    made = built(
        yarns=[rod("a", points=[[0, 0, 0], [1, 0, 0], [2, 0, 0], [4, 0, 0]], eyelets=[{"point": 2, "friction": 0.2}]),
               rod("b", points=[[1, -1, 0], [1, 0, 0], [1, 1, 0]], kinematic=True)],
        crossings=[{"lower": {"yarn": "b", "point": 1}, "upper": {"yarn": "a", "point": 1}, "kind": "contact"}],
    )
    model, state = made.yarns, made.state
    assert np.bincount(model.point_kind).tolist() == [4, 0, 1, 1]
    np.testing.assert_allclose(state.u, [0, 1, 2, 4, 0, 1, 2])
    (contact,) = points_of(model, PointKind.CONTACT)
    assert model.node_yarn[model.point_nodes[contact]].tolist() == [1, 0]
    assert model.side[contact] == np.sign(np.cross([0, 1, 0], [1, 0, 0])[2])


TETRAHEDRON = {"vertices": [[0, 0, 0], [3, 0, 0], [0, 3, 0], [0, 0, 3]],
               "faces": [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]}


def test_obstacles_know_who_carries_them():
    handles = [{"name": name, "keyframes": [{"time": 0, "offset": [0, 0, 0]}]} for name in ("idle", "busy")]
    parts = {"fabrics": [cloth()], "script": {"handles": handles}}
    still, carried = {"shape": "plane"}, {"shape": "sphere", "radius": 2, "handle": "busy"}
    assert built(**parts, obstacles=[still, carried]).obstacles.handle.tolist() == [-1, 1]
    assert built(**parts, obstacles=[still]).obstacles.handle is None


def test_obstacles_are_packed():
    made = built(fabrics=[cloth()], obstacles=[
        {"shape": "plane", "rotation": [90, 0, 0]}, {"shape": "box", "size": [1, 2, 3], "position": [1, 1, 1]},
        {"shape": "sphere", "radius": 2, "friction": 0}, {"shape": "cylinder", "radius": 1, "height": 4},
        {"shape": "mesh", "position": [1, 0, 0], "rotation": [0, 0, 90], "resolution": 0.5, **TETRAHEDRON},
    ])
    assert made.obstacles.kind.tolist() == list(ObstacleKind)
    np.testing.assert_allclose(made.obstacles.size[:4], [[0, 0, 0], [0.5, 1, 1.5], [2, 0, 0], [1, 2, 0]])
    np.testing.assert_allclose(made.obstacles.rotation[0][:, 2], [0, -1, 0], atol=1e-15)
    assert made.obstacles.friction.tolist() == [0.5, 0.5, 0, 0.5, 0.5]
    assert (made.obstacles.size[4] > 1.5).all()
    np.testing.assert_allclose(made.obstacles.centre[4], [1 - 1.5, 1.5, 1.5])  # the middle, turned, and shifted


def test_materials():
    thick = yarn_material(PRESETS["cotton-thick"])
    area = np.pi * 2.25e-3**2
    assert thick.density == pytest.approx(770 * area) and thick.stretch_stiffness == pytest.approx(5e5 * area)
    assert thick.bending_stiffness == pytest.approx(1e5 * np.pi * 2.25e-3**4 / 4)
    own = built(fabrics=[cloth(weft_material="m")],
                materials={"m": {"radius": 1e-3, "linear_density": 2e-3, "stretch_stiffness": 3.0,
                                 "shear_stiffness": 0.02}}).yarns
    assert own.shear_stiffness[[3, 4]].tolist() == [0.0, 0.02]
    assert own.radius[[3, 4]].tolist() == [2.25e-3, 1e-3] and own.stretch_stiffness[4] == 3.0


def test_points_added_at_once_are_those_added_one_by_one():
    def assembly():
        made = YarnAssembly()
        for _ in range(3):
            made.yarn(YarnMaterial(radius=1e-3, density=1.0, stretch_stiffness=1.0), 1.0, 0.1)
        return made

    rng = np.random.default_rng(3)
    below, above = np.array([0, 1, 2, 0, 0]), np.array([1, 2, 0, 2, 1])
    u, v = np.round(rng.random((2, 5)), 1)
    x, up = rng.normal(size=(2, 5, 3))
    many, single = assembly(), assembly()
    many.crossings(below, u, above, v, x, up, 0.3, PointKind.CONTACT)
    many.lagrangians(np.arange(3), 0.0, x[:3], np.array([True, False, True]))
    for k in range(5):
        single.crossing(below[k], u[k], above[k], v[k], x[k], up[k], 0.3, PointKind.CONTACT)
    for k in range(3):
        single.lagrangian(k, 0.0, x[k], pinned=k != 1)
    for one, other in zip(many.build(), single.build(), strict=True):
        for name, values in vars(one).items():
            np.testing.assert_array_equal(values, getattr(other, name), err_msg=name)


def test_collisions_are_there_where_the_scene_asks_for_them():
    assert built(fabrics=[cloth()]).collisions is None
    asked = built(fabrics=[cloth()], contact={"self": True, "thickness": 0.5, "spacing": 1.0}).collisions
    assert (asked.thickness, asked.stiffness, asked.spacing, len(asked.kept)) == (0.5, 1.0, 1.0, 0)


@pytest.mark.parametrize("parts, absent", [
    ({"fabrics": [cloth()]}, ["engine.strands.assembly", "engine.scene.strands"]),
    ({"strands": [groom()]}, ["engine.yarns.topology", "engine.contact.sphere_packing", "engine.scene.yarns"]),
], ids=["yarns", "strands"])
def test_what_a_scene_does_not_have_is_not_imported(parts, absent):
    code = f"""
import sys
from engine.scene.build import build
from engine.scene.load import load_scene
build(load_scene({scene_of(**parts)!r}))
assert not set({absent!r}) & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], check=True)
