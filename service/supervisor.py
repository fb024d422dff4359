"""Runs queued jobs, each in its own process, and notices when a job or a service died.

Only killing its process stops a running kernel, and a process forked from one that used numba's threads is not
safe: so every attempt at a job is a fresh `exec`, started from the supervisor's one long-lived thread (`tether`).
"""

import logging
import os
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from service.lifecycle import JobEvent
from service.store import Job, LeaseLost, Store

LEASE = 3.0  # a job whose service was killed waits this long before another takes it [s]
RENEWAL = 0.5  # leases are renewed this often [s]
POLL = 0.05  # the queue and the children are looked at this often [s]
CANCEL_GRACE = 0.5  # a cancelled worker may write its checkpoint this long before it is killed [s]
CLOSE_GRACE = 15.0  # the same when the service closes: that checkpoint will be needed [s]

EXIT_SUCCEEDED = 0
EXIT_FAILED = 3  # the simulation gave up: another attempt would meet the same
EXIT_STOPPED = 75  # stopped as asked, with a checkpoint

WORKER = (sys.executable, "-P", "-m", "service.worker")  # -P: a module of the working directory must not get in

log = logging.getLogger(__name__)


@dataclass
class Attempt:
    """One running worker."""

    job: Job
    process: subprocess.Popen
    kill_at: float | None = None  # asked to stop; killed at this time [monotonic s]


class Supervisor:
    """Keeps up to `workers` jobs of a store running, in a thread of its own."""

    def __init__(self, store: Store, workers: int = 1, threads: int | None = None,
                 command: tuple[str, ...] = WORKER) -> None:
        """Prepare; `threads` is what each worker may use, by default its share of the processors."""
        self._store = store
        self._workers = workers
        self._threads = threads or max(1, (os.cpu_count() or 1) // workers)
        self._command = command
        self._attempts: dict[str, Attempt] = {}
        self._closing = threading.Event()
        self._renew_at = 0.0
        self._thread = threading.Thread(target=self._run, name="supervisor")

    def start(self) -> None:
        """Begin to run jobs."""
        self._thread.start()

    def close(self) -> None:
        """Stop every worker at a checkpoint, give the jobs back to the queue, and return when that is done."""
        self._closing.set()
        self._thread.join()

    @property
    def alive(self) -> bool:
        """Whether jobs are being looked after."""
        return self._thread.is_alive() and not self._closing.is_set()

    def running(self) -> dict[str, int]:
        """Return the process ids of the workers, by job."""
        return {job: attempt.process.pid for job, attempt in list(self._attempts.items())}

    def _run(self) -> None:
        while not (self._closing.is_set() and not self._attempts):
            try:
                self._tick()
            except sqlite3.OperationalError:
                log.exception("the job store cannot be used for now")  # disk full or locked: workers go on meanwhile
            time.sleep(POLL)

    def _tick(self) -> None:
        for attempt in list(self._attempts.values()):
            if attempt.process.poll() is not None:
                self._settle(attempt)
        self._renew()
        for attempt in list(self._attempts.values()):
            self._stop_if_asked(attempt)
        if not self._closing.is_set():
            while len(self._attempts) < self._workers and (job := self._store.claim(LEASE)) is not None:
                self._attempts[job.id] = Attempt(job, self._spawn(job))

    def _spawn(self, job: Job) -> subprocess.Popen:
        # its own session: Ctrl-C in the terminal is for the service, which then stops its workers in good order
        errors = self._errors(job.id)
        with errors.open("wb") as sink:
            return subprocess.Popen(
                [*self._command, "--data", str(self._store.data), "--job", job.id, "--fence", str(job.fence),
                 "--threads", str(self._threads), "--parent", str(os.getpid())],
                stdin=subprocess.DEVNULL, stdout=sink, stderr=sink, start_new_session=True)

    def _renew(self) -> None:
        """Hold the leases of what runs here, and take over what nobody holds any more."""
        if time.monotonic() < self._renew_at:
            return
        self._renew_at = time.monotonic() + RENEWAL
        for attempt in list(self._attempts.values()):
            try:
                self._store.renew(attempt.job.id, attempt.job.fence, LEASE)
            except LeaseLost:
                self._abandon(attempt)
        for job in self._store.expire():
            log.warning("job %s: %s, now %s", job.id, "its service was killed", job.state)

    def _stop_if_asked(self, attempt: Attempt) -> None:
        if attempt.kill_at is None:
            job = self._store.get(attempt.job.id)
            cancelled = job is not None and job.life.cancel_requested
            if cancelled or self._closing.is_set():
                attempt.kill_at = time.monotonic() + (CANCEL_GRACE if cancelled else CLOSE_GRACE)
                attempt.process.send_signal(signal.SIGTERM)
        elif time.monotonic() > attempt.kill_at:
            attempt.process.kill()

    def _settle(self, attempt: Attempt) -> None:
        """Record how a worker ended."""
        del self._attempts[attempt.job.id]
        event, reason = self._verdict(attempt)
        try:
            job = self._store.settle(attempt.job.id, attempt.job.fence, event, reason)
        except LeaseLost:
            log.warning("job %s was taken over by another service", attempt.job.id)
        else:
            log.info("job %s: %s%s", job.id, job.state, f" ({reason})" if reason else "")

    def _verdict(self, attempt: Attempt) -> tuple[JobEvent, str | None]:
        code = attempt.process.returncode
        if code == EXIT_SUCCEEDED:
            return JobEvent.SUCCEED, None
        if code == EXIT_FAILED:
            return JobEvent.FAIL, self._last_words(attempt.job.id)
        if code == EXIT_STOPPED or attempt.kill_at is not None:
            return JobEvent.RELEASE, None
        if code < 0:
            return JobEvent.LOSE, f"its process was killed by signal {-code} ({signal.Signals(-code).name})"
        return JobEvent.LOSE, f"its process broke off with code {code}: {self._last_words(attempt.job.id)}"

    def _abandon(self, attempt: Attempt) -> None:
        log.warning("job %s was lost to another service: its process here ends", attempt.job.id)
        attempt.process.kill()
        attempt.process.wait()
        del self._attempts[attempt.job.id]

    def _errors(self, job: str) -> Path:
        return self._store.private / f"{job}.err"

    def _last_words(self, job: str) -> str:
        """Return the last line that a worker wrote, for the reason of its end."""
        with self._errors(job).open("rb") as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - 2000))
            lines = file.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else "no message"
