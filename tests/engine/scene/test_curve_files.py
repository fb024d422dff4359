"""Strands from files: what is read, and what is refused."""

import json
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.scene.curve_files import CURVE_FILE_LIMIT, CURVE_POINT_LIMIT, curves_of_csv, curves_of_obj
from engine.scene.load import SceneError, load_scene
from tests.engine.scene.scenes import hair, scene_of

OBJ = """# two strands
v 0 0 0
v 0 0 1 1.0
v 0 1 1
l 1 2 3
g other
v 1 0 0
v 1 0 1
l -2 -1
l 5/1 2/2 1//1  # goes on
"""
CSV = "strand,x,y,z,width\na,0,0,0,1\nb,1,0,0,1\na,0,0,1,1\n\nb,1,0,1,1\na,0,1,1,1\n"


def saved(directory, name, content, **parts):
    (directory / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    path = directory / "scene.json"
    path.write_text(json.dumps(scene_of(strands=[hair(file=name, **parts)])))
    return path


def refusal(source):
    with pytest.raises(SceneError) as caught:
        load_scene(source)
    (problem,) = caught.value.problems
    return str(problem)


def test_lines_of_obj():
    assert curves_of_obj(OBJ.splitlines()) == [
        [(0, 0, 0), (0, 0, 1), (0, 1, 1)], [(1, 0, 0), (1, 0, 1), (0, 0, 1), (0, 0, 0)],
    ]


def test_tables():
    assert curves_of_csv(CSV.splitlines()) == [[(0, 0, 0), (0, 0, 1), (0, 1, 1)], [(1, 0, 0), (1, 0, 1)]]
    assert curves_of_csv(["z,strand,x,y", "3,0,1,2"]) == [[(1, 2, 3)]]


@pytest.mark.parametrize("name, content", [("hair.obj", OBJ), ("hair.csv", CSV), ("hair.CSV", "\ufeff" + CSV)])
def test_strands_are_read_from_beside_the_scene(tmp_path, name, content):
    scene = load_scene(saved(tmp_path, name, content, vertices=5))
    assert scene.strands[0].file is None and len(scene.strands[0].curves) == 2
    assert load_scene(scene.model_dump_json()) == scene, "the scene holds all that it needs"


HOSTILE = {
    "nothing": ("a.obj", "", "it has no curves"),
    "no lines": ("a.obj", "v 0 0 0\nv 0 0 1\nf 1 1 1\n", "it has no curves"),
    "noise": ("a.obj", b"\x00noise\xff" * 40, "it has no curves"),
    "words": ("a.obj", "v a b c\n", "line 1 has no three numbers"),
    "two numbers": ("a.obj", "v 1 2\n", "line 1 has no three numbers"),
    "infinity": ("a.obj", "v 1 2 1e999\n", "line 1 has a number that is not finite"),
    "one point": ("a.obj", "v 0 0 0\nl 1\n", "line 2 joins fewer than two points"),
    "no such point": ("a.obj", "v 0 0 0\nl 1 2\n", "line 2 joins points that are not there"),
    "point zero": ("a.obj", "v 0 0 0\nv 0 0 1\nl 0 1\n", "line 3 joins points that are not there"),
    "before the first": ("a.obj", "v 0 0 0\nv 0 0 1\nl -3 1\n", "line 3 joins points that are not there"),
    "point of words": ("a.obj", "v 0 0 0\nl 1 x\n", 'line 2 names a point "x"'),
    "point of 5,000 digits": ("a.obj", "v 0 0 0\nl 1 " + "9" * 5000, "line 2 names a point"),
    "many points": ("a.obj", "v 0 0 0\n" * (CURVE_POINT_LIMIT + 1), "it has more than 100,000 points"),
    "many lines": ("a.obj", "v 0 0 0\n" + "l 1 1 1\nl 2 1\n" * CURVE_POINT_LIMIT, "it has more than 100,000 points"),
    "a long line": ("a.obj", "v 0 0 0\nl " + "1 " * 1_000_000, "it has more than 100,000 points"),
    "no table": ("a.csv", "", "its first line does not name the column strand"),
    "no z": ("a.csv", "strand,x,y\n1,2,3\n", "its first line does not name the column z"),
    "table of noise": ("a.csv", b"strand,x,y,z\n\x00\xff,\x00,\x00,\x00\n", ""),
    "short row": ("a.csv", "strand,x,y,z\na,1,2\n", "line 2 has no three numbers"),
    "row of no strand": ("a.csv", "x,y,z,strand\n1,2,3\n", "line 2 is of no strand"),
    "not a number": ("a.csv", "strand,x,y,z\na,1,2,nan\n", "line 2 has a number that is not finite"),
    "no rows": ("a.csv", "strand,x,y,z\n", "it has no curves"),
    "endless field": ("a.csv", 'strand,x,y,z\n"' + "a" * 1_000_000, "field larger"),
    "many rows": ("a.csv", "strand,x,y,z\n" + "a,0,0,0\n" * (CURVE_POINT_LIMIT + 1), "it has more than 100,000 points"),
}


@pytest.mark.parametrize("name, content, message", HOSTILE.values(), ids=HOSTILE)
def test_files_that_hold_no_strands(tmp_path, name, content, message):
    said = refusal(saved(tmp_path, name, content))
    assert said.startswith(f'strands[0].file: "{name}" cannot be read as {name[-3:]}') and message in said


def test_files_elsewhere_or_of_other_kinds_are_not_read(tmp_path):
    below = tmp_path / "scenes"
    below.mkdir()
    (tmp_path / "hair.obj").write_text(OBJ)
    os.symlink(tmp_path / "hair.obj", below / "link.obj")
    os.symlink("circle.obj", below / "circle.obj")
    os.mkfifo(below / "pipe.obj")
    (below / "directory.obj").mkdir()
    path = below / "scene.json"

    def said(name):
        path.write_text(json.dumps(scene_of(strands=[hair(file=name)])))
        return refusal(path)

    for name in ("../hair.obj", str(tmp_path / "hair.obj"), "link.obj", "parts/../../hair.obj"):
        assert "is not beside the scene" in said(name), name
    for name in ("absent.obj", "circle.obj", "a\x00b.obj", "n" * 300 + ".obj"):
        assert "cannot be read" in said(name), name
    assert "is no file" in said("pipe.obj") and "is no file" in said("directory.obj")
    assert "obj, csv" in said("hair.usd") and "obj, csv" in said("scene.json")


def test_files_too_large_are_not_read(tmp_path):
    assert "is too large" in refusal(saved(tmp_path, "a.obj", b"#" * (CURVE_FILE_LIMIT + 1)))


def test_a_file_beside_curves_is_refused_unread(tmp_path):
    path = saved(tmp_path, "a.obj", "nothing", curves=[[[0, 0, 0], [0, 0, 1], [0, 1, 1]]])
    assert "exactly one of curves, file and groom" in refusal(path)


LINES = st.sampled_from(["v 0 0 1", "v 1 2", "l 1 2", "l -1 -2", "l", "v", "l 1 x", "#", "l 1 1", "v 1 1 1"])


@given(st.lists(LINES, max_size=8))
def test_any_obj_is_read_or_refused(lines):
    try:
        curves = curves_of_obj(lines)
    except ValueError as error:
        assert "line" in str(error)
    else:
        assert all(len(curve) >= 2 and np.isfinite(curve).all() for curve in curves)
