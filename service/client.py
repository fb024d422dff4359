"""The REST API as Python calls, for the command line."""

import json
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import httpx

FINAL = ("succeeded", "failed", "cancelled")


class ServiceError(Exception):
    """The service refused, or cannot be reached; `problem` is its problem document where there is one."""

    def __init__(self, message: str, problem: dict[str, Any] | None = None) -> None:
        """Say what is wrong in words for people."""
        super().__init__(message)
        self.problem = problem or {}

    @property
    def scene_invalid(self) -> bool:
        """Whether the scene is what is wrong."""
        return self.problem.get("status") == 422


class Client:
    """A connection to one service."""

    def __init__(self, server: str, token: str | None = None) -> None:
        """Talk to the service at the address `server`, showing `token` where it needs one."""
        self.server = server.rstrip("/")
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        # a proxy of the environment is for addresses elsewhere
        self._http = httpx.Client(base_url=self.server, headers=headers, timeout=30.0, trust_env=False)

    def submit(self, scene: bytes, key: str | None = None) -> dict[str, Any]:
        """Submit a scene; returns its job."""
        headers = {"Content-Type": "application/json"} | ({"Idempotency-Key": key} if key else {})
        return self._json("POST", "/v1/jobs", content=scene, headers=headers)

    def jobs(self, state: str | None = None, limit: int = 50) -> list[dict[str, Any]]:
        """Return the newest jobs, of one state only if given."""
        parameters: dict[str, Any] = {"limit": min(limit, 200)} | ({"state": state} if state else {})
        found: list[dict[str, Any]] = []
        while len(found) < limit:
            page = self._json("GET", "/v1/jobs", params=parameters)
            found += page["jobs"]
            if page["next"] is None:
                break
            parameters["cursor"] = page["next"]
        return found[:limit]

    def job(self, job: str) -> dict[str, Any]:
        """Return one job."""
        return self._json("GET", f"/v1/jobs/{job}")

    def cancel(self, job: str) -> dict[str, Any]:
        """Ask for a job's end."""
        return self._json("POST", f"/v1/jobs/{job}/cancel")

    def report(self, job: str) -> dict[str, Any]:
        """Return the report of a job that ended."""
        return self._json("GET", f"/v1/jobs/{job}/report")

    def files(self, job: str) -> list[dict[str, Any]]:
        """Return names and sizes of a job's files."""
        return self._json("GET", f"/v1/jobs/{job}/files")["files"]

    def events(self, job: str, attempts: int = 10) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yield kind and data of a job's events to its end, through up to `attempts` lost connections in a row."""
        last, failures = "0", 0
        while True:
            try:
                with self._http.stream("GET", f"/v1/jobs/{job}/events", headers={"Last-Event-ID": last},
                                       timeout=httpx.Timeout(30.0, read=60.0)) as answer:
                    _check(answer)
                    for identity, kind, data in _parse(answer.iter_lines()):
                        last, failures = identity, 0
                        yield kind, data
                        if kind == "state" and data["state"] in FINAL:
                            return
                    if answer.status_code == 204:
                        return
            except httpx.TransportError as error:
                failures += 1
                if failures >= attempts:
                    raise self._unreachable(error) from error

    def download(self, job: str, name: str, directory: Path) -> Iterator[int]:
        """Fetch one file into `directory`, yielding the bytes of each piece as it arrives."""
        target = directory / _inside(name)
        target.parent.mkdir(parents=True, exist_ok=True)
        aside = target.with_name(target.name + ".aside")
        try:
            with self._http.stream("GET", f"/v1/jobs/{job}/files/{name}") as answer, aside.open("wb") as file:
                _check(answer)
                for piece in answer.iter_bytes():
                    file.write(piece)
                    yield len(piece)
        except httpx.TransportError as error:
            raise self._unreachable(error) from error
        aside.replace(target)

    def _json(self, method: str, path: str, **request: Any) -> Any:
        try:
            answer = self._http.request(method, path, **request)
        except httpx.TransportError as error:
            raise self._unreachable(error) from error
        _check(answer)
        return answer.json()

    def _unreachable(self, error: Exception) -> ServiceError:
        return ServiceError(f"no service answers at {self.server} ({error}); start one with: strandline serve")


def _check(answer: httpx.Response) -> None:
    if answer.is_success:
        return
    answer.read()
    try:
        problem = answer.json()
        lines = [problem["detail"]]
    except (ValueError, KeyError, TypeError):
        raise ServiceError(f"the service answered {answer.status_code} {answer.reason_phrase}") from None
    for item in problem.get("problems", []):
        allowed = f" (allowed: {item['allowed']})" if item.get("allowed") else ""
        lines.append(f"{item['path'] or 'scene'}: {item['message']}{allowed}")
    raise ServiceError("\n".join(lines), problem)


def _parse(lines: Iterator[str]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield id, kind and data of server-sent events."""
    fields: dict[str, str] = {}
    for line in lines:
        if not line:
            if "data" in fields:
                yield fields.get("id", "0"), fields.get("event", "message"), json.loads(fields["data"])
            fields = {}
        elif not line.startswith(":"):
            name, _, value = line.partition(": ")
            fields[name] = value


def _inside(name: str) -> PurePosixPath:
    """Return the name of a file as a path below a directory; raises ServiceError where it would lead elsewhere."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or not path.parts:
        raise ServiceError(f"the service names a file {name!r}, which is not inside the job")
    return path
