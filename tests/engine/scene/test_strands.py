"""Groups of strands become models and states: sections, rest shapes, what holds them and who carries it."""

import numpy as np
import pytest

from engine.contact.obstacles import posed
from engine.geometry.near_segments import near_pairs
from engine.geometry.segment_distance import nearest_on_segments
from engine.geometry.solids import distance_to
from engine.scene.build import build
from engine.scene.load import load_scene, shipped_scenes
from engine.scene.materials import PRESETS, Material
from engine.scene.strands import strand_material
from engine.strands.handles import given
from tests.engine.scene.scenes import groom, hair, scene_of

BENT = [[0, 0, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1]]
RADIUS, DENSITY, YOUNG = 4e-5, 1300.0, 3e9
HANDLES = {"handles": [{"name": name, "keyframes": [{"time": 0}, {"time": 1, "offset": [0, 0, k], "rotation": [0, 0, 90 * k]}]}
                       for k, name in enumerate(("still", "lift"))]}


def built(*groups, **parts):
    return build(load_scene(scene_of(strands=list(groups), **parts)))


def curves(**parts):
    return hair(curves=[BENT], **parts)


def test_hair():
    material = strand_material(PRESETS["hair"])
    assert (material.density, material.young, material.damping) == (DENSITY, YOUNG, 1e-4)
    assert material.shear == pytest.approx(YOUNG / 2.7)


def test_figures_per_length_are_those_of_the_section():
    per_length = Material(radius=RADIUS, linear_density=2e-6, stretch_stiffness=3.0, poisson_ratio=0.5)
    for width in (1.0, 3.0):
        area = np.pi * RADIUS**2 * width
        material = strand_material(per_length, width)
        assert material.density * area == pytest.approx(2e-6) and material.young * area == pytest.approx(3.0)
        assert material.shear == pytest.approx(material.young / 3)


def test_curves_keep_their_points_or_get_even_ones():
    made = built(curves(), hair("more", curves=[BENT, BENT], vertices=7))
    assert made.yarns is None and made.state is None and made.collisions is None
    assert made.strands.start.tolist() == [0, 4, 11, 18] and made.strands.group.tolist() == [0, 1, 1]
    np.testing.assert_array_equal(made.strand_state.x[:4], BENT)
    np.testing.assert_allclose(made.strand_state.x[4:11:2], BENT, atol=1e-15)
    np.testing.assert_allclose(made.strands.rest_length[4:10], 0.5)


def test_scenes_of_yarns_have_no_strands():
    made = build(load_scene(shipped_scenes()["chain-over-peg"]))
    assert made.strands is None and made.strand_state is None and made.strand_drag is None


def test_sections():
    model = built(curves(tip_ratio=0.5, width_ratio=2.0)).strands
    np.testing.assert_allclose(model.radius[:3, 0], RADIUS * (1 - 0.5 * (np.arange(3) + 0.5) / 3))
    np.testing.assert_allclose(model.radius[:, 1], 2 * model.radius[:, 0])
    assert model.mass.sum() == pytest.approx(DENSITY * np.pi * model.radius[:3].prod(axis=1).sum())
    straight = built(curves()).strands
    np.testing.assert_allclose(straight.bending_stiffness[1:3], YOUNG * np.pi * RADIUS**4 / 4)


def test_a_normal_says_where_the_first_axis_points():
    for normal, expected in (([1, 0, 5], [1, 0, 0]), ([0, -2, 0], [0, -1, 0])):
        np.testing.assert_allclose(built(curves(normal=normal)).strand_state.m1[0], expected, atol=1e-12)
    along = built(curves(normal=[0, 0, 1])).strand_state.m1[0]
    assert np.linalg.norm(along) == pytest.approx(1.0) and along[2] == pytest.approx(0.0)


def test_rest_shapes():
    as_is, straight = built(curves()).strands, built(curves(rest="straight")).strands
    assert np.abs(as_is.rest_curvature[1:3]).max() == pytest.approx(2.0)
    np.testing.assert_allclose(straight.rest_curvature, 0.0, atol=1e-9)
    np.testing.assert_allclose(straight.rest_length, as_is.rest_length)


def test_strands_are_still_and_at_rest_at_the_start():
    state = built(groom(curl={"radius": 0.01, "pitch": 0.05})).strand_state
    for name, values in vars(state).items():
        assert np.isfinite(values).all(), name
    assert not state.velocity.any() and not state.spin.any()


@pytest.mark.parametrize("root, tip, places, turns", [
    ("free", "free", [], []), ("pinned", "free", [0], []), ("clamped", "free", [0, 1], [0]),
    ("free", "pinned", [3], []), ("free", "clamped", [2, 3], [2]), ("clamped", "clamped", [0, 1, 2, 3], [0, 2]),
])
def test_ends(root, tip, places, turns):
    ends = {name: {"hold": hold} | ({} if hold == "free" else {"handle": handle})
            for name, hold, handle in (("root", root, "still"), ("tip", tip, "lift"))}
    model = built(curves(**ends), script=HANDLES).strands
    assert np.flatnonzero(model.held[:, 0]).tolist() == places
    np.testing.assert_array_equal(model.held[:, 1:3], model.held[:, :2])
    assert np.flatnonzero(model.held[:, 3]).tolist() == turns
    expected = np.full(4, -1)
    expected[[p for p in places if p < 2]], expected[[p for p in places if p >= 2]] = 0, 1
    assert model.handle.tolist() == expected.tolist()


def test_handles_carry_and_turn_what_they_hold():
    made = built(curves(tip={"hold": "clamped", "handle": "lift"}), curves() | {"name": "free"}, script=HANDLES)
    x, turn = given(made.strands, made.strand_state, made.handles, 0.0, 1.0)
    np.testing.assert_allclose(x[2:4], [[-1, 0, 2], [-1, 1, 2]], atol=1e-12)
    np.testing.assert_array_equal(np.delete(x, [2, 3], axis=0), np.delete(made.strand_state.x, [2, 3], axis=0))
    assert not turn[[0, 1, 4, 5]].any()


BALL = {"name": "ball", "shape": "sphere", "radius": 0.1, "handle": "lift"}


@pytest.mark.parametrize("root, handle, held", [
    ({}, 1, 2), ({"hold": "pinned"}, 1, 1), ({"handle": "still"}, 0, 2), ({"hold": "free"}, -1, 0),
])
def test_roots_of_a_groom_are_clamped_and_go_with_their_ground(root, handle, held):
    model = built(groom(on="ball") | {"root": root}, obstacles=[BALL], script=HANDLES).strands
    assert model.held[:, :3].all(axis=1).sum() == 20 * held
    assert set(model.handle[model.held[:, 0]].tolist()) == ({handle} if held else set())
    assert (model.handle[~model.held[:, 0]] == -1).all()


def test_roots_on_a_ground_of_their_own_stay():
    model = built(groom()).strands
    assert model.held[:, :3].all(axis=1).sum() == 40 and (model.handle == -1).all()


def test_drag_is_there_where_a_material_has_some():
    still = {"radius": 1e-3, "volume_density": 1e3, "youngs_modulus": 1e6}
    materials = {"still": still, "dragged": still | {"mass_damping": 3.0}}
    one, other = curves() | {"material": "still"}, curves() | {"material": "dragged", "name": "other"}
    assert built(one, materials=materials).strand_drag is None
    made = built(one, other, materials=materials)
    np.testing.assert_allclose(made.strand_drag, np.repeat([0.0, 3.0], 4) * made.strands.mass)


def test_settings_and_frictions_reach_the_engine():
    made = built(curves(friction=0.7), strand_step={"cohesion": 0.05, "contact": "penalty"})
    assert made.strands.friction.tolist() == [0.7]
    assert (made.strand_settings.cohesion, made.strand_settings.contact) == (0.05, "penalty")


def test_meshes_are_grounds_and_obstacles_of_strands():
    cube = {"vertices": [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)],
            "faces": [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                      [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]}
    made = built(groom(on="cube", facing=[0, 0, 1], within=10),
                 obstacles=[{"name": "cube", "shape": "mesh", "resolution": 0.1, "position": [0, 0, 2]} | cube])
    root = made.strand_state.x[made.strands.start[:-1]]
    np.testing.assert_allclose(root[:, 2], 3.0)
    assert made.obstacles.surfaces is not None


STRAND_SCENES = [name for name, path in shipped_scenes().items() if '"strands"' in path.read_text()]


@pytest.mark.parametrize("name", STRAND_SCENES)
def test_shipped_strands_begin_apart(name):
    """No two are nearer than they are thick, those without contact excepted, nor is one where it passes itself."""
    made = build(load_scene(shipped_scenes()[name]))
    model, x = made.strands, made.strand_state.x
    edge = np.delete(np.arange(len(x)), model.start[1:] - 1)
    radius = model.radius[edge].max(axis=1)
    pairs = edge[near_pairs(x, np.zeros_like(x), edge, radius)]
    strand = np.repeat(np.arange(len(model.group)), np.diff(model.start))[pairs]
    pairs = pairs[(strand[:, 0] != strand[:, 1]) | (np.abs(pairs[:, 0] - pairs[:, 1]) > 2)]
    near = [(i, j) for i, j in pairs.tolist()
            if nearest_on_segments(x[i], x[i + 1], x[j], x[j + 1])[2] < model.radius[[i, j]].max(axis=1).sum() ** 2]
    assert not near or made.strand_settings.contact == "none"


@pytest.mark.parametrize("name", STRAND_SCENES)
def test_shipped_strands_begin_outside_of_obstacles(name):
    made = build(load_scene(shipped_scenes()[name]))
    solids, normal = posed(made.obstacles, made.handles, 0.0), np.empty(3)
    for x, held, radius in zip(made.strand_state.x, made.strands.held[:, 0], made.strands.radius.max(axis=1), strict=True):
        for o in range(len(solids.kind)):
            assert distance_to(solids, o, x, normal) > (-1e-12 if held else radius)
