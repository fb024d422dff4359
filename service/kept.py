"""A helper process that is started again whenever it ends, until it is no longer wanted."""

import logging
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

PATIENCE = (0.2, 1.0, 5.0, 30.0)  # waits before a process that ends at once is started again [s]
STEADY = 30.0  # one that lived so long starts the waits anew [s]
CLOSE_GRACE = 2.0  # [s]

log = logging.getLogger(__name__)


class KeptProcess:
    """Keeps a command running, tied to this process, its output in a file."""

    def __init__(self, name: str, command: list[str], output: Path) -> None:
        """Prepare to keep `command` running under `name` in the log."""
        self._name, self._command, self._output = name, command, output
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._keep, name=name)
        self.pid: int | None = None

    def start(self) -> None:
        """Start the process."""
        self._thread.start()

    def close(self) -> None:
        """End the process and wait for its end."""
        self._closing.set()
        self._thread.join()

    def _keep(self) -> None:
        failures = 0
        while not self._closing.is_set():
            began = time.monotonic()
            with self._output.open("wb") as sink:
                process = subprocess.Popen([sys.executable, "-m", "service.tether", str(os.getpid()), *self._command],
                                           stdin=subprocess.DEVNULL, stdout=sink, stderr=sink, start_new_session=True)
            self.pid = process.pid
            while process.poll() is None and not self._closing.wait(0.1):
                pass
            self.pid = None
            if self._closing.is_set():
                end(process)
                return
            failures = 0 if time.monotonic() - began > STEADY else failures + 1
            wait = PATIENCE[min(failures, len(PATIENCE) - 1)]
            log.warning("the %s ended with code %s (see %s); starting it again in %g s", self._name,
                        process.returncode, self._output, wait)
            self._closing.wait(wait)


def end(process: subprocess.Popen) -> None:
    """Ask a process to end, and end it if it has not after CLOSE_GRACE."""
    process.terminate()
    try:
        process.wait(CLOSE_GRACE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
