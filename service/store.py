"""The jobs of a data directory in SQLite: a queue with leases, and the events that clients follow.

Every change of a job's state is one transaction that reads the job, applies `lifecycle.transition`, and writes the
result with an event, so that any number of threads and processes may share a store. A claim carries a *fence*: a
number that grows with each claim and that the holder shows with every write. Who lost the job has an old one.
"""

import json
import secrets
import shutil
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from engine.run.files import write_whole
from service.lifecycle import JobEvent, JobState, Life, transition

SERVICE_DIRECTORY = ".strandline"  # inside the data directory, beside the jobs' own directories
KEPT_EVENTS = 500  # of progress and of log, per job; a client that was away longer sees fewer, and the same end

SCHEMA = """
CREATE TABLE IF NOT EXISTS jobs (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    id TEXT NOT NULL UNIQUE,
    scene TEXT NOT NULL,
    size TEXT NOT NULL,
    state TEXT NOT NULL,
    attempts INTEGER NOT NULL,
    max_attempts INTEGER NOT NULL,
    cancel_requested INTEGER NOT NULL,
    fence INTEGER NOT NULL,
    lease_until REAL NOT NULL,
    created REAL NOT NULL,
    started REAL,
    finished REAL,
    reason TEXT,
    progress TEXT
);
CREATE INDEX IF NOT EXISTS jobs_by_state ON jobs (state, number);
CREATE TABLE IF NOT EXISTS events (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    job TEXT NOT NULL,
    kind TEXT NOT NULL,
    time REAL NOT NULL,
    data TEXT NOT NULL
);
CREATE INDEX IF NOT EXISTS events_by_job ON events (job, id);
CREATE TABLE IF NOT EXISTS submissions (
    key TEXT PRIMARY KEY,
    digest TEXT NOT NULL,
    job TEXT NOT NULL
);
"""


@dataclass(frozen=True)
class Job:
    """One job as the store knows it; times are seconds since 1970, UTC."""

    number: int  # order of submission
    id: str
    scene: str  # name of the scene
    size: dict[str, int]  # estimate made before it was accepted: `engine.scene.size.SizeEstimate`
    life: Life
    fence: int
    lease_until: float
    created: float
    started: float | None
    finished: float | None
    reason: str | None  # why it failed, or why it waits again
    progress: dict[str, Any] | None  # the last progress event

    @property
    def state(self) -> JobState:
        """Where the job is."""
        return self.life.state

    def public(self) -> dict[str, Any]:
        """Return what clients and `job.json` show, ready for JSON."""
        shown = {"id": self.id, "scene": self.scene, "state": str(self.state), "attempts": self.life.attempts,
                 "max_attempts": self.life.max_attempts, "cancel_requested": self.life.cancel_requested,
                 "size": self.size, "created": timestamp(self.created), "started": timestamp(self.started),
                 "finished": timestamp(self.finished), "reason": self.reason, "progress": self.progress}
        return {key: value for key, value in shown.items() if value is not None}


@dataclass(frozen=True)
class Event:
    """One thing that happened to a job: kind is "state", "progress" or "log"."""

    id: int
    job: str
    kind: str
    time: float
    data: dict[str, Any]


class SubmissionConflict(Exception):
    """The idempotency key was used before, with another scene."""


class LeaseLost(Exception):
    """The job is no longer held with this fence: another supervisor has it, or it ended."""


class Store:
    """The jobs in one data directory. Safe to share between threads; processes open their own."""

    def __init__(self, data: Path) -> None:
        """Open the store of the directory `data`, made where it does not exist."""
        self.data = data
        self.private = data / SERVICE_DIRECTORY
        self.private.mkdir(parents=True, exist_ok=True)
        self._local = threading.local()
        with self._transaction() as connection:
            for statement in SCHEMA.split(";"):
                connection.execute(statement)

    def directory(self, job: str) -> Path:
        """Return the directory of the job `job`."""
        return self.data / job

    # submission

    def submit(
        self, scene: str, document: str, size: dict[str, int], *, key: str | None = None, digest: str = "",
        max_attempts: int = 3,
    ) -> tuple[Job, bool]:
        """Queue a scene: its name, its JSON as accepted, and the estimate of its size.

        With an idempotency `key` that was used before with the same `digest` of the request, returns that job
        and False, else the new job and True. Raises `SubmissionConflict` where the digest differs.
        """
        with self._transaction() as connection:
            if key is not None:
                earlier = connection.execute("SELECT digest, job FROM submissions WHERE key = ?", (key,)).fetchone()
                if earlier is not None:
                    if earlier["digest"] != digest:
                        raise SubmissionConflict(key)
                    return self._get(connection, earlier["job"]), False
            now = time.time()
            job = time.strftime("%Y%m%d-%H%M%S-", time.gmtime(now)) + secrets.token_hex(3)
            self._lay_out(job, document)
            life = Life(max_attempts=max_attempts)
            connection.execute(
                "INSERT INTO jobs (id, scene, size, state, attempts, max_attempts, cancel_requested, fence,"
                " lease_until, created) VALUES (?, ?, ?, ?, 0, ?, 0, 0, 0, ?)",
                (job, scene, json.dumps(size), life.state, max_attempts, now),
            )
            if key is not None:
                connection.execute("INSERT INTO submissions VALUES (?, ?, ?)", (key, digest, job))
            queued = self._get(connection, job)
            self._announce(connection, queued)
            return queued, True

    # what clients read

    def get(self, job: str) -> Job | None:
        """Return one job, None where there is no such id."""
        row = self._connection().execute("SELECT * FROM jobs WHERE id = ?", (job,)).fetchone()
        return None if row is None else _job(row)

    def newest(self, state: JobState | None = None, before: int | None = None, limit: int = 50) -> list[Job]:
        """Return the newest jobs first, of one state only if given, numbered below `before`, at most `limit`."""
        rows = self._connection().execute(
            "SELECT * FROM jobs WHERE (:state IS NULL OR state = :state) AND (:before IS NULL OR number < :before)"
            " ORDER BY number DESC LIMIT :limit", {"state": state, "before": before, "limit": limit})
        return [_job(row) for row in rows]

    def census(self) -> dict[str, int]:
        """Return how many jobs are in each state."""
        counted = {row["state"]: row["jobs"] for row in
                   self._connection().execute("SELECT state, count(*) AS jobs FROM jobs GROUP BY state")}
        return {str(state): counted.get(state, 0) for state in JobState}

    def events(self, after: int, job: str | None = None, limit: int = 500) -> list[Event]:
        """Return the events that follow the event `after`, of one job or of all, oldest first."""
        which = "" if job is None else "job = :job AND"
        rows = self._connection().execute(f"SELECT * FROM events WHERE {which} id > :after ORDER BY id LIMIT :limit",
                                          {"after": after, "job": job, "limit": limit})
        return [_event(row) for row in rows]

    def newest_events(self, job: str, kind: str, limit: int) -> list[Event]:
        """Return the newest events of a kind, at most `limit`, oldest first."""
        rows = self._connection().execute(
            "SELECT * FROM events WHERE job = ? AND kind = ? ORDER BY id DESC LIMIT ?", (job, kind, limit)).fetchall()
        return [_event(row) for row in reversed(rows)]

    def last_event(self, job: str | None = None) -> int:
        """Return the id of the newest event of one job or of all, 0 where there is none."""
        which = "" if job is None else "WHERE job = :job"
        newest = self._connection().execute(f"SELECT coalesce(max(id), 0) FROM events {which}", {"job": job})
        return newest.fetchone()[0]

    # what supervisors do

    def claim(self, lease: float) -> Job | None:
        """Take the oldest queued job for `lease` seconds; returns it with its new fence, None if none waits."""
        if not self._connection().execute("SELECT 1 FROM jobs WHERE state = ?", (JobState.QUEUED,)).fetchone():
            return None  # most often so: no need to hold up writers
        with self._transaction() as connection:
            row = connection.execute("SELECT id FROM jobs WHERE state = ? ORDER BY number LIMIT 1",
                                     (JobState.QUEUED,)).fetchone()
            if row is None:
                return None
            now = time.time()
            connection.execute(
                "UPDATE jobs SET fence = fence + 1, lease_until = ?, started = coalesce(started, ?) WHERE id = ?",
                (now + lease, now, row["id"]))
            return self._apply(connection, row["id"], JobEvent.CLAIM)

    def renew(self, job: str, fence: int, lease: float) -> Job:
        """Hold a job for another `lease` seconds; raises `LeaseLost`."""
        with self._transaction() as connection:
            self._held(connection, job, fence)
            connection.execute("UPDATE jobs SET lease_until = ? WHERE id = ?", (time.time() + lease, job))
            return self._get(connection, job)

    def settle(self, job: str, fence: int, event: JobEvent, reason: str | None = None) -> Job:
        """Record how an attempt ended (SUCCEED, FAIL, LOSE or RELEASE); raises `LeaseLost`."""
        with self._transaction() as connection:
            self._held(connection, job, fence)
            return self._apply(connection, job, event, reason)

    def expire(self) -> list[Job]:
        """Take jobs whose lease ran out from supervisors that must be dead; returns them as they are then."""
        with self._transaction() as connection:
            rows = connection.execute("SELECT id FROM jobs WHERE state = ? AND lease_until < ?",
                                      (JobState.RUNNING, time.time())).fetchall()
            return [self._apply(connection, row["id"], JobEvent.LOSE, "the service that ran it was killed")
                    for row in rows]

    def cancel(self, job: str) -> Job | None:
        """Ask for a job's end: a waiting one ends at once, a running one as soon as its worker is stopped."""
        with self._transaction() as connection:
            known = connection.execute("SELECT 1 FROM jobs WHERE id = ?", (job,)).fetchone()
            return None if known is None else self._apply(connection, job, JobEvent.CANCEL)

    # what workers write

    def report_progress(self, job: str, fence: int, progress: dict[str, Any]) -> None:
        """Publish how far a job is; raises `LeaseLost`.

        `progress["frame"]` counts frames; where it passes that of all earlier attempts, the attempts count anew.
        """
        with self._transaction() as connection:
            self._held(connection, job, fence)
            furthest = (self._get(connection, job).progress or {}).get("furthest", 0)
            if progress.get("frame", 0) > furthest:
                self._apply(connection, job, JobEvent.ADVANCE)
            progress = {**progress, "furthest": max(furthest, progress.get("frame", 0))}
            connection.execute("UPDATE jobs SET progress = ? WHERE id = ?", (json.dumps(progress), job))
            self._event(connection, job, "progress", progress)
            self._trim(connection, job, "progress")

    def log(self, job: str, fence: int, lines: list[dict[str, Any]]) -> None:
        """Publish lines of a job's log; raises `LeaseLost`."""
        with self._transaction() as connection:
            self._held(connection, job, fence)
            for line in lines[-KEPT_EVENTS:]:
                self._event(connection, job, "log", line)
            self._trim(connection, job, "log")

    # inside

    def _connection(self) -> sqlite3.Connection:
        """Return this thread's connection."""
        if not hasattr(self._local, "connection"):
            connection = sqlite3.connect(self.private / "jobs.sqlite", timeout=10, isolation_level=None)
            connection.row_factory = sqlite3.Row
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = NORMAL")
            self._local.connection = connection
        return self._local.connection

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        """Hold the write lock from the first read on, so that what was read is still true when it is written."""
        connection = self._connection()
        connection.execute("BEGIN IMMEDIATE")
        try:
            yield connection
        except BaseException:
            connection.execute("ROLLBACK")
            raise
        connection.execute("COMMIT")

    def _get(self, connection: sqlite3.Connection, job: str) -> Job:
        return _job(connection.execute("SELECT * FROM jobs WHERE id = ?", (job,)).fetchone())

    def _held(self, connection: sqlite3.Connection, job: str, fence: int) -> None:
        row = connection.execute("SELECT fence, state FROM jobs WHERE id = ?", (job,)).fetchone()
        if row is None or row["fence"] != fence or row["state"] != JobState.RUNNING:
            raise LeaseLost(job)

    def _apply(self, connection: sqlite3.Connection, job: str, event: JobEvent, reason: str | None = None) -> Job:
        before = self._get(connection, job)
        life = transition(before.life, event)
        if life == before.life:
            return before
        finished = time.time() if life.state.final else None
        connection.execute(
            "UPDATE jobs SET state = ?, attempts = ?, cancel_requested = ?, finished = ?, reason = ? WHERE id = ?",
            (life.state, life.attempts, life.cancel_requested, finished, reason, job))
        after = self._get(connection, job)
        self._announce(connection, after)
        return after

    def _lay_out(self, job: str, document: str) -> None:
        """Make a job's directory with its scene; leaves nothing where that fails, for instance on a full disk."""
        directory = self.directory(job)
        try:
            directory.mkdir()
            write_whole(directory / "scene.json", document.encode())
        except OSError:
            shutil.rmtree(directory, ignore_errors=True)
            raise

    def _announce(self, connection: sqlite3.Connection, job: Job) -> None:
        """Publish a job's new state to clients and, for readers of the directory, in `job.json`.

        While it runs that file is the worker's, who counts the attempt there.
        """
        shown = {key: value for key, value in job.public().items() if key != "progress"}
        self._event(connection, job.id, "state", shown)
        directory = self.directory(job.id)
        if job.state != JobState.RUNNING and directory.is_dir():  # the user may have deleted the files
            write_whole(directory / "job.json", json.dumps({"strandline": 1, **shown}, indent=2).encode() + b"\n")

    def _trim(self, connection: sqlite3.Connection, job: str, kind: str) -> None:
        """Drop the oldest events of a kind beyond the number that is kept."""
        connection.execute(
            "DELETE FROM events WHERE job = :job AND kind = :kind AND id <= (SELECT id FROM events"
            " WHERE job = :job AND kind = :kind ORDER BY id DESC LIMIT 1 OFFSET :kept)",
            {"job": job, "kind": kind, "kept": KEPT_EVENTS})

    def _event(self, connection: sqlite3.Connection, job: str, kind: str, data: dict[str, Any]) -> None:
        connection.execute("INSERT INTO events (job, kind, time, data) VALUES (?, ?, ?, ?)",
                           (job, kind, time.time(), json.dumps(data, allow_nan=False)))


def timestamp(seconds: float | None) -> str | None:
    """Return seconds since 1970 as clients see a time, ISO 8601 in UTC."""
    return None if seconds is None else datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")


def _event(row: sqlite3.Row) -> Event:
    return Event(row["id"], row["job"], row["kind"], row["time"], json.loads(row["data"]))


def _job(row: sqlite3.Row) -> Job:
    life = Life(JobState(row["state"]), row["attempts"], row["max_attempts"], bool(row["cancel_requested"]))
    plain = {name: row[name] for name in ("number", "id", "scene", "fence", "lease_until", "created", "started",
                                          "finished", "reason")}
    progress = None if row["progress"] is None else json.loads(row["progress"])
    return Job(**plain, life=life, size=json.loads(row["size"]), progress=progress)
