"""Errors as RFC 9457 problem details: what is wrong, where, and what is allowed."""

import sqlite3
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from engine.scene.load import SceneError

MEDIA_TYPE = "application/problem+json"


class ProblemError(Exception):
    """A request that cannot be served, with the words for the client."""

    def __init__(self, status: int, detail: str, headers: dict[str, str] | None = None, **members: Any) -> None:
        """Give the HTTP status, a sentence for people, and further members of the problem document."""
        super().__init__(detail)
        self.status, self.detail, self.headers, self.members = status, detail, headers, members


def problem(status: int, detail: str, headers: dict[str, str] | None = None, **members: Any) -> JSONResponse:
    """Return a problem document as a response."""
    document = {"type": "about:blank", "title": HTTPStatus(status).phrase, "status": status, "detail": detail}
    return JSONResponse({**document, **members}, status, headers, MEDIA_TYPE)


def scene_problem(error: SceneError) -> JSONResponse:
    """Return what is wrong with a scene, one entry for each place."""
    problems = [{key: value for key, value in vars(item).items() if value is not None} for item in error.problems]
    return problem(422, "The scene is not valid.", problems=problems)


def install(app: FastAPI) -> None:
    """Have every error of `app` answered with a problem document."""

    @app.exception_handler(ProblemError)
    async def _(request: Request, error: ProblemError) -> JSONResponse:
        return problem(error.status, error.detail, error.headers, **error.members)

    @app.exception_handler(SceneError)
    async def _(request: Request, error: SceneError) -> JSONResponse:
        return scene_problem(error)

    @app.exception_handler(HTTPException)
    async def _(request: Request, error: HTTPException) -> JSONResponse:
        headers = dict(error.headers) if error.headers else None
        detail = {404: f"There is nothing at {request.url.path}.",
                  405: f"{request.method} is not possible here."}.get(error.status_code, str(error.detail))
        return problem(error.status_code, detail, headers)

    @app.exception_handler(RequestValidationError)
    async def _(request: Request, error: RequestValidationError) -> JSONResponse:
        problems = [{"path": ".".join(str(part) for part in item["loc"]), "message": item["msg"]}
                    for item in error.errors()]
        return problem(422, "The request is not valid.", problems=problems)

    @app.exception_handler(sqlite3.OperationalError)
    async def _(request: Request, error: sqlite3.OperationalError) -> JSONResponse:
        return problem(503, f"The job store cannot be used for now: {error}.")

    @app.exception_handler(OSError)
    async def _(request: Request, error: OSError) -> JSONResponse:
        return problem(507, f"A file cannot be read or written: {error.strerror or error}.")

    @app.exception_handler(Exception)
    async def _(request: Request, error: Exception) -> JSONResponse:
        return problem(500, "The service met an error of its own; its log has the details.")
