"""What a run leaves behind, to be compared with another run's."""

from pathlib import Path

import pytest

from engine.run.frames import frame_paths
from engine.run.simulation import run


def contents(directory: Path) -> dict[str, bytes]:
    """All frames and the trajectory, bytewise."""
    return {path.name: path.read_bytes() for path in [*frame_paths(directory), directory / "trajectory.h5"]}


def whole_run(scene, directory: Path) -> tuple[dict, dict[str, bytes], Path]:
    """Report, contents and directory of a run on one thread that nothing interrupts."""
    return run(scene, directory, threads=1), contents(directory), directory


def stop_after(steps: int):
    """A should_stop that lets so many steps happen."""
    remaining = iter(range(steps))
    return lambda: next(remaining, None) is None


def assert_the_same_on_two_threads(scene, directory: Path, expected: dict[str, bytes], monkeypatch) -> None:
    """A run on two threads leaves the same bits; skips the test on one processor."""
    monkeypatch.setattr("engine.run.threads.FEW_NODES", 0)  # small scenes would have one
    try:
        report = run(scene, directory, threads=2)
    except ValueError as error:
        pytest.skip(f"this machine has one processor: {error}")
    assert report["machine"]["threads"] == 2
    assert contents(directory) == expected


def assert_goes_on(scene, directory: Path, unbroken: tuple[dict, dict[str, bytes], Path]) -> None:
    """The job in `directory`, resumed, ends as the unbroken run did: the same bits, errors and counts."""
    report = run(scene, directory, resume=True, threads=1)
    assert contents(directory) == unbroken[1]
    assert report["error"] == unbroken[0]["error"] and report["counts"] == unbroken[0]["counts"]
