"""The Rerun web viewer on this service's own address, so that a recording is played without any other host.

The viewer's files are inside the program that the `rerun-sdk` wheel installs, which hands them out over HTTP only.
They are fetched from it once, over the loopback, and kept in the cache directory.
"""

import importlib.metadata
import os
import socket
import subprocess
import tempfile
import threading
import time
from pathlib import Path

import httpx
from fastapi import APIRouter
from fastapi.responses import FileResponse, Response

from engine.run.compile_cache import cache_parent
from engine.run.files import ASIDE
from service.kept import end
from service.problems import ProblemError

router = APIRouter(prefix="/recording", include_in_schema=False)

FILES = {"index.html": "text/html; charset=utf-8", "re_viewer.js": "text/javascript",
         "re_viewer_bg.wasm": "application/wasm"}
# The page would call out for fonts, versions and telemetry: nothing but this address may be asked.
POLICY = ("default-src 'self'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval'; style-src 'self' 'unsafe-inline'; "
          "img-src 'self' data: blob:; worker-src 'self' blob:; connect-src 'self' data: blob:; frame-ancestors 'self'")
PATIENCE = 20.0  # [s]
_one_at_a_time = threading.Lock()


@router.get("/{name}")
def viewer_file(name: str) -> Response:
    """Send one file of the viewer; `/recording/index.html?url=...` plays a recording."""
    if name not in FILES:
        raise ProblemError(404, f"The recording viewer has no file {name!r}.")
    with _one_at_a_time:
        directory = viewer_files()
    return FileResponse(directory / name, media_type=FILES[name],
                        headers={"Content-Security-Policy": POLICY, "Cache-Control": "no-cache"})


def viewer_files() -> Path:
    """Return the directory with the viewer's files, filled at the first call; raises the problem 503."""
    directory = cache_parent() / f"rerun-{importlib.metadata.version('rerun-sdk')}"
    if all((directory / name).exists() for name in FILES):
        return directory
    directory.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as home:
        port, grpc_port = _free_ports(2)
        # a home of its own: the program leaves the user's settings alone, and on a first start it sends nothing
        server = subprocess.Popen(
            [_program(), "--serve-web", "--bind", "127.0.0.1", "--port", str(grpc_port), "--web-viewer-port",
             str(port)],
            env={"HOME": home, "PATH": os.environ.get("PATH", "")}, stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            _wait_for(port, server)
            for name in FILES:
                content = httpx.get(f"http://127.0.0.1:{port}/{name}", trust_env=False, timeout=PATIENCE)
                aside = directory / (name + ASIDE)
                aside.write_bytes(content.raise_for_status().content)
                aside.replace(directory / name)
        except (httpx.HTTPError, OSError) as error:
            raise ProblemError(503, f"The recording viewer could not be prepared: {error}") from error
        finally:
            end(server)
    return directory


def _program() -> str:
    import rerun_cli

    return str(Path(rerun_cli.__path__[0]) / "rerun")


def _free_ports(count: int) -> list[int]:
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return ports


def _wait_for(port: int, server: subprocess.Popen) -> None:
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if server.poll() is not None:
            raise OSError(f"its program ended with code {server.returncode}")
        try:
            socket.create_connection(("127.0.0.1", port), 1.0).close()
        except OSError:
            time.sleep(0.05)
        else:
            return
    raise OSError(f"its program did not answer within {PATIENCE:g} s")
