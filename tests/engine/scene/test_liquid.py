"""Liquids of scenes become models and states of the volume that is asked for; wrong ones are refused by path."""

import json
import tracemalloc

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from engine.contact.obstacles import ObstacleKind, posed
from engine.geometry.solids import distance_to
from engine.liquid.sources import emitted
from engine.scene.build import build, estimate
from engine.scene.liquid import LiquidBall, LiquidBox, LiquidCylinder
from engine.scene.liquid_seeding import expected_count, holds, seeded
from engine.scene.load import SceneError, load_scene
from tests.engine.scene.scenes import block, cloth, groom, liquid

D = 0.005  # pitch of 8 particles in a cell of 0.01
RANDOM = np.random.default_rng
SIDE = st.floats(0.01, 0.1)
WAY = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda way: np.linalg.norm(way) > 0.1)
ICOSPHERE = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
BALL_MESH = {"vertices": ICOSPHERE.vertices.tolist(), "faces": ICOSPHERE.faces.tolist()}
LIFT = {"handles": [{"name": "lift", "keyframes": [{"time": 0}, {"time": 1, "offset": [0, 0, 1]}]}]}


def built(source):
    return build(load_scene(source))


def nozzle(**parts):
    opening = {} if "rectangle" in parts else {"radius": 0.02}
    return {"centre": [0, 0, 0.3], "direction": [0, 0, -2], "speed": 0.5} | opening | parts


def shapes():
    return st.one_of(
        st.builds(lambda low, size: LiquidBox(shape="box", low=low, high=tuple(np.add(low, size))), WAY, st.tuples(*[SIDE] * 3)),
        st.builds(lambda centre, radius: LiquidBall(shape="ball", centre=centre, radius=radius), WAY, SIDE),
        st.builds(lambda centre, axis, radius, height: LiquidCylinder(
            shape="cylinder", centre=centre, axis=axis, radius=radius, height=height), WAY, WAY, SIDE, SIDE),
    )


@settings(deadline=None)
@given(shapes(), st.sampled_from([0.0, 0.5]))
def test_a_shape_has_its_volume_evenly(shape, jitter):
    x, volume = seeded(shape, D, jitter, RANDOM(0))
    if isinstance(shape, LiquidBox):
        whole = np.prod(np.subtract(shape.high, shape.low))
    elif isinstance(shape, LiquidBall):
        whole = 4 / 3 * np.pi * shape.radius**3
    else:
        whole = np.pi * shape.radius**2 * shape.height
    assert volume.sum() == pytest.approx(whole) and np.ptp(volume) == 0.0
    assert len(x) == pytest.approx(expected_count(shape, D), rel=0.5)
    assert 0.45 < volume[0] / D**3 < 1.9
    # no place is off by more than the lattice was drawn apart
    nearer = type(shape).model_validate({**dict(shape), **(
        {"low": tuple(np.subtract(shape.low, D)), "high": tuple(np.add(shape.high, D))} if isinstance(shape, LiquidBox)
        else {"radius": shape.radius + D, **({"height": shape.height + D} if isinstance(shape, LiquidCylinder) else {})})})
    assert holds(nearer, x).all()
    if jitter == 0.0:
        np.testing.assert_allclose(x.mean(axis=0), _middle(shape), atol=1e-12)
        if len(x) > 1:
            assert cKDTree(x).query(x, k=2)[0][:, 1].min() > 0.65 * D


def _middle(shape):
    return np.add(shape.low, shape.high) / 2 if isinstance(shape, LiquidBox) else shape.centre


def test_a_box_of_whole_cells_has_its_particles_on_the_lattice():
    made = built(liquid(block()))
    x, volume = made.liquid_state.x, made.liquid_state.volume
    np.testing.assert_allclose(np.sort(np.unique(x[:, 0].round(9))), np.arange(20) * D + D / 2)
    assert len(x) == 20 * 10 * 8 and volume == pytest.approx(D**3)
    twenty_seven = built(liquid(block(particles_per_cell=27)))
    assert len(twenty_seven.liquid_state.x) == 30 * 15 * 12
    assert len(built(liquid(block(), particles_per_cell=1)).liquid_state.x) == 10 * 5 * 4


def test_jitter_is_repeatable_and_bounded():
    straight, *shaken = (built(liquid(block(), jitter=jitter, seed=seed)).liquid_state.x
                         for jitter, seed in ((0, 0), (0.4, 1), (0.4, 1), (0.4, 2)))
    np.testing.assert_array_equal(shaken[0], shaken[1])
    assert not np.array_equal(shaken[0], shaken[2])
    assert 0.19 * D < np.abs(shaken[0] - straight).max() <= 0.2 * D


def test_a_wave_stretches_what_is_below_it():
    amplitude, wavelength = 0.004, 0.1
    wave = {"amplitude": amplitude, "wavelength": wavelength}
    flat, waved = built(liquid(block())).liquid_state, built(liquid(block(wave=wave))).liquid_state
    crest = amplitude * np.cos(2 * np.pi * flat.x[:, 0] / wavelength)
    np.testing.assert_allclose(waved.x[:, :2], flat.x[:, :2])
    np.testing.assert_allclose(waved.x[:, 2], flat.x[:, 2] * (1 + crest / 0.04))
    np.testing.assert_allclose(waved.volume, flat.volume * (1 + crest / 0.04))
    assert waved.volume.sum() == pytest.approx(flat.volume.sum())


def test_meshes_are_filled_where_they_stand(tmp_path):
    turned = {"shape": "mesh", "position": [0.3, 0.2, 0.1], "rotation": [0, 40, 0]}
    made = built(liquid(turned | BALL_MESH))
    assert np.linalg.norm(made.liquid_state.x - [0.3, 0.2, 0.1], axis=1).max() <= 0.05
    assert made.liquid_state.volume.sum() == pytest.approx(ICOSPHERE.volume, rel=0.03)
    assert estimate(load_scene(liquid(turned | BALL_MESH))).particles == pytest.approx(len(made.liquid_state.x), rel=0.03)
    ICOSPHERE.export(tmp_path / "ball.obj")
    (tmp_path / "scene.json").write_text(json.dumps(liquid(turned | {"file": "ball.obj"})))
    from_file = built(tmp_path / "scene.json")
    np.testing.assert_allclose(np.sort(from_file.liquid_state.x, axis=0), np.sort(made.liquid_state.x, axis=0), atol=1e-6)


def test_liquid_is_in_one_place_once():
    ball = {"shape": "ball", "centre": [0.1, 0.025, 0.02], "radius": 0.03}
    cylinder = {"shape": "cylinder", "centre": [0, 0, 0], "radius": 0.03, "height": 0.2}
    mesh = {"shape": "mesh", "position": [0.05, 0, 0], **BALL_MESH}
    listed = [block(), ball, cylinder, mesh]
    shapes = load_scene(liquid(*listed)).liquid.initial
    x = built(liquid(*listed)).liquid_state.x
    alone = np.cumsum([len(built(liquid(shape)).liquid_state.x) for shape in listed])
    assert 1600 == alone[0] < len(x) < alone[-1]
    first = [0, *(len(built(liquid(*listed[:k])).liquid_state.x) for k in (1, 2, 3, 4))]
    for k, earlier in enumerate(shapes):
        assert holds(earlier, x[first[k] : first[k + 1]]).mean() > 0.8  # a round lattice may reach a little out of it
        assert not holds(earlier, x[first[k + 1] :]).any()
    assert len(built(liquid(block(), block())).liquid_state.x) == len(built(liquid(block())).liquid_state.x)
    waved = LiquidBox(shape="box", low=(0, 0, 0), high=(1, 1, 1), wave={"amplitude": 0.5, "wavelength": 2.0})
    np.testing.assert_array_equal(holds(waved, np.array([[0.01, 0.5, 1.4], [0.99, 0.5, 0.6], [0.99, 0.5, 0.4]])), [1, 0, 1])


def test_there_is_no_liquid_in_obstacles_nor_behind_walls():
    low, high = [-0.02, 0, 0.01], [0.06, 0.05, 0.08]
    source = liquid(block([-0.1] * 3, [0.1] * 3), tank={"low": low, "high": high}) | {
        "obstacles": [{"shape": "sphere", "radius": 0.02, "position": [0.03, 0.02, 0.04]}]}
    x = built(source).liquid_state.x
    assert (x >= low).all() and (x[:, :2] <= high[:2]).all() and x[:, 2].max() > 0.09, "the top is open"
    assert np.linalg.norm(x - [0.03, 0.02, 0.04], axis=1).min() >= 0.02


def test_shapes_move_as_they_are_told():
    made = built(liquid(block(velocity=[1, 2, 3], angular_velocity=[0, 0, 180])))
    state, spin = made.liquid_state, np.array([0, 0, np.pi])
    turning = np.cross(spin, state.x - [0.05, 0.025, 0.02])
    np.testing.assert_allclose(state.velocity - turning, np.tile([1, 2, 3], (len(state.x), 1)), atol=1e-12)
    np.testing.assert_allclose(np.einsum("nij,j->ni", state.affine, [1.0, 2.0, 3.0]),
                               np.tile(np.cross(spin, [1.0, 2.0, 3.0]), (len(state.x), 1)), atol=1e-12)


def test_state_has_what_the_material_needs():
    water, mud, cream = (built(liquid(block(), material=name)) for name in ("water", "drilling-mud", "shaving-cream"))
    assert water.liquid_state.strain is water.liquid_state.compression is water.liquid_state.plastic_strain is None
    assert mud.liquid_state.compression is None and (cream.liquid_state.compression == 1).all()
    for made in (mud, cream):
        assert (made.liquid_state.strain == [1, 1, 1, 0, 0, 0]).all() and (made.liquid_state.plastic_strain == 0).all()
    assert [made.liquid.no_slip for made in (water, mud, cream)] == [False, True, True]
    assert built(liquid(block(), walls="no-slip")).liquid.no_slip
    assert not built(liquid(block(), material="shaving-cream", walls="slip")).liquid.no_slip
    assert water.liquid.density == 1000.0 and np.isinf(water.liquid.bulk_modulus) and water.yarns is None
    own = built(liquid(block(), material="mine") | {"liquid_materials": {"mine": {"density": 1234.0}}})
    assert own.liquid.density == 1234.0


def test_a_tank_has_walls_where_it_is_not_open():
    tank = {"low": [-0.1, 0, 0], "high": [0.22, 0.08, 0.3]}
    corners = np.array([tank["low"], tank["high"]])
    made = built(liquid(block(), tank=tank) | {"obstacles": [{"shape": "plane", "handle": "lift"}], "script": LIFT})
    solids, normal = posed(made.liquid_obstacles, made.handles, 0.0), np.empty(3)
    assert len(made.obstacles.kind) == 1 and (solids.kind == ObstacleKind.PLANE).all()
    assert made.liquid_obstacles.handle.tolist() == [0] + [-1] * 5
    for x in RANDOM(0).uniform(corners[0] - 0.05, corners[1] + 0.05, (200, 3)):
        inward = np.concatenate([x - corners[0], (corners[1] - x)[:2]])
        assert min(distance_to(solids, o, x, normal) for o in range(1, 6)) == pytest.approx(inward.min())
    assert made.liquid.origin.tolist() == tank["low"]
    sealed = built(liquid(block(), tank=tank | {"open": []}, periodic=["x", "y"]))
    assert sealed.liquid.period.tolist() == [32, 8, 0]
    np.testing.assert_allclose(sealed.liquid_obstacles.rotation[:, :, 2], [[0, 0, 1], [0, 0, -1]])


def test_walls_stand_beside_meshes():
    made = built(liquid(block(), tank={"low": [0, 0, 0], "high": [1, 1, 1]}) | {
        "obstacles": [{"shape": "mesh", "position": [0.5, 0.5, 0.5], **BALL_MESH}]})
    solids, normal = posed(made.liquid_obstacles, made.handles, 0.0), np.empty(3)
    assert len(solids.lattice) == 6
    assert distance_to(solids, 0, np.array([0.5, 0.5, 0.56]), normal) == pytest.approx(0.01, abs=1e-3)
    assert distance_to(solids, 5, np.array([0.5, 0.5, 0.56]), normal) == pytest.approx(0.56)


def test_what_repeats_is_within_one_period():
    bounds = {"low": [0, 0, -1], "high": [0.08, 0.04, 1]}
    made = built(liquid(block([-0.02, 0.01, 0], [0.04, 0.03, 0.05]), bounds=bounds, periodic=["x", "y"]))
    assert made.liquid.period.tolist() == [8, 4, 0]
    x = made.liquid_state.x
    assert x[:, 0].min() >= 0 and x[:, 0].max() < 0.08 and (x[:, 0] > 0.06).sum() == pytest.approx(len(x) / 3)
    assert (made.liquid.low[2], made.liquid.high[2]) == (-1, 1)


@settings(deadline=None)
@given(shapes())
def test_the_box_around_a_shape_is_that_of_its_particles(shape):
    made = built(liquid(shape.model_dump(mode="json", exclude_none=True), spacing=0.004))
    low, high = made.liquid_state.x.min(axis=0), made.liquid_state.x.max(axis=0)
    np.testing.assert_allclose(made.liquid.origin, low, atol=0.008)
    assert (low > made.liquid.low).all() and (high < made.liquid.high).all()


def test_bounds_are_far_away_by_default():
    made = built(liquid(block(), sources=[nozzle()]) | {"obstacles": [{"shape": "plane", "position": [0, 0, -1]}]})
    np.testing.assert_allclose(made.liquid.low, [-26 - 0.0, -26, -27], atol=0.5)
    np.testing.assert_allclose(made.liquid.high, [26.1, 26.05, 26.3], atol=0.5)
    assert made.liquid.origin.tolist() == [0, 0, -1], "the low corner of what is there"


@pytest.mark.parametrize("parts, area, end", [
    ({"radius": 0.02, "end": 0.43}, np.pi * 0.02**2, 0.43), ({"radius": 0.001, "end": 0.4}, np.pi * 0.001**2, 0.4),
    ({"rectangle": [0.02, 0.013], "end": 0.37}, 0.02 * 0.013, 0.37), ({"radius": 0.02}, np.pi * 0.02**2, 1.0),
])
def test_nozzles_let_out_area_times_speed_times_time(parts, area, end):
    made = built(liquid(sources=[nozzle(begin=0.2, **parts)]))
    layers, volume = made.liquid_state.emitted, 0.0
    for step in range(100):
        out = emitted(made.sources, layers, made.handles, 0.01 * step, 0.01)
        layers, volume = out.layers, volume + out.volume.sum()
    assert volume == pytest.approx(area * 0.5 * (end - 0.2))
    assert len(made.liquid_state.x) == 0
    assert (out.x[:, 2] < 0.3).all() and made.sources.volume == pytest.approx(D**3, rel=1.0)


def test_openings_face_where_they_flow():
    made = built(liquid(sources=[nozzle(direction=way, rectangle=[0.04, 0.02]) for way in ([0, 0, -1], [0, 3, 0], [-1, 0, 0])]
                        + [nozzle(handle="lift")], sinks=[{"low": [0, 0, 0], "high": [1, 1, 1]}]) | {"script": LIFT})
    extents = [np.ptp(place, axis=0) for place in made.sources.place]
    np.testing.assert_allclose(extents[:3], [[0.035, 0.015, 0], [0.035, 0, 0.015], [0, 0.035, 0.015]], atol=1e-12)
    np.testing.assert_allclose(made.sources.flow, [[0, 0, -1], [0, 1, 0], [-1, 0, 0], [0, 0, -1]])
    assert made.sources.handle.tolist() == [-1, -1, -1, 0] and made.sinks.high.tolist() == [[1, 1, 1]]


TANK = {"low": [0, 0, 0], "high": [0.1, 0.08, 0.1]}
CYLINDER = {"shape": "cylinder", "centre": [0, 0, 0], "radius": 1, "height": 1}
WRONG = {
    "no liquid": (liquid(), "liquid", "holds nothing", "initial or sources"),
    "unknown liquid": (liquid(block(), material="watr"), "liquid.material",
                       'there is no liquid material "watr"; did you mean water?', "milk-cream"),
    "beside cloth": (liquid(block()) | {"fabrics": [cloth()]}, "liquid", "stands beside yarns", "obstacles"),
    "beside hair": (liquid(block()) | {"strands": [groom()]}, "liquid", "stands beside yarns", "obstacles"),
    "contact of yarns": (liquid(block()) | {"contact": {"self": True}}, "contact.self", "is about yarns only", "false"),
    "nine particles": (liquid(block(), particles_per_cell=9), "liquid.particles_per_cell", "cannot be 9", "1, 8, 27 or 64"),
    "box inside out": (liquid(block(high=[1, 0, 1])), "liquid.initial[0]", "its keys contradict", "low less than that of high"),
    "wave to the ground": (liquid(block(wave={"amplitude": 0.1, "wavelength": 1})), "liquid.initial[0]", "its keys contradict",
                           "less than the height"),
    "unknown shape": (liquid({"shape": "sphere"}), "liquid.initial[0].shape", 'cannot be "sphere"', "ball"),
    "huge": (liquid(block(high=[1e300, 1, 1])), "liquid.initial[0].high[0]", "cannot be 1e+300", "1000000"),
    "NaN": (liquid(block(), spacing=float("nan")), "liquid.spacing", "cannot be NaN", "finite"),
    "tiny cells": (liquid(block(), spacing=1e-9), "liquid.spacing", "the box that the liquid may be in ends", "1,000,000"),
    "many particles": (liquid(block(high=[1, 1, 1]), spacing=1e-3), "liquid.initial[0]", "the liquid has 8e+09 particles",
                       "20,000,000"),
    "tiny cells within bounds": (liquid(block(), spacing=1e-9, bounds=TANK), "liquid.bounds", "the box", "narrower"),
    "far from the tank": (liquid(block(), bounds={"low": [0, 0, 1e5], "high": [1, 1, 2e5]}, tank=TANK), "liquid.bounds",
                          "the box that the liquid may be in ends 2e+07 cells away", "narrower"),
    "flood": (liquid(sources=[nozzle(speed=1e9)]), "liquid.sources[0]", "the liquid has", "20,000,000"),
    "axis without way": (liquid(CYLINDER | {"axis": [0, 0, 0]}), "liquid.initial[0].axis", "has no length", "way"),
    "flow without way": (liquid(sources=[nozzle(direction=[0, 0, 0])]), "liquid.sources[0].direction", "has no length", "way"),
    "opening twice": (liquid(sources=[nozzle() | {"rectangle": [1, 1]}]), "liquid.sources[0]", "its keys contradict",
                      "exactly one"),
    "end before begin": (liquid(sources=[nozzle(begin=1, end=0.5)]), "liquid.sources[0].end", "is 0.5 s", "more than begin"),
    "unknown handle": (liquid(sources=[nozzle(handle="h")]), "liquid.sources[0].handle", 'there is no handle "h"', "none"),
    "unknown side": (liquid(block(), tank=TANK | {"open": ["up"]}), "liquid.tank.open[0]", 'cannot be "up"', "'top'"),
    "ten cells": (liquid(block(), tank=TANK, periodic=["y", "x"]), "liquid.periodic[1]", "the tank has 10 cells along x",
                  "4 cells, or a multiple of 8"),
    "half a cell": (liquid(block(), bounds={"low": [0, 0, 0], "high": [0.085, 1, 1]}, periodic=["x"]), "liquid.periodic[0]",
                    "bounds have 8.5 cells along x", "4 cells"),
    "axis twice": (liquid(block(), tank=TANK, periodic=["y", "y"]), "liquid.periodic[1]", "repeats y", "once"),
    "nothing repeats": (liquid(block(), periodic=["x"]), "liquid.periodic[0]", "does not say after which length", "tank"),
    "explicit and incompressible": (liquid(block()) | {"liquid_step": {"pressure": "explicit"}}, "liquid_step.pressure",
                                    "is explicit, but water is incompressible", "bulk_modulus"),
    "mesh from nowhere": (liquid({"shape": "mesh", "file": "a.obj"}), "liquid.initial[0].file", "is not read",
                          "vertices and faces"),
    "mesh without body": (liquid({"shape": "mesh"}), "liquid.initial[0]", "has no body", "four"),
    "open mesh": (liquid({"shape": "mesh"} | BALL_MESH | {"faces": BALL_MESH["faces"][1:]}), "liquid.initial[0]",
                  "is not watertight", "closed"),
    "mesh full of places": (liquid({"shape": "mesh"} | BALL_MESH, spacing=5e-4), "liquid.initial[0]", "has 6.4e+07 places",
                            "40,000,000"),
}


@pytest.mark.parametrize("source, path, message, allowed", WRONG.values(), ids=WRONG)
def test_wrong_liquids(source, path, message, allowed):
    tracemalloc.start()
    with pytest.raises(SceneError) as caught:
        load_scene(source)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    (problem,) = caught.value.problems
    assert problem.path == path
    assert problem.message.startswith(message)
    assert allowed in (problem.allowed or "")
    assert peak < 50e6, "sizes are found without building"
