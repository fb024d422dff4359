"""Good scenes load, hostile ones are refused with the path and what is allowed."""

import json
import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.scene.build import estimate
from engine.scene.load import SceneError, load_scene, shipped_scenes
from engine.scene.schema import Scene
from engine.scene.size import part_sizes
from tests.engine.scene.scenes import cloth, groom, hair, rod, scene_of


def problems(source, overrides=()):
    with pytest.raises(SceneError) as caught:
        load_scene(source, overrides)
    assert str(caught.value) and str(caught.value).encode()
    return caught.value.problems


def only_problem(source, overrides=()):
    (problem,) = problems(source, overrides)
    return problem


def with_cloth(**parts):
    return scene_of(fabrics=[cloth(**parts)])


def with_rod(**parts):
    return scene_of(yarns=[rod(**parts)])


def with_groom(**parts):
    return scene_of(strands=[groom(**parts)])


def with_curve(*points, **parts):
    return scene_of(strands=[hair(curves=[points or [[0, 0, 0], [0, 0, 1], [0, 1, 1]]], **parts)])


@pytest.mark.parametrize("name, path", shipped_scenes().items())
def test_shipped_scenes_load_and_survive_a_round_trip(name, path):
    scene = load_scene(path)
    assert scene.name == name
    assert load_scene(scene.model_dump_json().encode()) == scene
    assert load_scene(scene.model_dump(mode="json")) == scene


def test_every_job_of_the_foundation_ships():
    assert set(shipped_scenes()) >= {
        "quickstart", "tablecloth-small-friction", "tablecloth-small-aligned", "tablecloth-small-angled",
        "friction-incline", "crossing-sliders", "chain-over-peg",
    }


def test_every_woven_scene_ships_in_full_and_in_small():
    woven = ["jeans-pocket", *(f"shirt-tag-{kind}" for kind in ("stretch-h", "stretch-v", "shear", "buckle"))]
    assert set(shipped_scenes()) >= {
        *woven, *(f"{name}-small" for name in woven), "friction-patches",
        "tablecloth-friction", "tablecloth-aligned", "tablecloth-angled",
    }


def test_every_scene_of_strands_ships():
    assert set(shipped_scenes()) >= {
        "hair-flip-dry", "hair-flip-dry-small", "fur-mat-dry", "fur-mat-dry-small", "strand-split-cohesion",
        "two-bundles-friction", "two-bundles-friction-small", "strand-over-cylinder", "knot-pull", "brush-press",
        "curly-hair-swing", "stability-crazy-rotation", "stability-bend-release", "stability-sudden-pull",
    }


def test_every_scene_of_liquid_ships():
    assert set(shipped_scenes()) >= {
        "dam-break-water", "dam-break-mud", "cream-pile", "shaving-cream-compress", "shaving-cream-compress-soft",
        "shaving-cream-compress-hard", "paint-pour", "chocolate-pour", "oyster-sauce-column", "film-incline-newtonian",
        "film-incline-bingham",
    }


@pytest.mark.parametrize("name, within, between", [
    ("tablecloth-angled", 96_290, 132_200), ("jeans-pocket", 398_782, 245_024), ("shirt-tag-buckle", 68_810, 18_356),
])
def test_full_scenes_have_the_published_numbers_of_contacts(name, within, between):
    """Sánchez-Banderas 2020, Table 1."""
    points = {kind: sum(part.points for part in part_sizes(load_scene(shipped_scenes()[name])) if part.path.startswith(kind))
              for kind in ("fabrics", "contacts", "obstacles")}
    fabrics = load_scene(shipped_scenes()[name]).fabrics
    ends = sum(2 * (fabric.warps + fabric.wefts) for fabric in fabrics)
    assert points["fabrics"] - ends == pytest.approx(within, rel=0.02)
    assert points["contacts"] + points["obstacles"] == pytest.approx(between, rel=0.02)


def test_all_kinds_of_source_agree(tmp_path):
    source = with_cloth()
    text = json.dumps(source)
    path = tmp_path / "scene.json"
    path.write_text(text)
    assert load_scene(source) == load_scene(text) == load_scene(text.encode()) == load_scene(path)
    assert load_scene(b"\xef\xbb\xbf" + text.encode()) == load_scene(text)


def test_scenes_are_immutable():
    with pytest.raises(ValueError):
        load_scene(with_cloth()).fps = 3.0


def test_step_bounds_follow_the_default():
    step = load_scene(with_cloth() | {"step": {"default": 0.002}}).step
    assert (step.min, step.max) == (0.002 / 1024, 0.002)


HOSTILE_BYTES = {
    "empty": (b"", "is empty"),
    "blank": (b" \n\t", "is empty"),
    "no object": (b"[]", "is a list of 0"),
    "null": (b"null", "is null"),
    "no JSON": (b"{'a': 1}", "is not JSON at line 1, column 2"),
    "trailing": (b"{} {}", "is not JSON"),
    "not UTF-8": ("{}".encode("utf-16"), "is not UTF-8 at byte 0"),
    "too large": (b" " * 16_000_001, "is too large"),
    "10 MB of lists": (b"[" * 10_000_000, "is nested too deep"),
    "10 MB of objects": (b'{"a":' * 2_000_000, "is nested too deep"),
    "33 levels": (b'{"a":' + b"[" * 33 + b"]" * 33 + b"}", "is nested too deep"),
    "unterminated": (b'{"' + b'\\"' * 1_000_000, "is not JSON"),
    "backslashes": (b'"' + b"\\" * 1_000_001, "is not JSON"),
    "5,000 digits": (b'{"strandline": ' + b"9" * 5000 + b"}", "has an integer of thousands of digits"),
}


@pytest.mark.parametrize("raw, message", HOSTILE_BYTES.values(), ids=HOSTILE_BYTES)
def test_hostile_bytes(raw, message):
    problem = only_problem(raw)
    assert problem.path == "" and problem.message.startswith(message) and problem.allowed


def test_brackets_in_strings_are_no_nesting():
    text = json.dumps(with_cloth() | {"description": '[{"\\' * 100})
    assert load_scene(text).description.startswith("[{")


def test_files_that_cannot_be_read(tmp_path):
    assert "No such file" in only_problem(tmp_path / "absent.json").message
    assert "directory" in only_problem(tmp_path).message


WRONG = {
    "unknown section": (with_cloth() | {"fabricz": []}, "fabricz", "unknown key; did you mean fabrics?", "strandline"),
    "unknown key": (with_cloth(warp=3), "fabrics[0].warp", "unknown key; did you mean warps?", "spacing"),
    "unknown key of a variant": (
        with_cloth() | {"obstacles": [{"shape": "box", "size": [1, 1, 1], "edge": True}]},
        "obstacles[0].edge", "unknown key; did you mean edges?", "rotation"),
    "unknown key of a material": (
        with_cloth() | {"materials": {"radius": {"radius": 1, "linear_density": 1, "stretch_stiffness": 1, "x": 1}}},
        "materials.radius.x", "unknown key", "youngs_modulus"),
    "unknown variant": (with_cloth() | {"obstacles": [{"shape": "bx"}]},
                        "obstacles[0].shape", 'cannot be "bx"; did you mean box?', "plane, box, sphere, cylinder, mesh"),
    "no variant": (with_cloth() | {"obstacles": [{}]}, "obstacles[0].shape", "is missing", "plane, box"),
    "missing": ({"strandline": 1, "name": "x", "fabrics": [cloth()]}, "duration", "is missing", "Simulated time [s]"),
    "another version": (with_cloth() | {"strandline": 2}, "strandline", "cannot be 2", "1"),
    "wrong type": (with_cloth(warps="4"), "fabrics[0].warps", 'cannot be "4"', "valid integer"),
    "pair of one": (with_cloth(spacing=[0.1]), "fabrics[0].spacing[1]", "is missing", "a list with this entry"),
    "pair of three": (with_cloth(spacing=[1, 1, 1]), "fabrics[0].spacing", "cannot be a list of 3", "at most 2"),
    "pair with text": (with_cloth(spacing=[1, "1"]), "fabrics[0].spacing[1]", 'cannot be "1"', "valid number"),
    "object for a number": (with_cloth(spacing={"a": 1}), "fabrics[0].spacing", "cannot be an object", "valid number"),
    "spacing and count": (with_cloth(yarns_per_inch=44), "fabrics[0]", "its keys contradict",
                          "exactly one of spacing and yarns_per_inch"),
    "neither spacing nor count": (with_cloth(spacing=None), "fabrics[0]", "its keys contradict", "exactly one"),
    "wefts twice": (with_cloth(weft_material="denim", weft_stripes=["denim"]), "fabrics[0]", "its keys contradict",
                    "at most one of weft_material and weft_stripes"),
    "unknown pattern": (with_cloth(pattern="twil"), "fabrics[0].pattern", 'cannot be "twil"', "'twill-2/1'"),
    "pattern of twos": (with_cloth(pattern=[[0, 2]]), "fabrics[0].pattern[0][1]", "cannot be 2", "0 or 1"),
    "pattern without rows": (with_cloth(pattern=[]), "fabrics[0].pattern", "cannot be a list of 0", "at least 1"),
    "ragged pattern": (with_cloth(pattern=[[0, 1], [1]]), "fabrics[0].pattern[1]", "has 1 entries", "2, as the first"),
    "unknown stripe": (with_cloth(warp_stripes=["denim", "denin"]), "fabrics[0].warp_stripes[1]",
                       'there is no material "denin"; did you mean denim?', "cotton-thick"),
    "outline of two points": (with_cloth(outline=[[0, 0], [1, 0]]), "fabrics[0].outline", "cannot be a list of 2",
                              "at least 3"),
    "outline across itself": (with_cloth(outline=[[0, 0], [1, 1], [1, 0], [0, 1]]), "fabrics[0].outline",
                              "its sides from points 0 and 2 meet", "nowhere meets itself"),
    "outline around nothing": (with_cloth(outline=[[1, 0], [2, 0], [2, 1]]), "fabrics[0].outline", "leaves no crossing",
                               "one crossing at least"),
    "outline on an endless grid": (
        with_cloth(warps=100_000, wefts=100_000, outline=[[0, 0], [1, 0], [1, 1]]), "fabrics[0].outline",
        "cuts grids of more than 8,000,000 crossings", "no larger than the outline"),
    "hold of no edge": (with_cloth(holds=[{"edge": "up"}]), "fabrics[0].holds[0].edge", 'cannot be "up"', "'top'"),
    "hold by no handle": (with_cloth(holds=[{"edge": "top", "handle": "h"}]), "fabrics[0].holds[0].handle",
                          'there is no handle "h"', "none"),
    "hold backwards": (with_cloth(holds=[{"edge": "top", "extent": [0.7, 0.2]}]), "fabrics[0].holds[0].extent",
                       "ends before it begins", "smaller"),
    "hold beyond the edge": (with_cloth(holds=[{"edge": "top", "extent": [0.7, 1.2]}]), "fabrics[0].holds[0].extent[1]",
                             "cannot be 1.2", "less than or equal to 1"),
    "hold of what stays": (with_cloth(kinematic=True, holds=[{"edge": "top"}]), "fabrics[0].holds",
                           "hold a patch that stays", "kinematic"),
    "seam of no edge": (
        scene_of(fabrics=[cloth("a"), cloth("b")], contacts=[{"lower": "a", "upper": "b", "seams": [{}]}]),
        "contacts[0].seams[0].edge", "is missing", ""),
    "number as text": (with_cloth(spacing="1"), "fabrics[0].spacing", 'cannot be "1"', "valid number"),
    "truth as number": (with_cloth(spacing=True), "fabrics[0].spacing", "cannot be true", "valid number"),
    "object for a list": (scene_of(fabrics={}), "fabrics", "cannot be an object", "list"),
    "list for an object": (scene_of(fabrics=[[[[]]]]), "fabrics[0]", "cannot be a list of 1", "JSON object"),
    "short vector": (with_cloth(position=[1, 2]), "fabrics[0].position[2]", "is missing", "a list with this entry"),
    "long vector": (with_cloth(position=[1, 2, 3, 4]), "fabrics[0].position", "cannot be a list of 4", "at most 3"),
    "NaN": (with_cloth() | {"gravity": [0, 0, float("nan")]}, "gravity[2]", "cannot be NaN", "finite number"),
    "infinity": (with_cloth() | {"duration": float("inf")}, "duration", "cannot be Infinity", "finite number"),
    "400 digits": (with_cloth() | {"duration": 10**400}, "duration", "cannot be an integer of more than 18 digits", ""),
    "10,000 digits": (with_cloth() | {"fps": 10**10_000}, "fps", "cannot be an integer of more than 18 digits", ""),
    "negative radius": (
        with_cloth() | {"materials": {"m": {"radius": -1, "linear_density": 1, "stretch_stiffness": 1}}},
        "materials.m.radius", "cannot be -1", "greater than or equal to"),
    "contradiction": (
        with_cloth() | {"materials": {"m": {"radius": 1e-3, "linear_density": 1, "volume_density": 1,
                                            "stretch_stiffness": 1}}},
        "materials.m", "its keys contradict each other", "exactly one of linear_density and volume_density"),
    "enumeration": (with_cloth(pins="corner"), "fabrics[0].pins", 'cannot be "corner"', "'none', 'corners' or 'edges'"),
    "name with a blank": (with_cloth(name="a b"), "fabrics[0].name", 'cannot be "a b"', "match pattern"),
    "lone surrogate": (with_cloth() | {"name": "\ud800"}, "name", 'cannot be "\\ud800"', "Unicode"),
    "unknown handle of an obstacle": (
        with_cloth() | {"obstacles": [{"shape": "plane", "handle": "lift"}]}, "obstacles[0].handle",
        'there is no handle "lift"', "none"),
    "crimp in a stack": (
        scene_of(fabrics=[cloth("a", crimp="set"), cloth("b")], contacts=[{"lower": "a", "upper": "b"}]),
        "fabrics[0].crimp", "is set in a fabric in contact with another", "flat"),
    "crimp and an outline": (
        with_cloth(crimp="set", outline=[[-0.01, -0.01], [0.01, -0.01], [0, 0.01]]), "fabrics[0].crimp",
        "is set in a fabric with an outline", "flat"),
    "crimp of a rigid patch": (
        with_cloth(crimp="free", kinematic=True), "fabrics[0].crimp", "is free in a kinematic fabric", "flat"),
    "crimp over edges": (
        with_cloth(crimp="free") | {"obstacles": [{"shape": "box", "size": [1, 1, 1], "edges": True}]},
        "fabrics[0].crimp", "is free in a scene with edges that yarns slide over", "flat"),
    "edges that are carried": (
        with_cloth() | {"obstacles": [{"shape": "box", "size": [1, 1, 1], "edges": True, "handle": "lift"}],
                        "script": {"handles": [{"name": "lift", "keyframes": [{"time": 0, "offset": [0, 0, 0]}]}]}},
        "obstacles[0].handle", "carries a box with edges", "no handle"),
    "nothing to do": (scene_of(), "", "has nothing to simulate", "yarns or fabrics"),
    "same name": (scene_of(fabrics=[cloth(), cloth()]), "fabrics[1].name", "is the name of fabrics[0] too", "its own"),
    "unknown material": (with_cloth(material="coton-thick"), "fabrics[0].material",
                         'there is no material "coton-thick"; did you mean cotton-thick?', "cotton-thick, cotton-fine"),
    "unknown fabric": (with_cloth() | {"contacts": [{"lower": "cloth", "upper": "clot"}]},
                       "contacts[0].upper", 'there is no fabric "clot"', "cloth"),
    "unknown handle": (with_rod(start={"hold": "pinned", "handle": "h"}),
                       "yarns[0].start.handle", 'there is no handle "h"', "none"),
    "handle of a free end": (
        with_rod(end={"handle": "h"})
        | {"script": {"handles": [{"name": "h", "keyframes": [{"time": 0, "offset": [0, 0, 0]}]}]}},
        "yarns[0].end.handle", "carries a free end", "pinned"),
    "clamp without room": (with_rod(start={"hold": "clamped"}), "yarns[0].start.hold", "has no fixed point", "pinned"),
    "point twice": (with_rod(points=[[0, 0, 0], [0, 0, 0]]), "yarns[0].points[1]", "repeats", "elsewhere"),
    "eyelet at the end": (with_rod(eyelets=[{"point": 1}]), "yarns[0].eyelets[0].point", "is no point between", "none"),
    "layer above itself": (with_cloth() | {"contacts": [{"lower": "cloth", "upper": "cloth"}]},
                           "contacts", "put a fabric above itself", "stacks"),
    "layers apart": (
        scene_of(fabrics=[cloth("a"), cloth("b", position=[0, 0, 0.01])], contacts=[{"lower": "a", "upper": "b"}]),
        "contacts[0]", "a and b do not lie in one plane", "one plane"),
    "pair twice": (scene_of(fabrics=[cloth("a"), cloth("b")], contacts=[{"lower": "a", "upper": "b"}] * 2),
                   "contacts[1]", "gives the same two fabrics", "one entry"),
    "least step above the default": (with_cloth() | {"step": {"min": 1.0}}, "step.min", "is 1", "at most"),
    "crossing apart": (
        scene_of(yarns=[rod("a", points=[[0, 0, 0], [1, 0, 0], [2, 0, 0]]),
                        rod("b", points=[[1, -1, 0], [1, 0, 1], [1, 1, 0]])],
                 crossings=[{"lower": {"yarn": "a", "point": 1}, "upper": {"yarn": "b", "point": 1}}]),
        "crossings[0]", "its points do not coincide", "one place"),
    "frames": (with_cloth() | {"fps": 1e6, "duration": 2.0, "step": {"default": 1e-6}}, "fps", "gives 2,000,001", ""),
    "steps": (with_cloth() | {"step": {"default": 1e-9}}, "step.default", "gives 1,000,000,020", "100,000,000"),
    "10^9 nodes by count": (with_cloth(warps=10**9), "fabrics[0].warps", "cannot be 1000000000", "less than"),
    "10^9 nodes by product": (
        with_cloth(warps=31_623, wefts=31_623), "fabrics[0]", "the scene has 1,000,", "2,000,000"),
    "strands beside yarns": (with_groom() | {"fabrics": [cloth()]}, "strands", "stand beside yarns or fabrics", "one of both"),
    "strands and contact of yarns": (with_groom() | {"contact": {"self": True}}, "contact.self", "is about yarns only",
                                     "strand_step.contact"),
    "two groups of one name": (scene_of(strands=[groom(), groom()]), "strands[1].name", "is the name of strands[0]", "its own"),
    "two obstacles of one name": (
        with_groom() | {"obstacles": [{"shape": "plane", "name": "a"}, {"shape": "plane"}, {"shape": "plane", "name": "a"}]},
        "obstacles[2].name", "is the name of obstacles[0] too", "its own"),
    "strands of no kind": (scene_of(strands=[hair()]), "strands[0]", "its keys contradict",
                           "exactly one of curves, file and groom"),
    "strands of two kinds": (scene_of(strands=[groom() | {"file": "a.obj"}]), "strands[0]", "its keys contradict", "exactly one"),
    "unknown key of a groom": (with_groom(lenght=1), "strands[0].groom.lenght", "unknown key; did you mean length?", "count"),
    "ground twice": (with_groom(on="x", rectangle=[1, 1]), "strands[0].groom", "its keys contradict", "on and rectangle"),
    "place of an obstacle's groom": (with_groom(on="x", position=[0, 0, 1]), "strands[0].groom", "its keys contradict",
                                     "position and rotation with rectangle only"),
    "ground that is not there": (with_groom(on="heat") | {"obstacles": [{"shape": "sphere", "radius": 1, "name": "head"}]},
                                 "strands[0].groom.on", 'there is no obstacle "heat"; did you mean head?', "head"),
    "ground without end": (with_groom(on="floor") | {"obstacles": [{"shape": "plane", "name": "floor"}]},
                           "strands[0].groom.on", "floor is a plane", "rectangle"),
    "surface that faces nowhere": (with_groom(facing=[0, 0, -1]), "strands[0].groom.facing", "is where the surface nowhere faces",
                                   "another way"),
    "side that faces nowhere": (
        with_groom(on="can", facing=[0, 0, 1], within=80)
        | {"obstacles": [{"shape": "cylinder", "radius": 1, "height": 1, "name": "can"}]},
        "strands[0].groom.facing", "is where the surface nowhere faces", "another way"),
    "comb to nowhere": (with_groom(direction=[0, 0, 0]), "strands[0].groom.direction", "has no length", "leads somewhere"),
    "no strands": (with_groom(count=0), "strands[0].groom.count", "cannot be 0", "greater than"),
    "10^9 strands": (with_groom(count=10**9), "strands[0].groom.count", "cannot be 1000000000", "100000"),
    "too many vertices": (
        scene_of(strands=[groom(count=100_000) | {"name": f"g{i}"} for i in range(2)]), "strands[0]",
        "the scene has 3,200,000 vertices", "2,000,000"),
    "tufts without strands": (with_groom(clump={"count": 21}), "strands[0].groom.clump.count", "is 21", "at most the 20"),
    "curls too fine": (with_groom(curl={"radius": 1e-3, "pitch": 1e-3}), "strands[0].groom.curl", "has 1 vertices in a turn",
                       "4 at least"),
    "strands without length": (with_groom(length=1e-9), "strands[0].groom.length", "is too short", "1e-09 m"),
    "lengths below none": (with_groom(length_spread=1.0), "strands[0].groom.length_spread", "cannot be 1", "0.9"),
    "curve of one point": (with_curve([0, 0, 0]), "strands[0].curves[0]", "cannot be a list of 1", "at least 2"),
    "curve of two points": (with_curve([0, 0, 0], [0, 0, 1]), "strands[0].curves[0]", "has 2 points", "3 to 1000"),
    "curve that stands still": (with_curve([0, 0, 0], [0, 0, 1], [0, 0, 1]), "strands[0].curves[0][2]", "repeats", "elsewhere"),
    "curve of NaN": (with_curve([0, 0, float("nan")], [0, 0, 1]), "strands[0].curves[0][0][2]", "cannot be NaN", "finite"),
    "curve too short": (with_curve([0, 0, 0], [0, 0, 1e-8], vertices=100), "strands[0].curves[0]", "is 1e-08 m long", "1e-09 m"),
    "too many points": (scene_of(strands=[hair(curves=[[[0, 0, z] for z in range(1000)]] * 101)]), "strands",
                        "their curves have too many points", "100,000"),
    "two vertices": (with_curve(vertices=2), "strands[0].vertices", "cannot be 2", "3"),
    "handle of a free root": (
        with_curve(root={"handle": "h"}) | {"script": {"handles": [{"name": "h", "keyframes": [{"time": 0}]}]}},
        "strands[0].root.handle", "carries a free end", "pinned"),
    "unknown handle of a tip": (with_curve(tip={"hold": "pinned", "handle": "h"}), "strands[0].tip.handle",
                                'there is no handle "h"', "none"),
    "clamps that meet": (with_curve(root={"hold": "clamped"}, tip={"hold": "clamped"}), "strands[0].tip.hold",
                         "is clamped where the root is", "more vertices"),
    "strand of yarn": (with_curve(material="denim"), "strands[0].material", "denim has a bending_modulus", "without"),
    "strand that is stiff in shear": (
        with_curve(material="m") | {"materials": {"m": {"radius": 1e-3, "linear_density": 1, "stretch_stiffness": 1,
                                                        "shear_stiffness": 1}}},
        "strands[0].material", "m has a shear_stiffness", "without"),
    "squeezed beyond": (
        with_curve(material="m") | {"materials": {"m": {"radius": 1e-3, "linear_density": 1, "stretch_stiffness": 1,
                                                        "poisson_ratio": 0.6}}},
        "materials.m.poisson_ratio", "cannot be 0.6", "0.5"),
    "file in a scene from nowhere": (scene_of(strands=[hair(file="a.obj")]), "strands[0].file", "is not read",
                                     "curves in the scene"),
    "10^9 segments": (with_rod(segments=10**9), "yarns[0].segments", "cannot be 1000000000", "less than"),
}


@pytest.mark.parametrize("source, path, message, allowed", WRONG.values(), ids=WRONG)
def test_wrong_scenes(source, path, message, allowed):
    problem = only_problem(source)
    assert problem.path == path
    assert problem.message.startswith(message)
    assert allowed in (problem.allowed or "")


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_that_are_none_in_json_text(number):
    text = json.dumps(with_cloth()).replace('"duration": 1.0', f'"duration": {number}')
    assert only_problem(text).path == "duration"


def test_keys_given_twice_are_named_by_path():
    text = '{"strandline": 1, "fabrics": [{"name": "a"}, {"name": "a", "warps": 3, "name": "b"}]}'
    problem = only_problem(text)
    assert (problem.path, problem.message) == ("fabrics[1].name", "is given twice")


def test_several_problems_come_at_once_and_many_are_cut_short():
    assert [p.path for p in problems(with_cloth(warps=1, wefts=1))] == ["fabrics[0].warps", "fabrics[0].wefts"]
    many = problems(with_cloth() | {"crossings": [{"x": 1}] * 50_000})
    assert len(many) == 21 and "more problems" in many[-1].message


def test_long_keys_are_cut_short_in_messages():
    assert len(str(only_problem(with_cloth() | {"k" * 100_000: 1}))) < 400


@pytest.mark.parametrize("source", [
    with_cloth(warps=31_623, wefts=31_623), scene_of(strands=[groom(count=100_000) | {"vertices": 1000}]),
], ids=["nodes", "vertices"])
def test_too_much_allocates_nothing(source):
    tracemalloc.start()
    problems(source)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 50e6


def test_overrides():
    source = with_cloth() | {"description": "d"}
    scene = load_scene(source, ["step.default=0.002", "fabrics[0].warps=7", "description=a word", "gravity=[0,0,-1]"])
    assert (scene.step.default, scene.fabrics[0].warps, scene.description) == (0.002, 7, "a word")
    assert scene.gravity == (0.0, 0.0, -1.0)
    assert source["fabrics"][0]["warps"] == 4, "the caller's object stays as it was"


@pytest.mark.parametrize("assignment, path, message", [
    ("fabrics[1].warps=5", "fabrics[1]", "cannot be set: fabrics has no entry 1"),
    ("fabrics.warps=5", "fabrics.warps", "cannot be set: fabrics is no object"),
    ("name[0]=5", "name[0]", "cannot be set: name is no list"),
    ("fabrics[0].spacing=0", "fabrics[0].spacing", "cannot be 0"),
    ("fabrics[0].x.y=0", "fabrics[0].x", "unknown key"),
    ("duration=NaN", "duration", "cannot be NaN"),
    ("duration=" + "[" * 100_000, "duration", "cannot be"),
    ("duration", "duration", "is no override"),
    ("=3", "=3", "is no override"),
    ("a..b=3", "a..b=3", "is no override"),
])
def test_overrides_that_cannot_be(assignment, path, message):
    problem = only_problem(with_cloth(), [assignment])
    assert problem.path == path and problem.message.startswith(message)


KEYS = st.sampled_from(sorted(Scene.model_fields))
TEXT = st.text('name[{"\ud800é', max_size=5)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | TEXT,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT | KEYS, inner, max_size=4), max_leaves=10,
)


@settings(deadline=None)
@given(st.dictionaries(KEYS, JSON, max_size=4) | st.binary(max_size=20))
def test_anything_loads_or_is_refused_cleanly(parts):
    try:
        scene = load_scene(parts if isinstance(parts, bytes) else with_cloth() | parts)
    except SceneError as error:
        assert error.problems and str(error).encode()
    else:
        size = estimate(scene)
        assert size.points > 0 or size.strand_vertices > 0 or size.particles > 0
