"""Who may talk to the service: checks on every request, before its body is read.

On this machine's own address there is no password, so a web page elsewhere must not be able to use the browser as
its messenger: the Host header must name this machine (DNS rebinding), and a request that changes something must not
come from another origin. On any other address every request needs the token.
"""

import hashlib
import hmac
import ipaddress
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from engine.scene.document import SIZE_LIMIT
from service.problems import ProblemError, problem

COOKIE = "strandline-token"
OPEN_PATHS = ("/healthz", "/readyz")
TOO_LARGE = "The request is too large."  # parsing would take about 20 times its size in memory
ALLOWED_SIZE = f"at most {SIZE_LIMIT:,} bytes"
PAGE_POLICY = ("default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
               "form-action 'self'; base-uri 'none'; frame-ancestors 'none'")
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")


def is_loopback(host: str) -> bool:
    """Return whether `host` can be reached from this machine only."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class Guard:
    """ASGI middleware that turns away what must not get in."""

    def __init__(self, app: ASGIApp, token: str | None = None) -> None:
        """Guard `app`; with a `token`, any Host will do and the token is required."""
        self._app = app
        self._token = None if token is None else _digest(token)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer it with the reason why not."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        refusal = self._refusal(scope, headers)
        if refusal is not None:
            await refusal(scope, receive, send)
            return

        async def send_with_policy(message: Message) -> None:
            if message["type"] == "http.response.start":
                answer = MutableHeaders(scope=message)
                answer.setdefault("Content-Security-Policy", PAGE_POLICY)
                answer["X-Content-Type-Options"] = "nosniff"
                answer["Referrer-Policy"] = "same-origin"
            await send(message)

        await self._app(scope, _Limited(receive), send_with_policy)

    def _refusal(self, scope: Scope, headers: Headers) -> Response | None:
        """Return the answer to a request that must not get in, None for one that may."""
        host = headers.get("host", "")
        if self._token is None and not is_loopback(_name(host)):
            return problem(421, f"This service does not answer for the host {host!r}.",
                           allowed="127.0.0.1, localhost or [::1]")
        origin = headers.get("origin")
        if scope["method"] not in SAFE_METHODS and origin is not None and urlsplit(origin).netloc != host:
            return problem(403, f"A page from {origin} may not change anything here.")
        if self._token is not None and scope["path"] not in OPEN_PATHS:
            offered = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
            if offered and scope["path"] == "/" and self._known(offered):  # the link that `serve` prints
                answer = RedirectResponse("/", 303)
                answer.set_cookie(COOKIE, offered, httponly=True, samesite="strict")
                return answer
            bearer = headers.get("authorization", "").removeprefix("Bearer ")
            if not (self._known(bearer) or self._known(cookie_parser(headers.get("cookie", "")).get(COOKIE, ""))):
                return problem(401, "This service needs its token, as 'Authorization: Bearer TOKEN'.",
                               {"WWW-Authenticate": "Bearer"})
        length = headers.get("content-length", "0")
        if not length.isdigit() or int(length) > SIZE_LIMIT:
            return problem(413, TOO_LARGE, allowed=ALLOWED_SIZE)
        return None

    def _known(self, token: str) -> bool:
        return self._token is not None and hmac.compare_digest(_digest(token), self._token)


class _Limited:
    """Receives a body without announced length (chunked) only up to the limit."""

    def __init__(self, receive: Receive) -> None:
        self._receive = receive
        self._seen = 0

    async def __call__(self) -> Message:
        message = await self._receive()
        self._seen += len(message.get("body", b""))
        if self._seen > SIZE_LIMIT:
            raise ProblemError(413, TOO_LARGE, allowed=ALLOWED_SIZE)
        return message


def _digest(token: str) -> bytes:
    return hashlib.sha256(token.encode()).digest()


def _name(host: str) -> str:
    """Return the name in a Host header, without port and brackets."""
    try:
        return urlsplit("//" + host).hostname or ""
    except ValueError:
        return ""
