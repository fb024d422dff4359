"""Liquid in the time loop: what it reports, that it resumes bitwise, and what it lets in and out."""

import json
import subprocess
import sys

import numpy as np
import pytest

from engine.run.frames import frame_paths, read_frame
from engine.run.liquid import LiquidInMotion
from engine.run.simulation import run
from engine.scene.load import load_scene
from tests.engine.run.outputs import assert_goes_on, assert_the_same_on_two_threads, contents, stop_after, whole_run

# foam that slides along a tank, whose end is drained, and a jet of it
POURED = {
    "strandline": 1, "name": "foam, poured and drained", "duration": 0.06, "fps": 100, "step": {"default": 2e-3},
    "liquid": {
        "material": "shaving-cream", "spacing": 0.01, "jitter": 0.3,
        "tank": {"low": [0, 0, 0], "high": [0.16, 0.08, 0.2]},
        "initial": [{"shape": "box", "low": [0, 0, 0], "high": [0.08, 0.08, 0.04], "velocity": [0.4, 0, 0]}],
        "sources": [{"centre": [0.04, 0.04, 0.1], "direction": [0, 0, -1], "radius": 0.02, "speed": 0.5}],
        "sinks": [{"low": [0.09, 0, 0], "high": [0.16, 0.08, 0.2]}],
    },
    "output": {"checkpoint_every": 1},
}
STILL = {
    "strandline": 1, "name": "water at rest", "duration": 0.04, "fps": 50, "step": {"default": 2e-3},
    "liquid": {
        "material": "water", "spacing": 0.01, "tank": {"low": [0, 0, 0], "high": [0.08, 0.08, 0.2]},
        "initial": [{"shape": "box", "low": [0, 0, 0], "high": [0.08, 0.08, 0.06]}],
    },
}


def with_liquid(scene, **changes):
    return scene | {"liquid": scene["liquid"] | changes}


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    return whole_run(load_scene(POURED), tmp_path_factory.mktemp("unbroken"))


def test_the_report_and_frames_have_what_applies(unbroken):
    report, _, directory = unbroken
    assert report["counts"]["particles_max"] >= 2048 and report["counts"]["grid_cells_max"] > 0
    assert {"volume_drift", "linear_iterations", "newton_residual_max"} <= set(report["error"])
    assert not {"contact_gap_max", "momentum_drift"} & set(report["error"])
    first, last = (read_frame(frame_paths(directory)[index]) for index in (0, -1))
    assert first.yarns is None and len(first.liquid.positions) == 2048 and last.liquid.pressure.max() > 0.0
    assert len(last.liquid.positions) == len(last.liquid.pressure) == last.series["particles"]


@pytest.mark.parametrize("steps", [1, 14, 23])
def test_a_cancelled_run_goes_on_as_if_it_had_not_stopped(unbroken, tmp_path, steps):
    assert run(load_scene(POURED), tmp_path, threads=1, should_stop=stop_after(steps))["state"] == "cancelled"
    assert_goes_on(load_scene(POURED), tmp_path, unbroken)


def test_two_threads_give_the_same_bits(unbroken, tmp_path, monkeypatch):
    assert_the_same_on_two_threads(load_scene(POURED), tmp_path, unbroken[1], monkeypatch)


def test_state_is_all_that_is_restored():
    first, second = LiquidInMotion(load_scene(POURED)), LiquidInMotion(load_scene(POURED))
    for n in range(4):
        assert first.step(n * 2e-3, 2e-3).accepted
    second.restore({name: values.copy() for name, values in first.arrays().items()})
    for moved in (first, second):
        assert moved.step(8e-3, 2e-3).accepted
    for name, values in first.arrays().items():
        assert np.array_equal(values, second.arrays()[name]), name


def test_all_volume_is_there_or_drained():
    moved = LiquidInMotion(load_scene(with_liquid(POURED, material="water", jitter=0.0)))
    before = moved.state.volume.sum()
    for n in range(30):
        assert moved.step(n * 2e-3, 2e-3).accepted
    opening = np.pi * 0.02**2
    layers = int(0.5 * 0.06 / 0.005 + 1e-9)
    assert moved.state.emitted.tolist() == [layers]
    assert moved.state.drained[0] > 0.0
    assert moved.state.volume.sum() + moved.state.drained[0] == pytest.approx(before + opening * layers * 0.005, rel=1e-9)


def test_a_nozzle_at_the_end_of_the_period():
    nozzle = {"centre": [0.158, 0.04, 0.1], "direction": [1, 0, 0], "radius": 0.02, "speed": 0.5}
    scene = with_liquid(POURED, material="water", periodic=["x"], sources=[nozzle], sinks=[], initial=[])
    moved = LiquidInMotion(load_scene(scene))
    for n in range(20):
        assert moved.step(n * 2e-3, 2e-3).accepted
        assert (moved.state.x[:, 0] >= 0).all() and (moved.state.x[:, 0] < 0.16).all()
    assert len(moved.state.x) > 0 and moved.state.drained[0] == 0.0


def test_water_at_rest_keeps_its_volume(tmp_path):
    assert run(load_scene(STILL), tmp_path)["error"]["volume_drift"] < 1e-3


def test_pressure_belongs_to_the_particles_that_are_drawn():
    moved = LiquidInMotion(load_scene(STILL))
    for n in range(10):
        assert moved.step(n * 2e-3, 2e-3).accepted
    moved.invariants(0.02, {})
    frame = moved.components()["liquid"]
    cell = np.floor(frame.positions[:, 2] / 0.01)
    np.testing.assert_allclose(frame.pressure, 9810.0 * (0.06 - (cell + 0.5) * 0.01), atol=30.0)


def test_the_error_estimate_falls_with_the_step_and_changes_nothing(tmp_path):
    """A drop in free fall: a step is half of h^2 g too far, two of half the size a quarter."""
    errors, drop = [], {"shape": "ball", "centre": [0.08, 0.04, 0.1], "radius": 0.03, "angular_velocity": [90, 0, 60]}
    for step in (2e-3, 1e-3):
        scene = with_liquid(POURED, sources=[], sinks=[], initial=[drop]) | {"step": {"default": step}}
        scene |= {"output": {"error_estimate": True}}
        errors.append(run(load_scene(scene), tmp_path / str(step), threads=1)["error"]["step_error"]["x"]["max"])
    np.testing.assert_allclose(errors, [9.81e-6, 9.81e-6 / 4], rtol=0.3)
    run(load_scene(scene | {"output": {}}), tmp_path / "plain", threads=1)
    assert contents(tmp_path / "plain") == contents(tmp_path / "0.001")


def test_a_sample_in_every_step_does_not_change_what_is_drawn(tmp_path):
    scene = with_liquid(POURED, sinks=[]) | {"fps": 500, "duration": 0.01}
    run(load_scene(scene | {"output": {"error_estimate": True}}), tmp_path / "sampled", threads=1)
    run(load_scene(scene | {"output": {}}), tmp_path / "plain", threads=1)
    assert contents(tmp_path / "plain") == contents(tmp_path / "sampled")


@pytest.mark.parametrize("dry", [
    {"yarns": [{"name": "rod", "material": "cotton-fine", "points": [[0, 0, 0], [1, 0, 0]]}]},
    {"materials": {"nylon": {"radius": 5e-4, "volume_density": 1150.0, "youngs_modulus": 1e7}},
     "strands": [{"name": "free", "material": "nylon", "curves": [[[0, 0, 0], [0.01, 0, 0], [0.02, 0, 0], [0.03, 0, 0]]]}]},
], ids=["yarns", "strands"])
def test_dry_scenes_import_no_kernel_of_liquid(dry):
    program = (
        "import json, sys\n"
        "from engine.run.compile_cache import prepare_compile_cache\n"
        "prepare_compile_cache()\n"
        "from engine.run.simulated import assemble\n"
        "from engine.scene.load import load_scene\n"
        "assemble(load_scene(json.loads(sys.argv[1])))\n"
        "print(json.dumps(sorted(sys.modules)))"
    )
    scene = {"strandline": 1, "name": "dry", "duration": 0.1} | dry
    ran = subprocess.run([sys.executable, "-c", program, json.dumps(scene)], capture_output=True, text=True, check=True)
    modules = set(json.loads(ran.stdout))
    wet = {"engine.run.liquid", "engine.steppers.liquid", "engine.linalg.multigrid"} & modules
    assert not wet | {m for m in modules if m.startswith("engine.liquid.") and m != "engine.liquid.settings"}
