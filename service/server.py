"""The service as a whole: store, supervisor, viewer and HTTP server, started and stopped together."""

import socket
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import uvicorn

from service.kept import KeptProcess
from service.security import is_loopback
from service.store import Store
from service.supervisor import WORKER, Supervisor

DEFAULT_HOST = "127.0.0.1"
DEFAULT_PORT = 8765
DEFAULT_VIEWER_PORT = 8766


class CannotServe(Exception):
    """The service cannot start as configured; the message says what to change."""


@dataclass(frozen=True)
class ServiceConfig:
    """Where the service listens and how much it runs."""

    data: Path
    host: str = DEFAULT_HOST
    port: int = DEFAULT_PORT  # 0: any free one
    viewer_port: int = DEFAULT_VIEWER_PORT  # 0: any free one
    workers: int = 1
    token: str | None = None
    worker_command: tuple[str, ...] = WORKER
    viewer: bool = True


class Service:
    """Everything that `strandline serve` runs."""

    def __init__(self, config: ServiceConfig) -> None:
        """Take the ports and open the store; raises `CannotServe`."""
        if not is_loopback(config.host) and config.token is None:
            raise CannotServe(f"{config.host} can be reached from other machines: set STRANDLINE_TOKEN to a secret "
                              "that clients must show, or serve on 127.0.0.1")
        self.config = config
        self.token = None if is_loopback(config.host) else config.token
        self.stopping = threading.Event()
        self._http: _Http | None = None
        self._listener = listen(config.host, config.port, "--port")
        self.port: int = self._listener.getsockname()[1]
        self.viewer_port = free_port(config.viewer_port) if config.viewer else None
        try:
            self.store = Store(config.data)
        except OSError as error:
            raise CannotServe(f"the data directory {config.data} cannot be used: {error.strerror}") from error
        self.supervisor = Supervisor(self.store, config.workers, command=config.worker_command)
        self._viewer = None if self.viewer_port is None else KeptProcess(
            "viewer", viewer_command(config.data, self.viewer_port), self.store.private / "viewer.log")

    @property
    def url(self) -> str:
        """Address of the page."""
        host = f"[{self.config.host}]" if ":" in self.config.host else self.config.host
        return f"http://{host}:{self.port}"

    def start(self) -> None:
        """Begin to run jobs and to show them."""
        self.supervisor.start()
        if self._viewer is not None:
            self._viewer.start()

    def close(self) -> None:
        """Stop viewer and jobs, whose checkpoints are written and which go back to the queue."""
        self.stopping.set()
        if self._viewer is not None:
            self._viewer.close()
        self.supervisor.close()

    def run(self) -> None:
        """Serve until the process is asked to end (then the signal is raised again), or `stop` is called."""
        from service.app import create_app

        config = uvicorn.Config(create_app(self), log_level="warning", timeout_graceful_shutdown=3, server_header=False)
        self._http = _Http(config, self.stopping)
        self._http.run(sockets=[self._listener])

    def stop(self) -> None:
        """Have `run` return; for callers that run it in a thread."""
        self.stopping.set()
        if self._http is not None:
            self._http.should_exit = True


class _Http(uvicorn.Server):
    """Tells event streams about the end, so that they close and the server need not wait for them."""

    def __init__(self, config: uvicorn.Config, stopping: threading.Event) -> None:
        super().__init__(config)
        self._stopping = stopping

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        self._stopping.set()
        super().handle_exit(sig, frame)


def viewer_command(data: Path, port: int) -> list[str]:
    """Return the command of the browser viewer on a data directory."""
    return [sys.executable, "-P", "-m", "viewer.live", "--data", str(data), "--host", DEFAULT_HOST, "--port", str(port)]


def listen(host: str, port: int, option: str) -> socket.socket:
    """Return a socket that listens on a port, any free one for 0; raises `CannotServe`."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(128)
    except (OSError, OverflowError) as error:
        listener.close()
        raise CannotServe(f"port {port} on {host} cannot be used ({error}); is another service running? "
                          f"Choose a port with {option}, 0 for any free one") from error
    return listener


def free_port(port: int) -> int:
    """Return `port` where it is free on this machine's own address, any free one for 0; raises `CannotServe`."""
    with listen(DEFAULT_HOST, port, "--viewer-port") as probe:
        return probe.getsockname()[1]
