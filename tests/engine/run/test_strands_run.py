"""Real strands in the time loop: what they report, that they resume bitwise, and what they import."""

import json
import subprocess
import sys

import numpy as np
import pytest

from engine.run.frames import frame_paths, read_frame
from engine.run.simulated import assemble
from engine.run.simulation import run
from engine.run.strands import StrandsInMotion
from engine.scene.load import load_scene
from tests.engine.run.outputs import assert_goes_on, assert_the_same_on_two_threads, contents, stop_after, whole_run

NYLON = {"radius": 5e-4, "volume_density": 1150.0, "youngs_modulus": 1e7}
LINE = [[round(0.005 * i, 4), 0.0, 0.02] for i in range(13)]
# strands that lie across a lifted rod and on each other
TOUCHING = {
    "strandline": 1, "name": "strands over a rod", "duration": 0.04, "fps": 200, "step": {"default": 1e-3},
    "materials": {"nylon": NYLON | {"stretch_damping": 1e-4, "mass_damping": 0.5}},
    "strands": [
        {"name": "held", "material": "nylon", "curves": [LINE, [[x, y + 0.004, z] for x, y, z in LINE]],
         "root": {"hold": "clamped", "handle": "lift"}},
        {"name": "loose", "material": "nylon", "curves": [[[0.05, round(-0.01 + 0.003 * i, 4), 0.0212] for i in range(9)]]},
    ],
    "obstacles": [{"shape": "cylinder", "radius": 0.005, "height": 0.2, "position": [0.03, 0, 0.0142], "rotation": [90, 0, 0]}],
    "script": {"handles": [{"name": "lift", "keyframes": [{"time": 0}, {"time": 0.04, "offset": [0, 0, 0.002],
                                                                       "rotation": [0, 20, 0]}]}]},
    "output": {"checkpoint_every": 1},
}
# a bent strand that flies freely
FLYING = {
    "strandline": 1, "name": "a strand that flies", "duration": 0.05, "fps": 100, "step": {"default": 5e-4},
    "materials": {"nylon": NYLON}, "strand_step": {"contact": "none"},
    "strands": [{"name": "free", "material": "nylon", "rest": "straight",
                 "curves": [[[0.01 * i, 1e-3 * (i % 5) ** 2, 0.0] for i in range(9)]]}],
}


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    return whole_run(load_scene(TOUCHING), tmp_path_factory.mktemp("unbroken"))


def test_frames_hold_what_strands_do(unbroken):
    _, _, directory = unbroken
    first, last = (read_frame(frame_paths(directory)[index]) for index in (0, -1))
    assert first.yarns is None and last.yarns is None and last.index == 8
    assert first.strands.offsets.tolist() == [0, 13, 26, 35] and first.strands.group.tolist() == [0, 0, 1]
    assert np.allclose(first.strands.positions[:13], LINE, atol=1e-7) and not first.strands.contact_force.any()
    assert last.strands.contact_force.max() > 0 and last.series["contacts"] > 0
    assert np.abs(last.strands.curvature).max() > 1.0 and np.isfinite(last.strands.strain).all()
    assert last.strands.positions[0, 2] == pytest.approx(0.02 * np.cos(np.radians(20)) + 0.002, abs=1e-6), "by its handle"


def test_the_report_has_what_applies(unbroken):
    report = unbroken[0]
    assert report["counts"]["strand_vertices"] == 35 and report["counts"]["contacts_max"] > 0
    assert set(report["error"]) == {"newton_residual_max", "newton_iterations", "linear_iterations", "contact_gap_max"}
    assert report["error"]["contact_gap_max"] < 0.1


@pytest.mark.parametrize("steps", [1, 17, 33])
def test_a_cancelled_run_goes_on_as_if_it_had_not_stopped(unbroken, tmp_path, steps):
    """Whatever number of contacts there is when it stops; what is remembered of them is in the state."""
    assert run(load_scene(TOUCHING), tmp_path, threads=1, should_stop=stop_after(steps))["state"] == "cancelled"
    assert_goes_on(load_scene(TOUCHING), tmp_path, unbroken)


@pytest.mark.parametrize("scene", [TOUCHING, FLYING], ids=["touching", "flying"])
def test_what_bdf2_remembers_is_in_the_state(tmp_path, scene):
    scene = load_scene(scene | {"strand_step": scene.get("strand_step", {}) | {"integrator": "bdf2"}})
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    report = run(scene, whole, threads=1)
    assert run(scene, stopped, threads=1, should_stop=stop_after(17))["state"] == "cancelled"
    assert run(scene, stopped, resume=True, threads=1)["error"] == report["error"]
    assert contents(stopped) == contents(whole)


def test_two_threads_give_the_same_bits(unbroken, tmp_path, monkeypatch):
    assert_the_same_on_two_threads(load_scene(TOUCHING), tmp_path, unbroken[1], monkeypatch)


def test_state_is_all_that_is_restored():
    """A second run put into the state of a first goes on like it, whatever it did before."""
    first, second = StrandsInMotion(load_scene(TOUCHING)), StrandsInMotion(load_scene(TOUCHING))
    for n in range(12):
        assert first.step(n * 1e-3, 1e-3).accepted
    saved = {name: values.copy() for name, values in first.arrays().items()}
    assert first.varying <= set(saved)
    second.restore(saved)
    for run_ in (first, second):
        assert run_.step(12e-3, 1e-3).accepted
    for name, values in first.arrays().items():
        assert np.array_equal(values, second.arrays()[name]), name
    assert any(not np.array_equal(values, first.arrays()[name]) for name, values in saved.items()), "copies, not the arrays"


def test_a_free_strand_keeps_momentum_and_says_what_implicit_euler_loses(tmp_path):
    report = run(load_scene(FLYING), tmp_path)
    assert set(report["error"]) == {"newton_residual_max", "newton_iterations", "momentum_drift", "energy_drift"}
    assert report["error"]["momentum_drift"] <= 1e-9 and 0 < report["error"]["energy_drift"] < 1
    assert report["counts"] == {"strand_vertices": 9}
    energies = [sum(read_frame(path).series[f"{kind}_energy"] for kind in ("kinetic", "potential"))
                for path in frame_paths(tmp_path)]
    assert energies == sorted(energies, reverse=True)


@pytest.mark.parametrize("change, kept", [
    ({"materials": {"nylon": NYLON | {"mass_damping": 1.0}}}, set()),
    ({"materials": {"nylon": NYLON | {"stretch_damping": 1e-3}}}, {"momentum_drift"}),
    ({"strand_step": {"contact": "cone"}}, {"momentum_drift"}),
    ({"strands": [FLYING["strands"][0] | {"root": {"hold": "clamped"}}]}, {"energy_drift"}),
])
def test_what_a_scene_does_not_keep_is_absent(tmp_path, change, kept):
    report = run(load_scene(FLYING | change), tmp_path, until=0.01)
    assert {"momentum_drift", "energy_drift"} & set(report["error"]) == kept


@pytest.mark.parametrize("integrator", ["euler", "bdf2"])
def test_the_error_estimate_falls_with_the_step(tmp_path, integrator):
    errors = []
    for step in (1e-3, 5e-4):
        settings = FLYING["strand_step"] | {"integrator": integrator}
        scene = load_scene(FLYING | {"step": {"default": step}, "strand_step": settings, "output": {"error_estimate": True}})
        errors.append(run(scene, tmp_path / str(step))["error"]["step_error"]["x"]["max"])
    assert 0 < errors[1] < errors[0]
    plain = run(load_scene(FLYING | {"step": {"default": 5e-4}, "strand_step": settings}), tmp_path / "plain")
    assert plain["state"] == "succeeded" and contents(tmp_path / "plain") == contents(tmp_path / "0.0005")


def test_only_what_the_scene_needs_is_imported():
    program = (
        "import json, sys\n"
        "from engine.run.compile_cache import prepare_compile_cache\n"
        "prepare_compile_cache()\n"
        "from engine.run.simulated import assemble\n"
        "from engine.scene.load import load_scene\n"
        "assemble(load_scene(json.loads(sys.argv[1])))\n"
        "print(json.dumps(sorted(sys.modules)))"
    )
    ran = subprocess.run([sys.executable, "-c", program, json.dumps(FLYING)], capture_output=True, text=True, check=True)
    modules = set(json.loads(ran.stdout))
    assert "engine.steppers.strands" in modules
    assert not {"engine.run.yarns", "engine.steppers.yarns", "engine.yarns.observe"} & modules


def test_yarn_scenes_are_still_yarns():
    rod = {"name": "rod", "material": "cotton-fine", "points": [[0, 0, 0], [1, 0, 0]]}
    yarns = load_scene({"strandline": 1, "name": "rod", "duration": 0.1, "yarns": [rod]})
    assert type(assemble(yarns)).__name__ == "YarnsInMotion"
