"""`strandline run`: one scene in this process."""

import json
import signal
import time
from pathlib import Path
from typing import Annotated

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


def run(
    scene: Annotated[str | None, typer.Argument(help="A JSON file, or the name of a shipped scene.")] = None,
    directory: Annotated[Path | None, typer.Option("--out", help="Directory of the results.")] = None,
    overrides: Annotated[list[str] | None, typer.Option("--set", help="key.path=value, any number of times.")] = None,
    until: Annotated[float | None, typer.Option(help="Stop at this simulated time [s].", min=0.0)] = None,
    threads: Annotated[int | None, typer.Option(help="Threads to use; all by default.", min=1)] = None,
    resume: Annotated[Path | None, typer.Option(help="Continue the run in this directory from its checkpoint.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Simulate one scene, here and now.

    Exit code 0: done; 2: the scene is not valid; 3: the simulation failed; 130: stopped by Ctrl-C, with a checkpoint.
    """
    from engine.run.compile_cache import prepare_compile_cache

    prepare_compile_cache()  # before anything imports numba
    from viewer.recording import Recorder

    from engine.run.checkpoint import CheckpointMismatch
    from engine.run.directory import DirectoryTaken
    from engine.run.simulation import Progress, SimulationFailed
    from engine.run.simulation import run as simulate
    from engine.scene.load import SceneError, load_scene
    from service.pace import Pace
    from service.worker import progress_event

    if (scene is None) == (resume is None):
        fail("name a scene to run, or --resume a directory, and not both", EXIT_INVALID)
    try:
        source = scene_path(scene) if scene is not None else _scene_of(resume)
        loaded = load_scene(source, overrides or [])
    except SceneError as error:
        fail(error, EXIT_INVALID)
    target = resume or directory or DEFAULT_DATA / f"{time.strftime('%Y%m%d-%H%M%S')}-{loaded.name}"
    target.mkdir(parents=True, exist_ok=True)

    stop: list[bool] = []
    signal.signal(signal.SIGINT, lambda *_: stop.append(True))
    signal.signal(signal.SIGTERM, lambda *_: stop.append(True))
    pace = Pace()
    recorder = Recorder(loaded, target)
    try:
        with RunBar(loaded.name) as bar:
            def show(progress: Progress) -> None:
                bar.show(progress_event(progress, pace))

            report = simulate(loaded, target, until=until, threads=threads, resume=resume is not None,
                              on_progress=show, on_frame=recorder.log, should_stop=lambda: bool(stop))
    except SimulationFailed as error:
        if as_json:
            out.print_json((target / "report.json").read_text())
        fail(f"{error}\nthe results up to there are in {target}", EXIT_FAILED)
    except (DirectoryTaken, CheckpointMismatch, ValueError) as error:
        fail(error, EXIT_INVALID)
    finally:
        recorder.close()
    if as_json:
        out.print_json(json.dumps(report))
    else:
        out.print(report_table(report))
    err.print(f"results   {escape(str(target))}\nrecording {escape(str(target / 'recording.rrd'))}\n"
              f"watch     strandline view {escape(str(target))}", soft_wrap=True)
    if report["state"] != "succeeded":
        err.print(f"stopped; continue with: strandline run --resume {escape(str(target))}", soft_wrap=True)
        raise typer.Exit(EXIT_STOPPED)


def _scene_of(directory: Path | None) -> Path:
    assert directory is not None
    path = directory / "scene.json"
    if not path.is_file():
        fail(f"{path}: no such file; --resume needs the directory of an earlier run", EXIT_INVALID)
    return path
