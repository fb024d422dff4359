"""Real yarns: a job that is killed again and again, and one on other threads, end bitwise as the unbroken one."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from engine.run.frames import frame_paths, read_frame
from engine.run.simulation import run
from engine.scene.load import load_scene
from tests.engine.run.outputs import assert_goes_on, assert_the_same_on_two_threads, stop_after, whole_run

ROOT = Path(__file__).resolve().parents[3]
PATCH = {"material": "cotton-fine", "spacing": 0.01, "friction": 0.3}
SLIDING_PATCHES = {
    "strandline": 1, "name": "sliding patches", "duration": 0.05, "fps": 200, "step": {"dynamic_contacts": True},
    "fabrics": [
        PATCH | {"name": "lower", "warps": 6, "wefts": 6, "pins": "corners"},
        PATCH | {"name": "upper", "warps": 5, "wefts": 5, "rotation": [0, 0, 20]},
    ],
    "contacts": [{"lower": "lower", "upper": "upper", "friction": 0.2, "reach": 0.02}],
    "output": {"checkpoint_every": 1},
}


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    return whole_run(load_scene(SLIDING_PATCHES), tmp_path_factory.mktemp("unbroken"))


def test_the_run_is_worth_comparing(unbroken):
    report, _, directory = unbroken
    assert report["counts"]["eil_max"] > 0 and report["time"]["steps"] >= 50
    first, last = (read_frame(frame_paths(directory)[index]) for index in (0, -1))
    assert last.index == 10 and abs(last.yarns.u - first.yarns.u).max() > 1e-5


def test_two_threads_give_the_same_bits(unbroken, tmp_path, monkeypatch):
    assert unbroken[0]["machine"]["threads"] == 1
    assert_the_same_on_two_threads(load_scene(SLIDING_PATCHES), tmp_path, unbroken[1], monkeypatch)


def run_until_killed(directory: str, steps: str, renames: str) -> None:
    """Resume the job and die of SIGKILL at its `steps`th step or before its `renames`th rename of a file."""
    remaining = {"steps": int(steps), "renames": int(renames)}

    def die_after(what: str) -> bool:
        remaining[what] -= 1
        if remaining[what] == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return False

    replace = os.replace
    os.replace = lambda *paths: die_after("renames") or replace(*paths)
    run(load_scene(SLIDING_PATCHES), Path(directory), resume=True, threads=1, should_stop=lambda: die_after("steps"))


def test_a_job_killed_again_and_again_ends_with_the_same_bits(unbroken, tmp_path):
    program = "import sys; from tests.engine.run.test_resume import *; run_until_killed(*sys.argv[1:])"
    for steps, renames in ((17, 1000), (1000, 8), (6, 1000)):
        died = subprocess.run([sys.executable, "-c", program, str(tmp_path), str(steps), str(renames)], cwd=ROOT)
        assert died.returncode == -signal.SIGKILL
        for path in frame_paths(tmp_path):
            assert path.read_bytes() == unbroken[1][path.name]
    assert 0 < len(frame_paths(tmp_path)) < 11
    assert_goes_on(load_scene(SLIDING_PATCHES), tmp_path, unbroken)


def test_a_run_with_collisions_and_a_moving_obstacle_goes_on_as_if_it_had_not_stopped(tmp_path):
    """All that is remembered of collisions is in the state; obstacles are where their script says."""
    keyframes = [{"time": 0, "offset": [0, 0, 0]}, {"time": 0.05, "offset": [0, 0, 0.002]}]
    scene = load_scene(SLIDING_PATCHES | {
        "fabrics": [
            PATCH | {"name": "lower", "warps": 6, "wefts": 6, "pins": "corners"},
            PATCH | {"name": "upper", "warps": 5, "wefts": 5, "rotation": [0, 0, 20], "position": [0, 0, 0.0012]},
        ],
        "contacts": [], "contact": {"self": True}, "script": {"handles": [{"name": "lift", "keyframes": keyframes}]},
        "obstacles": [{"shape": "sphere", "radius": 0.02, "position": [0, 0, -0.0206], "handle": "lift"}],
    })
    unbroken, stopped = whole_run(scene, tmp_path / "whole"), tmp_path / "stopped"
    assert unbroken[0]["counts"]["collisions_max"] > 0
    assert run(scene, stopped, threads=1, should_stop=stop_after(21))["state"] == "cancelled"
    assert_goes_on(scene, stopped, unbroken)


def test_a_falling_yarn_reports_what_it_keeps(tmp_path):
    falling = {
        "strandline": 1, "name": "falling", "duration": 0.05, "fps": 100,
        "materials": {"undamped": {"radius": 1e-3, "linear_density": 2e-3, "youngs_modulus": 5e5}},
        "yarns": [{"name": "rod", "material": "undamped", "points": [[0, 0, 0], [0.2, 0, 0], [0.2, 0.1, 0]],
                   "segments": 5}],
    }
    error = run(load_scene(falling), tmp_path)["error"]
    assert error["momentum_drift"] <= 1e-10 and error["energy_drift"] < 0.05
    assert not {"contact_gap_max", "penetration_max", "volume_drift"} & set(error)


def test_what_a_held_and_damped_scene_does_not_keep_is_absent(unbroken):
    assert not {"momentum_drift", "energy_drift", "penetration_max", "volume_drift"} & set(unbroken[0]["error"])
