"""The files of a job over HTTP: listed, whole, or in ranges, also while the job still writes them."""

import hashlib
import os
import re
from collections.abc import Iterator
from email.utils import formatdate
from pathlib import Path
from typing import Any, BinaryIO

from fastapi import Request
from fastapi.responses import Response, StreamingResponse

from engine.run.files import ASIDE
from service.problems import ProblemError

CHUNK = 256 * 1024
MEDIA_TYPES = {".json": "application/json", ".jsonl": "application/x-ndjson", ".h5": "application/x-hdf5",
               ".rrd": "application/octet-stream"}
_RANGE = re.compile(r"bytes=(\d*)-(\d*)")


def listing(directory: Path) -> list[dict[str, Any]]:
    """Return name, size and time of change of every file of a job, sorted by name."""
    return sorted(_walk(directory, ""), key=lambda entry: entry["name"])


def find(directory: Path, name: str) -> Path | None:
    """Return the file that the listing shows as `name`, None where it shows none.

    Each part of the name must be an entry of its directory: no name leads outside, and no link is followed.
    """
    *parents, last = name.split("/")
    for parent in parents:
        if parent not in {entry.name for entry in _entries(directory) if entry.is_dir(follow_symlinks=False)}:
            return None
        directory = directory / parent
    files = {entry.name for entry in _entries(directory) if entry.is_file(follow_symlinks=False)}
    return directory / last if last in files else None


def answer(request: Request, path: Path) -> Response:
    """Return the file, the range of it that was asked for, or 304 where the client has it already.

    The file is opened once: its length is that of now, however much a running job appends meanwhile.
    """
    file = path.open("rb")
    status = os.fstat(file.fileno())
    size = status.st_size
    identity = f"{status.st_ino}-{status.st_mtime_ns}-{size}"
    headers = {"ETag": f'"{hashlib.sha256(identity.encode()).hexdigest()[:32]}"', "Accept-Ranges": "bytes",
               "Last-Modified": formatdate(status.st_mtime, usegmt=True), "Cache-Control": "no-cache"}
    if headers["ETag"] in request.headers.get("if-none-match", ""):
        file.close()
        return Response(status_code=304, headers=headers)
    start, stop, code = 0, size, 200
    wanted = request.headers.get("range")
    if wanted is not None and request.headers.get("if-range", headers["ETag"]) == headers["ETag"]:
        span = _span(wanted, size)
        if span is None:
            file.close()
            raise ProblemError(416, f"The file has {size} bytes; {wanted!r} is not in it.",
                               {"Content-Range": f"bytes */{size}"})
        (start, stop), code = span, 206
        headers["Content-Range"] = f"bytes {start}-{stop - 1}/{size}"
    headers["Content-Length"] = str(stop - start)
    media_type = MEDIA_TYPES.get(path.suffix, "application/octet-stream")
    if request.method == "HEAD":
        file.close()
        return Response(status_code=code, headers=headers, media_type=media_type)
    return StreamingResponse(_part(file, start, stop), code, headers, media_type)


def _span(wanted: str, size: int) -> tuple[int, int] | None:
    """Return start and end of a single range, None where it cannot be met."""
    match = _RANGE.fullmatch(wanted.strip())
    if match is None or match.groups() == ("", ""):
        return None
    first, last = match.groups()
    if first == "":
        start, stop = max(0, size - int(last)), size
    else:
        start, stop = int(first), min(size, int(last) + 1) if last else size
    return (start, stop) if start < stop else None


def _part(file: BinaryIO, start: int, stop: int) -> Iterator[bytes]:
    with file:
        file.seek(start)
        while start < stop:
            chunk = file.read(min(CHUNK, stop - start))
            if not chunk:
                raise OSError("the file became shorter while it was sent")
            start += len(chunk)
            yield chunk


def _walk(directory: Path, prefix: str) -> Iterator[dict[str, Any]]:
    for entry in _entries(directory):
        if entry.is_dir(follow_symlinks=False):
            yield from _walk(directory / entry.name, f"{prefix}{entry.name}/")
        elif entry.is_file(follow_symlinks=False):
            status = entry.stat()
            yield {"name": prefix + entry.name, "size": status.st_size, "modified": status.st_mtime}


def _entries(directory: Path) -> list[os.DirEntry]:
    """Return what a directory shows, nothing where its user deleted it; files in the making are not shown."""
    try:
        with os.scandir(directory) as entries:
            return [entry for entry in entries if not entry.name.endswith(ASIDE)]
    except FileNotFoundError:
        return []
