"""The time loop on a stand-in for the yarns: one particle on a spring, which rejects steps when it is told to."""

import errno
import json
from pathlib import Path

import numpy as np
import pytest

from engine.run import files, simulation
from engine.run.directory import DirectoryTaken
from engine.run.frames import frame_paths, read_frame
from engine.run.simulation import SimulationFailed, run
from engine.run.statistics import Invariants
from engine.scene.load import load_scene
from engine.steppers.step_report import StepReport


def scene(**changes):
    document = {
        "strandline": 1, "name": "spring", "duration": 0.1, "fps": 24, "step": {"default": 1e-3, "min": 1e-5},
        "yarns": [{"name": "rod", "material": "cotton-fine", "points": [[0, 0, 0], [1, 0, 0]]}],
    }
    return load_scene(document | changes)


class Spring:
    """x'' = -400 x, implicit Euler; steps above `largest(time)` are rejected."""

    report_keys = frozenset({"contact_gap_max", "linear_iterations"})
    nodes = 2
    varying = frozenset()

    def __init__(self, largest=lambda time: np.inf):
        self.largest, self.taken = largest, []
        self.x, self.v = np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3))

    def step(self, time, h):
        if h > self.largest(time):
            return StepReport(reason="Newton did not converge")
        self.v = (self.v - 400 * h * self.x) / (1 + 400 * h * h)
        self.x = self.x + h * self.v
        self.taken.append(h)
        return StepReport(accepted=True, newton_iterations=2, linear_iterations=9, residual=1e-4, contact_gap=1e-6,
                          stages={"solve": 1e-5})

    def arrays(self):
        return {"spring.x": self.x, "spring.v": self.v}

    def restore(self, arrays):
        self.x, self.v = arrays["spring.x"].copy(), arrays["spring.v"].copy()

    def counts(self):
        return {"lagrangian": 1, "eil": int(self.x[0, 0] < 0)}

    def energies(self):
        return {"kinetic": float(np.sum(self.v**2) / 2), "potential": float(200 * np.sum(self.x**2))}

    def invariants(self, time, energies):
        return Invariants(kinetic_energy=energies["kinetic"], potential_energy=energies["potential"])

    def components(self):
        return {}

    def half_step_errors(self, before, time, h):
        return {"x": float(np.max(np.abs(before["spring.x"] - self.x)))}


@pytest.fixture
def spring(monkeypatch):
    """Make the loop simulate a spring; returns the function that sets which steps it rejects."""

    def use(largest=lambda time: np.inf):
        made = Spring(largest)
        monkeypatch.setattr(simulation, "assemble", lambda scene: made)
        return made

    use()
    return use


def contents(directory: Path) -> dict[str, bytes]:
    """All frames and the trajectory, bytewise."""
    return {path.name: path.read_bytes() for path in [*frame_paths(directory), directory / "trajectory.h5"]}


def test_frames_are_at_their_times_and_the_report_has_what_applies(spring, tmp_path):
    report = run(scene(), tmp_path)
    frames = [read_frame(path) for path in frame_paths(tmp_path)]
    assert [frame.time for frame in frames] == [k / 24 for k in range(3)]
    assert frames[2].series["dt"] == pytest.approx(1 / 24 / 42, rel=0.2) and frames[2].series["kinetic_energy"] > 0
    assert report == json.loads((tmp_path / "report.json").read_text())
    assert report["state"] == "succeeded" and report["time"]["simulated_s"] == 0.1
    assert report["time"]["steps"] == frames[2].step + 17 and "stages" in report["time"]
    assert report["error"]["newton_iterations"] == {"median": 2.0, "max": 2}
    assert 0 < report["error"]["energy_drift"] < 1
    assert set(report["error"]) == {"newton_residual_max", "newton_iterations", "linear_iterations",
                                    "contact_gap_max", "energy_drift"}
    assert report["counts"] == {"lagrangian": 1, "eil_max": 1}
    assert json.loads((tmp_path / "job.json").read_text())["state"] == "succeeded"
    assert {path.name for path in tmp_path.iterdir()} == {
        "scene.json", "job.json", "frames", "trajectory.h5", "checkpoint.h5", "report.json", "log.jsonl"}


def test_memory_is_told_per_node_where_there_are_nodes(spring, tmp_path):
    with_nodes = run(scene(), tmp_path / "some")
    assert with_nodes["memory_per_node_bytes"] < with_nodes["memory_peak_bytes"] // 2  # there are two
    spring().nodes = 0
    without = run(scene(), tmp_path / "none")
    assert "memory_per_node_bytes" not in without and without["memory_peak_bytes"] > 0


def test_contacts_that_begin_and_end_are_added_up(spring, tmp_path):
    made = spring()
    made.report_keys = {"contacts_added", "contacts_removed", "addition_gap_max"}
    changes = iter([dict(added=3, addition_gap=0.2), dict(added=1, removed=2)])
    made.step = lambda time, h: StepReport(accepted=True, residual=0.0, **next(changes, {}))
    report = run(scene(), tmp_path)
    assert (report["counts"]["contacts_added"], report["counts"]["contacts_removed"]) == (4, 2)
    assert report["error"]["addition_gap_max"] == 0.2


def test_rejected_steps_are_halved_and_grow_back(spring, tmp_path):
    taken = spring(lambda time: 0.3e-3 if 0.02 < time < 0.03 else np.inf).taken
    report = run(scene(), tmp_path)
    assert report["time"]["rejected_steps"] >= 2 and min(taken) == report["time"]["dt_min"] <= 0.25e-3
    assert max(taken[-20:]) == 1e-3
    events = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    rejected = [event for event in events if event["event"] == "rejected"]
    assert len(rejected) == report["time"]["rejected_steps"] and rejected[0]["reason"] == "Newton did not converge"


def test_a_step_below_the_minimum_ends_the_job_with_the_reason(spring, tmp_path):
    spring(lambda time: 0.0 if time > 0.05 else np.inf)
    with pytest.raises(SimulationFailed, match=r"Newton did not converge; a step of .* none below 1e-05"):
        run(scene(), tmp_path)
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["state"] == "failed" and "Newton" in report["reason"]
    assert len(frame_paths(tmp_path)) == 2
    job = json.loads((tmp_path / "job.json").read_text())
    assert job["state"] == "failed" and job["reason"] == report["reason"]


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_nothing_that_is_no_number_is_written(spring, tmp_path, poison):
    made = spring()
    sound = made.step

    def step(time, h):
        report = sound(time, h)
        if time > 0.05:
            made.v[0, 1] = poison
        return report

    made.step = step
    with pytest.raises(SimulationFailed, match=r"spring\.v is no longer finite"):
        run(scene(), tmp_path)
    assert len(frame_paths(tmp_path)) == 2
    with pytest.raises(SimulationFailed):
        run(scene(), tmp_path, resume=True)


def stop_after(steps: int):
    """A should_stop that lets so many steps happen."""
    remaining = iter(range(steps))
    return lambda: next(remaining, None) is None


@pytest.mark.parametrize("steps", [0, 1, 20, 42, 43, 60, 95])
def test_a_cancelled_job_resumes_bitwise(spring, tmp_path, steps):
    def awkward(time):
        return 0.3e-3 if 0.02 < time < 0.03 else np.inf

    spring(awkward)
    run(scene(), tmp_path / "whole")
    spring(awkward)
    report = run(scene(), tmp_path / "parts", should_stop=stop_after(steps))
    assert report["state"] == "cancelled" and report["time"]["steps"] == steps
    spring(awkward)
    resumed = run(scene(), tmp_path / "parts", resume=True)
    assert contents(tmp_path / "parts") == contents(tmp_path / "whole")
    unbroken = json.loads((tmp_path / "whole" / "report.json").read_text())
    assert resumed["error"] == unbroken["error"] and resumed["counts"] == unbroken["counts"]
    assert resumed["time"]["steps"] == unbroken["time"]["steps"]
    assert json.loads((tmp_path / "parts" / "job.json").read_text())["attempts"] == 2


def test_frames_after_the_checkpoint_are_written_again(spring, tmp_path):
    run(scene(), tmp_path / "whole")
    spring()
    run(scene(), tmp_path / "parts", should_stop=stop_after(20))
    early = (tmp_path / "parts" / "checkpoint.h5").read_bytes()
    spring()
    run(scene(), tmp_path / "parts", resume=True)
    (tmp_path / "parts" / "checkpoint.h5").write_bytes(early)  # as if killed before the later checkpoints
    spring()
    told = []
    run(scene(), tmp_path / "parts", resume=True, on_frame=lambda frame: told.append(frame.index))
    assert told == [1, 2] and contents(tmp_path / "parts") == contents(tmp_path / "whole")


def test_until_ends_early_and_a_resumed_run_goes_on(spring, tmp_path):
    spring()
    run(scene(), tmp_path / "whole")
    spring()
    assert run(scene(), tmp_path / "parts", until=1 / 24)["time"]["simulated_s"] == 1 / 24
    spring()
    run(scene(), tmp_path / "parts", resume=True)
    assert contents(tmp_path / "parts") == contents(tmp_path / "whole")


def test_a_directory_of_another_scene_is_left_alone(spring, tmp_path):
    run(scene(), tmp_path)
    before = contents(tmp_path)
    for resume in (False, True):
        with pytest.raises(DirectoryTaken, match=r"another scene \(spring\)"):
            run(scene(gravity=[0, 0, -1]), tmp_path, resume=resume)
    assert contents(tmp_path) == before


def test_a_new_run_of_the_same_scene_starts_over(spring, tmp_path):
    run(scene(), tmp_path)
    spring()
    assert run(scene(), tmp_path, until=0.05)["time"]["simulated_s"] == 0.05
    assert len(frame_paths(tmp_path)) == 2


def test_a_full_disk_ends_the_job_with_the_reason(spring, tmp_path, monkeypatch):
    whole = files.os.fsync

    def full(descriptor):
        if len(frame_paths(tmp_path)) >= 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        whole(descriptor)

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(SimulationFailed, match="No space left on device"):
        run(scene(), tmp_path)
    monkeypatch.undo()
    assert [read_frame(path).index for path in frame_paths(tmp_path)] == [0, 1]
    assert not list(tmp_path.rglob("*" + files.ASIDE))


def test_an_unforeseen_error_is_reported_as_one(spring, tmp_path):
    def broken(time):
        raise IndexError("no such node")

    spring(broken)
    with pytest.raises(SimulationFailed, match="IndexError: no such node"):
        run(scene(), tmp_path)
    assert json.loads((tmp_path / "report.json").read_text())["state"] == "failed"


def test_the_error_estimate_samples_one_step_per_frame_and_changes_nothing(spring, tmp_path):
    run(scene(), tmp_path / "plain")
    spring()
    report = run(scene(output={"error_estimate": True}), tmp_path / "estimated")
    assert report["error"]["step_error"]["samples"] == 3 and report["error"]["step_error"]["x"]["max"] > 0
    assert contents(tmp_path / "plain") == contents(tmp_path / "estimated")


def test_progress_is_throttled_and_ends_with_the_last_step(spring, tmp_path, monkeypatch):
    told = []
    run(scene(), tmp_path, on_progress=told.append)
    assert told[-1].time == told[-1].until == 0.1 and told[-1].frame == 3 and told[-1].s_per_step > 0
    assert len(told) < 50


def test_without_frames_none_are_written_and_all_are_told(spring, tmp_path):
    told = []
    run(scene(output={"frames": False}), tmp_path, on_frame=told.append)
    assert [frame.index for frame in told] == [0, 1, 2] and frame_paths(tmp_path) == []


def test_a_torn_log_line_is_ended(spring, tmp_path):
    run(scene(), tmp_path, should_stop=stop_after(3))
    with open(tmp_path / "log.jsonl", "a") as log:
        log.write('{"at": "20')
    run(scene(), tmp_path, resume=True)
    lines = (tmp_path / "log.jsonl").read_text().splitlines()
    assert lines.count('{"at": "20') == 1 and json.loads(lines[-1])["event"] == "succeeded"
