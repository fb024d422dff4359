"""Meshes that change their shape: how scenes say so, what of it is read from files, and what is refused."""

import json

import numpy as np
import pytest
import trimesh

from engine.scene.build import build
from engine.scene.load import SceneError, load_scene
from engine.scene.mesh_shapes import STRIDE
from tests.engine.scene.scenes import groom, scene_of

BOX = trimesh.creation.box((0.2, 0.1, 0.1))
VERTICES, FACES = np.array(BOX.vertices), BOX.faces.tolist()
WIDER = VERTICES * [1.1, 1.1, 1.0]
HANDLE = {"handles": [{"name": "own", "keyframes": [{"time": 0.0}]}]}


def furry(shapes, strands=None, **mesh):
    body = {"name": "body", "shape": "mesh", "shapes": shapes} | (mesh or {"vertices": VERTICES.tolist(), "faces": FACES})
    return scene_of(strands=[strands or groom(on="body")], obstacles=[body], script=HANDLE)


def shape(time=0.5, vertices=WIDER, **more):
    return {"time": time, "vertices": np.asarray(vertices).tolist()} | more


def moved(way):
    return VERTICES + np.array([way, 0.0, 0.0])


def refusals(source) -> list[str]:
    with pytest.raises(SceneError) as caught:
        load_scene(source)
    return [str(problem) for problem in caught.value.problems]


def test_roots_of_grooms_are_held_by_what_changes():
    made = build(load_scene(furry([shape(0.5), shape(0.9, VERTICES)])))
    (held,) = made.strand_roots
    assert held.obstacle == 0
    np.testing.assert_array_equal(held.vertex, np.flatnonzero(made.strands.held[:, :3].all(axis=1)))
    np.testing.assert_allclose(held.at(made.obstacles, made.handles, 0.0)[0], made.strand_state.x[held.vertex], atol=1e-15)
    surface, shapes = made.obstacles.surfaces, made.obstacles.surfaces.shapes[0]
    assert shapes.time.tolist() == [0.0, 0.5, 0.9]
    np.testing.assert_allclose(np.ptp(surface.vertices(0, 0.5), axis=0), [0.22, 0.11, 0.1])
    np.testing.assert_allclose(np.ptp(surface.vertices(0, 0.25), axis=0), [0.21, 0.105, 0.1])


@pytest.mark.parametrize("root, held", [({}, 2), ({"hold": "pinned"}, 1), ({"hold": "free"}, 0)])
def test_what_is_held_is_what_the_root_says(root, held):
    made = build(load_scene(furry([shape()], groom(on="body") | {"root": root})))
    assert len(made.strand_roots[0].vertex) == 20 * held


def test_roots_with_a_handle_of_their_own_go_with_that():
    assert build(load_scene(furry([shape()], groom(on="body") | {"root": {"handle": "own"}}))).strand_roots == ()
    assert build(load_scene(furry([], groom(on="body")))).strand_roots == ()


@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "glb"])
def test_shapes_are_read_from_beside_the_scene(tmp_path, kind):
    for name, vertices in (("body", VERTICES), ("wider", WIDER)):
        trimesh.Trimesh(vertices, FACES, process=False).export(tmp_path / f"{name}.{kind}")
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(furry([{"time": 1, "file": f"wider.{kind}"}], file=f"body.{kind}")))
    scene = load_scene(path)
    assert load_scene(scene.model_dump_json()) == scene, "the scene holds all that it needs"
    surface = build(scene).obstacles.surfaces
    np.testing.assert_allclose(np.ptp(surface.vertices(0, 1.0), axis=0), [0.22, 0.11, 0.1], rtol=1e-6)
    assert len(surface.vertices(0, 1.0)) == 8
    middle = np.ptp(surface.vertices(0, 0.5), axis=0)
    np.testing.assert_allclose(middle, [0.21, 0.105, 0.1], rtol=1e-6, err_msg="corners go to their own places")


def test_files_with_other_triangles(tmp_path):
    BOX.export(tmp_path / "body.obj")
    trimesh.Trimesh(WIDER, FACES[::-1], process=False).export(tmp_path / "order.obj")
    trimesh.creation.icosphere(subdivisions=1).export(tmp_path / "ball.obj")
    (tmp_path / "noise.obj").write_bytes(b"\x00noise\xff" * 40)
    for name in ("order", "ball"):
        (tmp_path / "scene.json").write_text(json.dumps(furry([{"time": 1, "file": f"{name}.obj"}], file="body.obj")))
        (said,) = refusals(tmp_path / "scene.json")
        assert said.startswith("obstacles[0].shapes[0].file") and "has other triangles than the mesh" in said
    (tmp_path / "scene.json").write_text(json.dumps(furry([{"time": 1, "file": "noise.obj"}], file="body.obj")))
    assert refusals(tmp_path / "scene.json")[0].startswith("obstacles[0].shapes[0].file")


@pytest.mark.parametrize("shapes, path, said", [
    ([{"time": 1, "file": "wider.obj"}], "obstacles[0].shapes[0].file", "is not read for a scene that does not come from a file"),
    ([shape(file="wider.obj")], "obstacles[0].shapes[0].file", "stands beside vertices"),
    ([shape(vertices=WIDER[1:])], "obstacles[0].shapes[0].vertices", "has 7"),
    ([{"time": 1}], "obstacles[0].shapes[0].vertices", "has 0"),
    ([shape(0.0)], "obstacles[0].shapes[0].time", "cannot be 0"),
    ([shape(0.5), shape(0.5)], "obstacles[0].shapes[1].time", "is 0.5 s"),
    ([shape(vertices=VERTICES * [1.0, 1.0, 0.0])], "obstacles[0].shapes[0].vertices", "from where it was"),
    ([shape(vertices=moved(1.01 * STRIDE * 0.1))], "obstacles[0].shapes[0].vertices", "from where it was"),
    ([shape(), shape(1.0, vertices=WIDER[[1, 1, 2, 3, 4, 5, 6, 7]])], "obstacles[0].shapes[1].vertices", "without area"),
], ids=lambda value: value if isinstance(value, str) else "")
def test_shapes_that_are_refused(shapes, path, said):
    assert any(problem.startswith(path) and said in problem for problem in refusals(furry(shapes)))
    for wrong in ("text", {"time": 1}, [1, "x"], [{"time": 1, "file": 3}]):
        assert refusals(furry(wrong))


def test_a_body_may_go_far_in_several_shapes():
    far = [shape(0.1 * k, moved(0.9 * STRIDE * 0.1 * k)) for k in range(1, 4)]
    assert len(load_scene(furry(far)).obstacles[0].shapes) == 3
