"""Job directories as runs leave them, of frames made up by formula."""

import json
from collections.abc import Iterable
from pathlib import Path

from engine.run.frames import Frame, write_frame


def write_job(directory: Path, scene: dict, frames: Iterable[Frame], state: str = "succeeded") -> None:
    """Make `directory` a job directory with the scene and the frames."""
    directory.mkdir(parents=True)
    (directory / "scene.json").write_text(json.dumps(scene))
    (directory / "job.json").write_text(json.dumps({"state": state}))
    for frame in frames:
        write_frame(directory, frame)


def series_of(index: int, **counts: float) -> dict[str, float]:
    """What a solver may say of frame `index`."""
    return {
        "dt": 1e-3, "newton_iterations": 3.0 + index % 2, "linear_iterations": 40.0, "contact_gap": 1e-4,
        "residual": 10.0 ** (-5 - 0.1 * (index % 5)), "kinetic_energy": 1e-4 * index, "potential_energy": 1e-2 - 1e-4 * index,
        **counts,
    }  # fmt: skip
