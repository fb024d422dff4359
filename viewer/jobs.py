"""Job directories as the viewer sees them: which there are, the scene of one, and its frames as they appear."""

import json
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import h5py
import numpy as np

from engine.contact.obstacles import Obstacles
from engine.run.frames import Frame, frame_paths, read_frame
from engine.scene.build import Built, build
from engine.scene.load import load_scene
from engine.scene.schema import Scene

FRAMES_KEPT = 16  # recently drawn frames that stay in memory, for all pages together; up to 45 MB each

NO_OBSTACLES = Obstacles(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(0))


def job_ids(data: Path) -> list[str]:
    """Return the names of the job directories in `data`, the newest first."""
    written = [(path.stat().st_mtime_ns, path.parent.name) for path in data.glob("*/scene.json")]
    return [name for _, name in sorted(written, reverse=True)]


def read_frame_once(path: Path) -> Frame:
    """Return the frame at `path`, from memory where it was read lately and has not been rewritten since."""
    return _read(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=FRAMES_KEPT)
def _read(path: Path, _modified: int) -> Frame:
    return read_frame(path)


@dataclass
class Job:
    """One job directory and what has been seen of it so far."""

    directory: Path
    state: str = "queued"  # as job.json says
    frames: list[Path] = field(default_factory=list)  # in order of time, as of the last `look`
    times: list[float] = field(default_factory=list)  # of the frames whose series were read [s]
    series: list[dict[str, float]] = field(default_factory=list)  # of the same frames
    _first_written: int = 0

    def scene(self) -> tuple[Scene, Built]:
        """Return the scene and what is built from it; raises SceneError where it cannot be read."""
        scene = load_scene(self.directory / "scene.json")
        return scene, build(scene)

    def look(self) -> bool:
        """Read the job's state and list its frames anew; returns whether there are others than before.

        A run that started over has rewritten its first frame, so that all that was read before is dropped.
        """
        record = self.directory / "job.json"
        if record.exists():
            self.state = json.loads(record.read_bytes())["state"]
        frames = frame_paths(self.directory)
        first_written = frames[0].stat().st_mtime_ns if frames else 0
        if first_written != self._first_written or len(frames) < len(self.times):
            self.times.clear()
            self.series.clear()
            changed = True
        else:
            changed = len(frames) != len(self.frames)
        self.frames, self._first_written = frames, first_written
        return changed

    def read_series(self, limit: int) -> bool:
        """Read the series of up to `limit` more frames; returns whether any were left to read."""
        ahead = self.frames[len(self.times) : len(self.times) + limit]
        for path in ahead:
            with h5py.File(path, "r") as file:
                time, series = float(file.attrs["time"]), {k: float(v) for k, v in file["series"].attrs.items()}
            self.times.append(time)
            self.series.append(series)
        return bool(ahead)
