"""The REST API, `/v1` and the health checks."""

import hashlib
import json
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request
from fastapi.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from engine.scene.load import load_scene, scene_schema, shipped_scenes
from engine.scene.size import estimate
from service import artefacts
from service.events import stream
from service.lifecycle import JobState
from service.metrics import exposition
from service.problems import ProblemError
from service.server import Service
from service.store import Job, SubmissionConflict

router = APIRouter(prefix="/v1")
health = APIRouter(tags=["health"])

SCENE_BODY = {"requestBody": {"required": True, "content": {"application/json": {
    "schema": {"type": "object", "description": "A scene, as GET /v1/schema describes it."}}}}}
EventNumber = Annotated[int, Field(ge=0, le=2**62)]
ANY_PROBLEM: dict[int | str, dict[str, Any]] = {"4XX": {
    "description": "What is wrong, as RFC 9457 problem details.", "content": {"application/problem+json": {}}}}


def service_of(request: Request) -> Service:
    """Return the service that the application belongs to."""
    return request.app.state.service


def job_of(request: Request, job: str) -> Job:
    """Return a job by its id; raises the problem 404."""
    found = service_of(request).store.get(job)
    if found is None:
        raise ProblemError(404, f"There is no job {job!r}.")
    return found


def links(job: Job) -> dict[str, Any]:
    """Return a job as the API shows it, with the addresses of what belongs to it."""
    base = f"/v1/jobs/{job.id}"
    return {**job.public(), "links": {"self": base, "events": f"{base}/events", "report": f"{base}/report",
                                      "files": f"{base}/files", "cancel": f"{base}/cancel", "page": f"/jobs/{job.id}"}}


@router.post("/jobs", status_code=201, openapi_extra=SCENE_BODY, responses=ANY_PROBLEM, tags=["jobs"])
async def submit(
    request: Request, response: Response,
    idempotency_key: Annotated[str | None, Header(min_length=1, max_length=200)] = None,
) -> dict[str, Any]:
    """Check a scene, estimate its size, and queue it.

    With an Idempotency-Key that came with the same body before, the answer is 200 with the job of that time; with
    another body it is 409.
    """
    body = await request.body()
    job, new = await run_in_threadpool(_submit, service_of(request), body, idempotency_key)
    response.status_code = 201 if new else 200
    response.headers["Location"] = f"/v1/jobs/{job.id}"
    return links(job)


def _submit(service: Service, body: bytes, key: str | None) -> tuple[Job, bool]:
    scene = load_scene(body)
    size = {name: int(value) for name, value in vars(estimate(scene)).items()}
    try:
        return service.store.submit(scene.name, scene.model_dump_json(indent=2), size, key=key,
                                    digest=hashlib.sha256(body).hexdigest())
    except SubmissionConflict:
        raise ProblemError(409, f"The idempotency key {key!r} was used before, with another scene.") from None


@router.get("/jobs", responses=ANY_PROBLEM, tags=["jobs"])
def jobs(
    request: Request, state: JobState | None = None, cursor: Annotated[int | None, Query(ge=1)] = None,
    limit: Annotated[int, Query(ge=1, le=200)] = 50,
) -> dict[str, Any]:
    """List jobs, newest first; `next` is the cursor of the following page."""
    found = service_of(request).store.newest(state, cursor, limit + 1)
    page = found[:limit]
    return {"jobs": [links(job) for job in page], "next": page[-1].number if len(found) > limit else None}


@router.get("/jobs/{job}", responses=ANY_PROBLEM, tags=["jobs"])
def show(request: Request, job: str) -> dict[str, Any]:
    """Show one job."""
    return links(job_of(request, job))


@router.post("/jobs/{job}/cancel", responses=ANY_PROBLEM, tags=["jobs"])
def cancel(request: Request, job: str) -> dict[str, Any]:
    """Ask for a job's end. A running job stops within a second; one that has ended stays as it is."""
    job_of(request, job)
    cancelled = service_of(request).store.cancel(job)
    assert cancelled is not None  # jobs are never deleted
    return links(cancelled)


@router.get("/jobs/{job}/events", responses=ANY_PROBLEM, tags=["jobs"])
def follow(request: Request, job: str, after: EventNumber = 0,
           last_event_id: Annotated[EventNumber | None, Header()] = None) -> Response:
    """Follow one job as server-sent events (state, progress, log) from `after` or `Last-Event-ID` on, to its end.

    Where nothing will follow any more the answer is 204, which tells browsers not to come back.
    """
    found = job_of(request, job)
    service = service_of(request)
    seen = after if last_event_id is None else last_event_id
    if found.state.final and service.store.last_event(job) <= seen:
        return Response(status_code=204)
    return _event_stream(service, seen, job)


@router.get("/events", tags=["jobs"])
def follow_all(request: Request, after: EventNumber | None = None,
               last_event_id: Annotated[EventNumber | None, Header()] = None) -> Response:
    """Follow all jobs as server-sent events, from `after` or `Last-Event-ID` on, by default from now."""
    service = service_of(request)
    seen = after if last_event_id is None else last_event_id
    return _event_stream(service, service.store.last_event() if seen is None else seen, None)


def _event_stream(service: Service, after: int, job: str | None) -> StreamingResponse:
    return StreamingResponse(stream(service.store, after, job, service.stopping.is_set), media_type="text/event-stream",
                             headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"})


@router.get("/jobs/{job}/report", responses=ANY_PROBLEM, tags=["results"])
def report(request: Request, job: str) -> dict[str, Any]:
    """Return the report of a job that has ended: counts, speed and error."""
    found = job_of(request, job)
    path = artefacts.find(service_of(request).store.directory(job), "report.json")
    if path is None or not found.state.final:
        raise ProblemError(404, f"The job {job} is {found.state} and has no report.")
    return json.loads(path.read_bytes())


@router.get("/jobs/{job}/files", responses=ANY_PROBLEM, tags=["results"])
def files(request: Request, job: str) -> dict[str, Any]:
    """List the files of a job."""
    job_of(request, job)
    return {"files": artefacts.listing(service_of(request).store.directory(job))}


@router.head("/jobs/{job}/files/{name:path}", include_in_schema=False)
@router.get("/jobs/{job}/files/{name:path}", responses=ANY_PROBLEM, tags=["results"])
def file(request: Request, job: str, name: str) -> Response:
    """Send one file, whole or in a range."""
    job_of(request, job)
    path = artefacts.find(service_of(request).store.directory(job), name)
    if path is None:
        raise ProblemError(404, f"The job {job} has no file {name!r}.")
    return artefacts.answer(request, path)


@router.get("/scenes", tags=["scenes"])
def scenes() -> dict[str, Any]:
    """List the scenes that ship with Strandline."""
    return {"scenes": sorted(shipped_scenes())}


@router.get("/scenes/{name}", responses=ANY_PROBLEM, tags=["scenes"])
def scene(name: str) -> Response:
    """Return one shipped scene, ready to be submitted."""
    shipped = shipped_scenes()
    if name not in shipped:
        raise ProblemError(404, f"There is no scene {name!r}.", allowed=", ".join(sorted(shipped)))
    return Response(shipped[name].read_bytes(), media_type="application/json")


@router.get("/schema", tags=["scenes"])
def schema() -> JSONResponse:
    """Return the JSON Schema of a scene."""
    return JSONResponse(scene_schema(), media_type="application/schema+json")


@health.get("/healthz")
def healthz() -> dict[str, str]:
    """Tell that the service answers."""
    return {"status": "ok"}


@health.get("/readyz", responses=ANY_PROBLEM)
def readyz(request: Request) -> dict[str, str]:
    """Tell whether jobs that are submitted now will be run."""
    service = service_of(request)
    if not service.supervisor.alive or service.stopping.is_set():
        raise ProblemError(503, "The service is closing and takes no jobs.")
    service.store.last_event()
    return {"status": "ready"}


@health.get("/metrics", response_class=PlainTextResponse)
def metrics(request: Request) -> PlainTextResponse:
    """Return counts of jobs and resources, as Prometheus reads them."""
    return PlainTextResponse(exposition(service_of(request)), media_type="text/plain; version=0.0.4")
