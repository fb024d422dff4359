"""What the commands share on the terminal: messages, the progress bar, and how a scene is found."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import typer
from rich.console import Console, RenderableType
from rich.markup import escape
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn
from rich.table import Table
from rich.text import Text

from service.wording import duration, label, number, quantity

EXIT_ERROR = 1
EXIT_INVALID = 2  # the scene or the command line
EXIT_FAILED = 3  # the simulation, or a case of the validation
EXIT_STOPPED = 130  # by the user, as for any command that Ctrl-C ends

DEFAULT_DATA = Path("strandline-data")
STATE_STYLES = {"queued": "yellow", "running": "cyan", "succeeded": "green", "failed": "red", "cancelled": "dim"}

STARTING = "starting; the first run after an update compiles its kernels"

out = Console(highlight=False)
err = Console(stderr=True, highlight=False)


def fail(message: object, code: int = EXIT_ERROR) -> NoReturn:
    """Print what is wrong and end with an exit code."""
    err.print(f"[bold red]error:[/] {escape(str(message))}", soft_wrap=True)
    raise typer.Exit(code)


def scene_path(source: str) -> Path:
    """Return the file of a scene: a path, or the name of a shipped scene; ends the command where there is none."""
    from engine.scene.load import shipped_scenes

    path = Path(source)
    if path.is_file():
        return path
    shipped = shipped_scenes()
    if source in shipped:
        return shipped[source]
    fail(f"{source}: no such file, and no shipped scene (allowed: {', '.join(sorted(shipped))})", EXIT_INVALID)


def token() -> str | None:
    """Return the service's token from the environment."""
    return os.environ.get("STRANDLINE_TOKEN") or None


class _BarAndFigures(Progress):
    """A progress bar with a line of figures below, which so have room on a narrow terminal too."""

    def get_renderables(self) -> Iterator[RenderableType]:
        yield self.make_tasks_table(self.tasks)
        for task in self.tasks:
            yield Text(f"  {task.fields['figures']}", style="dim", no_wrap=True, overflow="ellipsis")


class RunBar:
    """A progress bar that follows a run: simulated time, steps a second, seconds a step, residual, time left."""

    def __init__(self, name: str) -> None:
        """Follow the scene `name`; use as a context."""
        self._progress = _BarAndFigures(
            SpinnerColumn(), TextColumn("[bold]{task.description}"), BarColumn(bar_width=None),
            TextColumn("{task.percentage:>3.0f} %"), console=err, expand=True)
        self._task: TaskID = self._progress.add_task(escape(name), total=None, figures=STARTING)

    def __enter__(self) -> "RunBar":
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def show(self, progress: dict[str, Any]) -> None:
        """Show a progress event."""
        per_step = progress.get("s_per_step")
        rate = f"{1 / per_step:.3g} steps/s · {duration(per_step)}/step" if per_step else "–"
        figures = (f"{progress['time']:.3f} of {progress['until']:g} s · {rate} · "
                   f"residual {number(progress['residual'])} · {duration(progress.get('seconds_left'))} left")
        self._progress.update(self._task, total=progress["until"], completed=progress["time"], figures=figures)

    def say(self, figures: str) -> None:
        """Show a word in place of figures."""
        self._progress.update(self._task, figures=figures)


def report_table(report: dict[str, Any]) -> Table:
    """Return a run's report as a table: what it cost, and how wrong it is."""
    table = Table(title=f"{report['scene']}: {report['state']}", title_justify="left", show_header=False, box=None)
    table.add_column(style="dim")
    table.add_column()
    for section in ("error", "time", "counts"):
        table.add_row(f"[bold]{ {'error': 'error', 'time': 'speed', 'counts': 'size'}[section] }", "")
        for key, value in report.get(section, {}).items():
            if key == "stages":
                value = {name: duration(stage["s_per_step"]) for name, stage in value.items()}
            table.add_row(f"  {label(key)}", quantity(key, value))
    return table
