"""The job directory: which scene it is for, in what state the job is, and its log."""

import hashlib
import json
from datetime import UTC, datetime
from pathlib import Path

from engine.run.checkpoint import checkpoint_path
from engine.run.files import ASIDE, write_whole
from engine.run.frames import drop_frames, frame_paths
from engine.scene.load import SceneError, load_scene
from engine.scene.schema import Scene


class DirectoryTaken(Exception):
    """A directory holds something that a job must not overwrite."""


def fingerprint(scene: Scene) -> str:
    """Return a hash of all that a scene says, the same however its file is laid out."""
    canonical = json.dumps(scene.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()


class JobDirectory:
    """The files of one job that are not frames or state: `scene.json`, `job.json`, `report.json`, `log.jsonl`."""

    def __init__(self, path: Path):
        self.path = path

    def open(self, scene: Scene, resume: bool) -> None:
        """Make the directory ready for `scene`; without `resume` an earlier run of the same scene is deleted.

        Raises DirectoryTaken where the directory holds the job of another scene, or frames of none.
        """
        (self.path / "frames").mkdir(parents=True, exist_ok=True)
        scene_path = self.path / "scene.json"
        if scene_path.exists():
            self._check_scene(scene_path, scene)
        elif frame_paths(self.path) or checkpoint_path(self.path).exists():
            raise DirectoryTaken(f"{self.path} holds frames or a checkpoint, but no scene.json that they belong to")
        else:
            write_whole(scene_path, scene.model_dump_json(indent=2).encode() + b"\n")
        for leftover in [*self.path.glob("*" + ASIDE), *(self.path / "frames").glob("*" + ASIDE)]:
            leftover.unlink()
        if not resume:
            drop_frames(self.path)
            for stale in (checkpoint_path(self.path), self.path / "report.json", self.path / "log.jsonl"):
                stale.unlink(missing_ok=True)
        self._mend_log()

    def set_state(self, state: str, **entries: object) -> None:
        """Write state and `entries` into `job.json`; entries that others put there stay."""
        path = self.path / "job.json"
        job = json.loads(path.read_text()) if path.exists() else {}
        if state == "running":
            job = {"strandline": 1, "started": _now(), **job, "attempts": job.get("attempts", 0) + 1}
            job.pop("finished", None)
            job.pop("reason", None)
        else:
            job["finished"] = _now()
        job |= {"state": state, **entries}
        write_whole(path, _json(job))

    def log(self, event: str, **entries: object) -> None:
        """Append one line to `log.jsonl`."""
        line = json.dumps({"at": _now(), "event": event, **entries})
        with open(self.path / "log.jsonl", "a") as file:
            file.write(line + "\n")

    def write_report(self, report: dict) -> None:
        """Write `report.json`."""
        write_whole(self.path / "report.json", _json(report))

    def _check_scene(self, path: Path, scene: Scene) -> None:
        try:
            held = load_scene(path)
        except SceneError as error:
            raise DirectoryTaken(f"{path} is no scene of this version, so its job is left alone: {error}") from error
        if fingerprint(held) != fingerprint(scene):
            raise DirectoryTaken(f"{self.path} holds the job of another scene ({held.name})")

    def _mend_log(self) -> None:
        """End a line that a kill cut short, so that the next one stands alone."""
        path = self.path / "log.jsonl"
        if path.exists() and (content := path.read_bytes()) and not content.endswith(b"\n"):
            with open(path, "ab") as file:
                file.write(b"\n")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def _json(value: dict) -> bytes:
    return json.dumps(value, indent=2, allow_nan=False).encode() + b"\n"
