"""The commands that talk to a service: `submit`, `jobs`, `show`, `cancel`, `fetch`."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn, TransferSpeedColumn
from rich.table import Table

from service.terminal import (
    EXIT_ERROR,
    EXIT_FAILED,
    EXIT_INVALID,
    STARTING,
    STATE_STYLES,
    RunBar,
    err,
    fail,
    out,
    report_table,
    scene_path,
    token,
)
from service.wording import clock, duration, number

if TYPE_CHECKING:
    from service.client import Client

Server = Annotated[str, typer.Option("--server", envvar="STRANDLINE_SERVER", help="Address of the service.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
HERE = "http://127.0.0.1:8765"


@contextmanager
def connected(server: str) -> "Iterator[Client]":
    """Give a client; ends the command with the service's words where it refuses or is not there."""
    from service.client import Client, ServiceError

    try:
        yield Client(server, token())
    except ServiceError as error:
        fail(error, EXIT_INVALID if error.scene_invalid else EXIT_ERROR)


def submit(
    scene: Annotated[str, typer.Argument(help="A JSON file, or the name of a shipped scene.")],
    follow: Annotated[bool, typer.Option("--follow", help="Show the progress, to the end.")] = False,
    key: Annotated[str | None, typer.Option("--key", help="Submitted twice with one key, it is one job.")] = None,
    server: Server = HERE, as_json: AsJson = False,
) -> None:
    """Submit a scene to a service; with --follow the exit code is that of `run`."""
    path = scene_path(scene)
    with connected(server) as client:
        job = client.submit(path.read_bytes(), key)
        if not as_json:
            out.print(f"{job['id']}  {client.server}/jobs/{job['id']}", soft_wrap=True)
        if follow:
            job = follow_job(client, job)
    if as_json:
        out.print_json(json.dumps(job))
    if follow and job["state"] != "succeeded":
        fail(f"the job is {job['state']}: {job.get('reason', 'stopped by a user')}", EXIT_FAILED)


def follow_job(client: "Client", job: dict[str, Any]) -> dict[str, Any]:
    """Show a job's progress to its end; returns the job as it is then."""
    with RunBar(job["scene"]) as bar:
        bar.say("waiting for a worker")
        for kind, data in client.events(job["id"]):
            if kind == "progress":
                bar.show(data)
            elif kind == "state":
                bar.say(STARTING if data["state"] == "running" else data["state"])
    return client.job(job["id"])


def jobs(
    state: Annotated[str | None, typer.Option(help="Only jobs in this state.")] = None,
    limit: Annotated[int, typer.Option(min=1, help="How many, the newest first.")] = 20,
    server: Server = HERE, as_json: AsJson = False,
) -> None:
    """List the jobs of a service."""
    if state is not None and state not in STATE_STYLES:
        fail(f"--state {state}: no such state (allowed: {', '.join(STATE_STYLES)})", EXIT_INVALID)
    with connected(server) as client:
        found = client.jobs(state, limit)
    if as_json:
        out.print_json(json.dumps(found))
        return
    table = Table(box=None)
    for column in ("job", "scene", "state", "done", "left", "submitted"):
        table.add_column(column, no_wrap=column != "scene", overflow="fold")
    for job in found:
        progress = job.get("progress", {})
        running = job["state"] == "running"
        done = f"{100 * progress['time'] / progress['until']:.0f} %" if progress else "–"
        table.add_row(job["id"], escape(job["scene"]), f"[{STATE_STYLES[job['state']]}]{job['state']}", done,
                      duration(progress.get("seconds_left")) if running else "", clock(job["created"]))
    out.print(table if found else "no jobs")


def show(job: str, server: Server = HERE, as_json: AsJson = False) -> None:
    """Show one job, with its report once it ended."""
    from service.client import ServiceError

    with connected(server) as client:
        found = client.job(job)
        try:
            report = client.report(job)
        except ServiceError:
            report = None  # it has not ended, or was killed before it could write one
    if as_json:
        out.print_json(json.dumps({**found, "report": report} if report else found))
        return
    style = STATE_STYLES[found["state"]]
    out.print(f"[bold]{escape(found['scene'])}[/] {found['id']} [{style}]{found['state']}[/], "
              f"submitted {clock(found['created'])}, attempt {found['attempts']} of {found['max_attempts']}")
    if "reason" in found:
        out.print(f"[red]{escape(found['reason'])}")
    if report:
        out.print(report_table(report))
    elif "progress" in found:
        progress = found["progress"]
        out.print(f"{progress['time']:.3f} of {progress['until']:g} s simulated, step {number(progress['step'])}, "
                  f"{duration(progress.get('s_per_step'))} a step, {duration(progress.get('seconds_left'))} left")


def cancel(job: str, server: Server = HERE) -> None:
    """Stop a job; what it has computed stays."""
    with connected(server) as client:
        found = client.cancel(job)
    out.print("stopping" if found["state"] == "running" else found["state"])


def fetch(
    job: str, directory: Annotated[Path, typer.Argument(help="Where the files go.")], server: Server = HERE,
) -> None:
    """Copy all files of a job into a directory."""
    with connected(server) as client:
        files = client.files(job)
        with Progress(TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TransferSpeedColumn(),
                      TimeRemainingColumn(), console=err) as progress:
            task = progress.add_task(f"{len(files)} files", total=sum(file["size"] for file in files))
            for file in files:
                for piece in client.download(job, file["name"], directory):
                    progress.advance(task, piece)
    out.print(f"{len(files)} files in {directory}", soft_wrap=True)
