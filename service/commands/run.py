"""`strandline run`: one scene in this process."""

import json
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from service.terminal import (
    DEFAULT_DATA,
    EXIT_FAILED,
    EXIT_INVALID,
    EXIT_STOPPED,
    RunBar,
    err,
    fail,
    out,
    report_table,
    scene_path,
)

if TYPE_CHECKING:
    from engine.scene.schema import Scene


def run(
    scene: Annotated[str | None, typer.Argument(help="A JSON file, or the name of a shipped scene.")] = None,
    directory: Annotated[Path | None, typer.Option("--out", help="Directory of the results.")] = None,
    overrides: Annotated[list[str] | None, typer.Option("--set", help="key.path=value, any number of times.")] = None,
    until: Annotated[float | None, typer.Option(help="Stop at this simulated time [s].", min=0.0)] = None,
    threads: Annotated[int | None, typer.Option(help="Threads at most, all by default; small scenes use one.", min=1)] = None,
    resume: Annotated[Path | None, typer.Option(help="Continue the run in this directory from its checkpoint.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Simulate one scene, here and now.

    Exit code 0: done; 2: the scene is not valid; 3: the simulation failed; 130: stopped by Ctrl-C, with a checkpoint.
    """
    loaded = _load(scene, resume, overrides or [])
    target = resume or directory or DEFAULT_DATA / f"{time.strftime('%Y%m%d-%H%M%S')}-{loaded.name}"
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        fail(error)
    report = _simulate(loaded, target, until, threads, resume is not None)
    if as_json:
        print(json.dumps(report, indent=2))
    else:
        out.print(report_table(report))
    err.print(f"results   {escape(str(target))}\nrecording {escape(str(target / 'recording.rrd'))}\n"
              f"watch     strandline view {escape(str(target))}", soft_wrap=True)
    if report["state"] == "failed":
        fail(f"{report['reason']}; the results up to there are kept", EXIT_FAILED)
    if report["state"] == "cancelled":
        err.print(f"stopped; continue with: strandline run --resume {escape(str(target))}", soft_wrap=True)
        raise typer.Exit(EXIT_STOPPED)


def _load(scene: str | None, resume: Path | None, overrides: list[str]) -> "Scene":
    """Return the scene to run; ends the command with all that is wrong with it."""
    from engine.scene.load import SceneError, load_scene

    if (scene is None) == (resume is None):
        fail("name a scene to run, or --resume a directory, and not both", EXIT_INVALID)
    source = scene_path(scene) if scene is not None else _scene_of(resume)
    try:
        return load_scene(source, overrides)
    except SceneError as error:
        fail(error, EXIT_INVALID)


def _simulate(scene: "Scene", target: Path, until: float | None, threads: int | None, resume: bool) -> dict[str, Any]:
    """Run with a progress bar and a recording, until Ctrl-C; returns the report, of a failed run too."""
    from engine.run.compile_cache import prepare_compile_cache

    prepare_compile_cache()  # before anything imports numba
    from engine.run.checkpoint import CheckpointMismatch
    from engine.run.compile_ahead import compile_ahead
    from engine.run.directory import DirectoryTaken
    from engine.run.simulation import Progress, SimulationFailed
    from engine.run.simulation import run as simulate
    from service.pace import Pace
    from service.worker import progress_event
    from viewer.recording import Recorder

    compile_ahead(scene, threads)
    stop: list[bool] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.append(True))
    pace = Pace()
    recorder = Recorder(scene, target)
    with RunBar(scene.name) as bar:

        def show(progress: Progress) -> None:
            bar.show(progress_event(progress, pace))

        try:
            return simulate(scene, target, until=until, threads=threads, resume=resume, on_progress=show,
                            on_frame=recorder.log, should_stop=lambda: bool(stop))
        except SimulationFailed:
            return json.loads((target / "report.json").read_bytes())
        except (DirectoryTaken, CheckpointMismatch, ValueError) as error:  # ValueError: more threads than there are
            fail(error, EXIT_INVALID)
        finally:
            recorder.close()


def _scene_of(directory: Path | None) -> Path:
    assert directory is not None
    path = directory / "scene.json"
    if not path.is_file():
        fail(f"{path}: no such file; --resume needs the directory of an earlier run", EXIT_INVALID)
    return path
