"""One attempt at one job: `python -m service.worker`, started by the supervisor, never by hand.

Exit codes: 0 done, 3 the simulation gave up (the reason is the last line on stderr), 75 stopped as asked. Anything
else is an accident, after which the supervisor tries again from the checkpoint.
"""

import argparse
import fcntl
import json
import os
import signal
import sqlite3
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.pace import Pace, finite
from service.store import LeaseLost, Store
from service.supervisor import EXIT_FAILED, EXIT_STOPPED, EXIT_SUCCEEDED
from service.tether import tether

if TYPE_CHECKING:
    from engine.run.simulation import Progress

PROGRESS_INTERVAL = 0.25  # [s]


class ProgressWriter:
    """Publishes progress and log in the store, often enough to follow and seldom enough not to slow the run."""

    def __init__(self, store: Store, job: str, fence: int) -> None:
        """Publish as the holder of `fence`."""
        self._store, self._job, self._fence = store, job, fence
        self._log = store.directory(job) / "log.jsonl"
        self._published = self._log.stat().st_size if self._log.exists() else 0  # what earlier attempts wrote [bytes]
        self.lost = False  # another worker has the job now: this one must stop
        self._pace = Pace()
        self._next = 0.0
        self._last: dict[str, Any] | None = None

    def __call__(self, progress: "Progress") -> None:
        """Take note of a step."""
        self._last = progress_event(progress, self._pace)
        if time.monotonic() >= self._next:
            self.flush()

    def flush(self) -> None:
        """Publish the last step, and what the log has gained."""
        try:
            if self._last is not None:
                self._store.report_progress(self._job, self._fence, self._last)
            self._publish_log()
        except LeaseLost:
            self.lost = True
        except sqlite3.OperationalError as error:  # the store is locked or the disk full: a run needs neither
            print(f"progress not published: {error}", file=sys.stderr)
        self._last = None
        self._next = time.monotonic() + PROGRESS_INTERVAL


    def _publish_log(self) -> None:
        """Publish the lines that the run has added to its log."""
        if not self._log.exists():
            return
        with self._log.open("rb") as file:
            file.seek(self._published)
            *lines, _torn = file.read().split(b"\n")
        if lines:
            self._store.log(self._job, self._fence, [json.loads(line) for line in lines if line])
            self._published += sum(len(line) + 1 for line in lines)


def progress_event(progress: "Progress", pace: Pace) -> dict[str, Any]:
    """Return what clients see of a step: its fields, finite numbers only, with the seconds that are left."""
    pace.note(progress.time)
    return finite({**vars(progress), "seconds_left": pace.seconds_left(progress.until)})


def run_job(data: Path, job: str, fence: int, threads: int) -> int:
    """Run the job to its end, from its checkpoint where there is one; returns the exit code."""
    os.environ["NUMBA_NUM_THREADS"] = str(threads)
    from engine.run.compile_cache import prepare_compile_cache

    prepare_compile_cache()  # before anything imports numba
    from engine.run.checkpoint import CheckpointMismatch
    from engine.run.compile_ahead import compile_ahead
    from engine.run.directory import DirectoryTaken
    from engine.run.simulation import SimulationFailed, run
    from engine.scene.load import load_scene
    from viewer.recording import Recorder

    store = Store(data)
    directory = store.directory(job)
    stop = []
    signal.signal(signal.SIGTERM, lambda *_: stop.append(True))
    scene = load_scene(directory / "scene.json")
    compile_ahead(scene, threads)
    progress = ProgressWriter(store, job, fence)
    recorder = Recorder(scene, directory)
    try:
        report = run(scene, directory, threads=threads, resume=True, on_progress=progress, on_frame=recorder.log,
                     should_stop=lambda: bool(stop) or progress.lost)
    except (SimulationFailed, DirectoryTaken, CheckpointMismatch) as failure:
        progress.flush()
        print(failure, file=sys.stderr)
        return EXIT_FAILED
    finally:
        recorder.close()
    progress.flush()
    return EXIT_SUCCEEDED if report["state"] == "succeeded" else EXIT_STOPPED


def main() -> None:
    """Parse the supervisor's command line and run."""
    parser = argparse.ArgumentParser(description="Run one job of a Strandline service.")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--job", required=True)
    parser.add_argument("--fence", type=int, required=True)
    parser.add_argument("--threads", type=int, required=True)
    parser.add_argument("--parent", type=int, required=True)
    arguments = parser.parse_args()
    tether(arguments.parent)
    hold(arguments.data / arguments.job)
    sys.exit(run_job(arguments.data, arguments.job, arguments.fence, arguments.threads))


def hold(directory: Path) -> None:
    """Wait until no other worker writes in the job's directory, and keep others out until this process ends."""
    fcntl.flock(os.open(directory, os.O_RDONLY), fcntl.LOCK_EX)


if __name__ == "__main__":
    main()
