"""The server of the 3D page: one session for each open page, one thread that reads frames and draws for all."""

import logging
import threading
import time
from pathlib import Path

import viser

from viewer.gate import LOCAL_NAMES, Gate, asked_job, guarding
from viewer.session import Session

TICK = 1 / 30  # between looks at the pages' widgets [s]
log = logging.getLogger(__name__)


class PrivateServer(viser.ViserServer):
    """A viser server that no visitor can open to the internet."""

    def request_share_url(self, verbose: bool = True) -> None:
        """Refuse: any visitor may ask for a public tunnel, and none gets one."""


class LiveViewer:
    """Serves the page until `stop`."""

    def __init__(self, data: Path, host: str, port: int, token: str | None = None):
        """Start to serve the jobs in `data`; where `port` is taken the next free one is used, 0 lets the system choose.

        Raises ValueError for an address that other machines can reach when there is no token.
        """
        if host not in LOCAL_NAMES and token is None:
            raise ValueError(f"address {host} can be reached from other machines: a token is needed")
        self._sessions: dict[int, Session] = {}
        self._lock = threading.Lock()  # guards _sessions
        self._visited = threading.Event()  # there are sessions
        self._stopping = threading.Event()
        with guarding(Gate(LOCAL_NAMES if token is None else None, token)):
            self._server = PrivateServer(host=host, port=port, verbose=False)

        @self._server.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            job = asked_job.get()  # read here: a function in viser's thread pool would not see it
            with self._lock:
                self._sessions[client.client_id] = Session(client, data, job)
            self._visited.set()

        @self._server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            with self._lock:
                self._sessions.pop(client.client_id, None)

        self._reader = threading.Thread(target=self._read, name="frame reader", daemon=True)
        self._reader.start()

    @property
    def port(self) -> int:
        """The port that is served."""
        return self._server.get_port()

    def stop(self) -> None:
        """Stop serving."""
        self._stopping.set()
        self._visited.set()
        self._reader.join()
        self._server.stop()

    def wait(self) -> None:
        """Return when `stop` was called."""
        self._stopping.wait()

    def _read(self) -> None:
        while not self._stopping.is_set():
            self._visited.wait()
            with self._lock:
                sessions = list(self._sessions.items())
                if not sessions:
                    self._visited.clear()
            for client_id, session in sessions:
                try:
                    session.tick(time.monotonic())
                except Exception:  # one page's trouble must not stop the others
                    log.exception("page %d: cannot draw", client_id)
            self._stopping.wait(TICK)
