"""The commands that serve: `serve`, `demo`, `view`."""

import logging
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from service.terminal import (
    DEFAULT_DATA,
    EXIT_FAILED,
    EXIT_INVALID,
    err,
    fail,
    out,
    report_table,
    scene_path,
    token,
)

if TYPE_CHECKING:
    from service.server import Service

Data = Annotated[Path, typer.Option("--data", envvar="STRANDLINE_DATA", help="Directory of all jobs.")]
ViewerPort = Annotated[int, typer.Option("--viewer-port", min=0, max=65535, help="Port of the 3D page; 0: any free.")]
Open = Annotated[bool, typer.Option("--open/--no-open", help="Open the page in a browser.")]

HERE = "127.0.0.1"
DEMO_SCENE = "quickstart"
START_PATIENCE = 30.0  # [s]


def serve(
    host: Annotated[str, typer.Option(help="Address; others than this machine's own need STRANDLINE_TOKEN.")] = HERE,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of API and page; 0: any free.")] = 8765,
    data: Data = DEFAULT_DATA,
    workers: Annotated[int, typer.Option(min=1, help="Jobs that run at the same time; they share the threads.")] = 1,
    viewer_port: ViewerPort = 8766,
) -> None:
    """Run the service: API, queue, page and 3D viewer, until Ctrl-C.

    Jobs that run then write a checkpoint and continue when the service is started again.
    """
    service = _service(host=host, port=port, data=data, workers=workers, viewer_port=viewer_port)
    logging.getLogger("service").setLevel(logging.INFO)  # what becomes of jobs
    _introduce(service)
    try:
        service.run()
    except KeyboardInterrupt:
        err.print("closed; jobs that had not ended continue when the service is started again")


def demo(
    data: Data = DEFAULT_DATA, open_page: Open = True,
    exit_when_done: Annotated[bool, typer.Option("--exit-when-done", help="End when the scene is finished.")] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of API and page; 0: any free.")] = 0,
    viewer_port: ViewerPort = 0,
) -> None:
    """Show everything: serve, run the quick-start scene, open its page."""
    from service.client import Client, ServiceError
    from service.commands.client import follow_job

    scene = scene_path(DEMO_SCENE)
    service = _service(port=port, data=data, viewer_port=viewer_port)
    serving = threading.Thread(target=service.run, name="serve")
    serving.start()
    try:
        client = Client(service.url)
        _until(lambda: _answers(client.server + "/readyz"), "the service did not start")
        _introduce(service)
        job = client.submit(scene.read_bytes())
        page = f"{service.url}/jobs/{job['id']}"
        err.print(f"job       {page}", soft_wrap=True)
        if open_page:
            _open(page)
        job = follow_job(client, job)
        directory = data / job["id"]
        if job["state"] == "succeeded":
            out.print(report_table(client.report(job["id"])))
        err.print(f"recording {escape(str(directory / 'recording.rrd'))}\n"
                  f"report    {escape(str(directory / 'report.json'))}\njob       {page}", soft_wrap=True)
        if not exit_when_done:
            err.print("serving until Ctrl-C")
            serving.join()
        if job["state"] != "succeeded":
            fail(f"the demo's job is {job['state']}: {job.get('reason', 'stopped by a user')}", EXIT_FAILED)
    except ServiceError as error:
        fail(error)
    except KeyboardInterrupt:
        err.print("closing")
    finally:
        service.stop()
        serving.join()


def view(
    what: Annotated[str, typer.Argument(metavar="DIR|ID", help="A job's directory, a data directory, or a job's id.")],
    data: Data = DEFAULT_DATA, viewer_port: ViewerPort = 8766, open_page: Open = True,
) -> None:
    """Show finished or running jobs in 3D, without a service."""
    from service.kept import end
    from service.server import CannotServe, free_port, viewer_command

    directory = Path(what) if Path(what).is_dir() else data / what
    if not directory.is_dir():
        fail(f"{what}: neither a directory nor a job in {data}", EXIT_INVALID)
    is_job = (directory / "scene.json").exists()
    root = directory.resolve().parent if is_job else directory.resolve()
    try:
        free = free_port(viewer_port)
    except CannotServe as error:
        fail(error)
    url = f"http://127.0.0.1:{free}/" + (f"?job={directory.resolve().name}" if is_job else "")
    viewer = subprocess.Popen(viewer_command(root, free), stdout=subprocess.DEVNULL)
    try:
        _until(lambda: viewer.poll() is not None or _answers(f"http://127.0.0.1:{free}/"), "the viewer did not start")
        if viewer.poll() is None:
            out.print(url, soft_wrap=True)
            if open_page:
                _open(url)
        code = viewer.wait()
    except KeyboardInterrupt:
        code = 0
    finally:
        end(viewer)
    if code:
        fail(f"the viewer ended with code {code}")


def _service(**options: Any) -> "Service":
    """Return a service that can start; ends the command with the reason where it cannot."""
    from service.server import CannotServe, Service, ServiceConfig

    logging.basicConfig(format="%(asctime)s %(name)s: %(message)s", stream=sys.stderr, level=logging.WARNING)
    try:
        return Service(ServiceConfig(token=token(), **options))
    except CannotServe as error:
        fail(error)


def _introduce(service: "Service") -> None:
    err.print(f"[bold]Strandline[/] {service.url}\nviewer    http://127.0.0.1:{service.viewer_port}\n"
              f"data      {escape(str(service.config.data))}", soft_wrap=True)


def _open(url: str) -> None:
    """Open a page in the user's browser, where there is one."""
    import webbrowser

    if not webbrowser.open(url):
        err.print("no browser was found: open the page by its address")


def _answers(url: str) -> bool:
    import httpx

    try:
        return httpx.get(url, trust_env=False, timeout=2.0, follow_redirects=False).status_code < 400
    except httpx.TransportError:
        return False


def _until(condition: Callable[[], bool], complaint: str) -> None:
    deadline = time.monotonic() + START_PATIENCE
    while not condition():
        if time.monotonic() > deadline:
            fail(complaint)
        time.sleep(0.05)
