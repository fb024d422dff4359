"""Who may reach the page: requests from this host's own pages, with the token where one is set.

viser accepts every Host and Origin, so any web page that its visitor opens could talk to it. The check sits in the
one place that all HTTP and websocket requests pass, the `process_request` hook of the websockets library.
"""

import hmac
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import wraps
from http import HTTPStatus
from http.cookies import SimpleCookie
from typing import Any
from urllib.parse import parse_qs, quote, unquote, urlsplit

import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

COOKIE = "strandline_viewer"
LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})

# The job that the page of the current connection was opened with. Everything that a connection causes runs in the
# context of the task that accepted it, so that this is how its address reaches the code that serves it.
asked_job: ContextVar[str | None] = ContextVar("asked_job", default=None)


@dataclass(frozen=True)
class Gate:
    """The rule for one server."""

    hosts: frozenset[str] | None = LOCAL_NAMES  # names it may be addressed by, without port; None: any, with a token
    token: str | None = None

    def check(self, request: Request) -> Response | Request:
        """Return the request to serve, or the answer to give instead.

        `?job=ID` leads on to `/job/ID`: the page opens its websocket at its own path and so tells which job it is for.
        `?token=T` is kept in a cookie.
        """
        url = urlsplit(request.path)
        query = parse_qs(url.query)
        if self.hosts is not None and _hostname(request.headers.get("Host")) not in self.hosts:
            return _refuse(HTTPStatus.MISDIRECTED_REQUEST, "unknown Host")
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.headers.get("Host"):
            return _refuse(HTTPStatus.FORBIDDEN, "foreign Origin")
        given = query.get("token", [_cookie(request)])[0]
        if self.token is not None and not hmac.compare_digest(given.encode(), self.token.encode()):
            return _refuse(HTTPStatus.FORBIDDEN, "open this page with ?token=...")
        if "job" in query or "token" in query:
            target = f"/job/{quote(query['job'][0], safe='')}" if "job" in query else url.path
            headers = {"Location": target}
            if self.token is not None:
                headers["Set-Cookie"] = f"{COOKIE}={quote(self.token)}; HttpOnly; SameSite=Strict; Path=/"
            return Response(HTTPStatus.FOUND, "Found", Headers(**headers))
        if url.path.startswith("/job/"):
            asked_job.set(unquote(url.path.removeprefix("/job/")))
            return replace(request, path="/")
        return request


@contextmanager
def guarding(gate: Gate) -> Iterator[None]:
    """Put `gate` in front of the websocket server that is started inside this block.

    Raises RuntimeError when none was: the server would then run unguarded.
    """
    serve = websockets.asyncio.server.serve
    guarded = False

    @wraps(serve)
    def serve_guarded(*arguments: Any, process_request: Callable, **options: Any) -> Any:
        nonlocal guarded
        guarded = True

        def check_then_process(connection: Any, request: Request) -> Response | None:
            verdict = gate.check(request)
            return verdict if isinstance(verdict, Response) else process_request(connection, verdict)

        return serve(*arguments, process_request=check_then_process, **options)

    websockets.asyncio.server.serve = serve_guarded  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
    if not guarded:
        raise RuntimeError("the 3D page's server did not pass the gate; refusing to run it unguarded")


def _hostname(netloc: str | None) -> str | None:
    return urlsplit(f"//{netloc}").hostname if netloc else None


def _cookie(request: Request) -> str:
    morsel = SimpleCookie(request.headers.get("Cookie", "")).get(COOKIE)
    return unquote(morsel.value) if morsel else ""


def _refuse(status: HTTPStatus, reason: str) -> Response:
    body = f"{status.value} {reason}\n".encode()
    headers = Headers({"Content-Type": "text/plain", "Content-Length": str(len(body))})
    return Response(status, status.phrase, headers, body)
