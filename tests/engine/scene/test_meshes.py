"""Meshes of obstacles: which files are read, and what is refused."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import trimesh

from engine.scene.build import build
from engine.scene.load import SceneError, load_scene
from engine.scene.meshes import FILE_TYPES
from tests.engine.scene.scenes import cloth, scene_of

BOX = trimesh.creation.box((0.2, 0.1, 0.1))
INLINE = {"vertices": BOX.vertices.tolist(), "faces": BOX.faces.tolist()}


def with_mesh(**mesh):
    return scene_of(fabrics=[cloth()], obstacles=[{"shape": "mesh", **mesh}])


def saved(directory: Path, **mesh) -> Path:
    path = directory / "scene.json"
    path.write_text(json.dumps(with_mesh(**mesh)))
    return path


def refusal(source) -> str:
    with pytest.raises(SceneError) as caught:
        load_scene(source)
    (problem,) = caught.value.problems
    return str(problem)


@pytest.mark.parametrize("kind", FILE_TYPES)
def test_a_mesh_is_read_from_beside_the_scene(tmp_path, kind):
    (tmp_path / "parts").mkdir()
    BOX.export(tmp_path / "parts" / f"box.{kind}")
    scene = load_scene(saved(tmp_path, file=f"parts/box.{kind}"))
    assert load_scene(scene.model_dump_json()) == scene, "the scene holds all that it needs"
    surface = build(scene).obstacles.surfaces.surface[0]
    np.testing.assert_allclose(surface.extent, [0.2, 0.1, 0.1], rtol=1e-6)
    assert len(surface.vertices) == 8


def test_files_elsewhere_are_not_read(tmp_path):
    below = tmp_path / "scenes"
    below.mkdir()
    BOX.export(tmp_path / "box.stl")
    os.symlink(tmp_path / "box.stl", below / "link.stl")
    for name in ("../box.stl", str(tmp_path / "box.stl"), "link.stl", "parts/../../box.stl"):
        assert "is not beside the scene" in refusal(saved(below, file=name)), name


def test_files_that_are_no_meshes(tmp_path):
    for kind in FILE_TYPES:
        (tmp_path / f"noise.{kind}").write_bytes(b"\x00noise\xff" * 40)
        assert refusal(saved(tmp_path, file=f"noise.{kind}")).startswith("obstacles[0]")
    assert "No such file" in refusal(saved(tmp_path, file="absent.stl"))
    assert "stl, obj, ply, glb" in refusal(saved(tmp_path, file="scene.json"))


def test_a_scene_from_nowhere_reads_no_files():
    for source in (with_mesh(file="box.stl"), json.dumps(with_mesh(file="/etc/passwd.stl"))):
        assert refusal(source).startswith("obstacles[0].file: is not read")


@pytest.mark.parametrize(("mesh", "path", "message"), [
    ({}, "obstacles[0]", "has no body"),
    (INLINE | {"file": "box.stl"}, "obstacles[0].file", "stands beside"),
    (INLINE | {"faces": [*INLINE["faces"], [0, 1, 8]]}, "obstacles[0].faces", "one has vertex 8"),
    (INLINE | {"faces": INLINE["faces"][1:]}, "obstacles[0]", "is not watertight"),
    (INLINE | {"faces": [INLINE["faces"][0][::-1], *INLINE["faces"][1:]]}, "obstacles[0]", "is not watertight"),
    (INLINE | {"vertices": (BOX.vertices * [1, 1, 0]).tolist()}, "obstacles[0]", ""),
    (INLINE | {"resolution": 1e-9}, "obstacles[0].resolution", "1e-09 m takes"),
    (INLINE | {"resolution": 1e-4}, "obstacles[0].resolution", "0.0001 m takes"),
], ids=["empty", "both", "index", "open", "turned", "flat", "finest", "too fine"])
def test_bodies_that_are_none(mesh, path, message):
    assert refusal(with_mesh(**mesh)).startswith(f"{path}: {message}")


def test_a_surface_turned_inside_out_is_turned_back():
    built = build(load_scene(with_mesh(**INLINE | {"faces": [face[::-1] for face in INLINE["faces"]]})))
    samples = built.obstacles.surfaces.samples(0.0).reshape(built.obstacles.surfaces.lattice[0, 1:])
    assert samples[tuple(n // 2 for n in samples.shape)] == pytest.approx(-0.05, abs=0.005)
    assert samples[0, 0, 0] > 0.0
