"""The pages for people: jobs with live progress, one job with its report, and the API's reference."""

import json
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, Response
from fastapi.templating import Jinja2Templates

from engine.scene.load import shipped_scenes
from service import artefacts, wording
from service.api import job_of, service_of
from service.problems import ProblemError
from service.security import is_loopback
from service.store import Job

TEMPLATES = Path(__file__).parent / "templates"
ASSETS = {"strandline.css": "text/css", "strandline.js": "text/javascript", "favicon.svg": "image/svg+xml"}
SHOWN_JOBS = 50
SHOWN_LINES = 100  # of a log

router = APIRouter(include_in_schema=False)
templates = Jinja2Templates(directory=TEMPLATES)
for name in ("label", "duration", "size", "number", "quantity", "clock", "extent"):
    templates.env.filters[name] = getattr(wording, name)


@router.get("/")
def jobs_page(request: Request, before: int | None = None) -> Response:
    """Show the newest jobs, and the form for another."""
    service = service_of(request)
    jobs = service.store.newest(before=before, limit=SHOWN_JOBS)
    return templates.TemplateResponse(request, "jobs.html", {
        "jobs": [_shown(request, job) for job in jobs], "census": service.store.census(), "scenes": _shipped(),
        "older": jobs[-1].number if len(jobs) == SHOWN_JOBS else None, "last_event": service.store.last_event()})


@router.get("/census")
def census(request: Request) -> dict[str, int]:
    """Count the jobs by state."""
    return service_of(request).store.census()


@router.get("/jobs/{job}")
def job_page(request: Request, job: str) -> Response:
    """Show one job: its progress, and once it ended its report and files."""
    found = job_of(request, job)
    service = service_of(request)
    directory = service.store.directory(job)
    path = artefacts.find(directory, "report.json") if found.state.final else None
    files = artefacts.listing(directory)
    return templates.TemplateResponse(request, "job.html", {
        "job": _shown(request, found), "report": None if path is None else json.loads(path.read_bytes()),
        "files": [entry for entry in files if not entry["name"].startswith("frames/")],
        "frames": [entry for entry in files if entry["name"].startswith("frames/")],
        "log": [event.data for event in service.store.newest_events(job, "log", SHOWN_LINES)],
        "last_event": service.store.last_event()})


@router.get("/jobs/{job}/card")
def card(request: Request, job: str) -> Response:
    """Send the piece of the page that shows a job, for pages that follow it."""
    return templates.TemplateResponse(request, "card.html", {"job": _shown(request, job_of(request, job))})


@router.get("/docs")
def reference(request: Request) -> Response:
    """Show the API as OpenAPI describes it."""
    document = request.app.openapi()
    groups: dict[str, list[dict[str, Any]]] = {}
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            shown = {"method": method.upper(), "path": path, **operation}
            groups.setdefault(operation["tags"][0], []).append(shown)
    return templates.TemplateResponse(request, "docs.html", {"api": document, "groups": groups})


@router.get("/assets/{name}")
def asset(name: str) -> Response:
    """Send a style sheet, script or picture of the pages."""
    if name not in ASSETS:
        raise ProblemError(404, f"There is no {name!r}.", allowed=", ".join(ASSETS))
    return FileResponse(TEMPLATES / name, media_type=ASSETS[name], headers={"Cache-Control": "no-cache"})


def _shown(request: Request, job: Job) -> dict[str, Any]:
    """Return a job with the addresses of what belongs to it, as the templates need it."""
    service = service_of(request)
    shown: dict[str, Any] = {**job.public(), "final": job.state.final, "fraction": _fraction(job)}
    host = request.url.hostname or ""
    if job.started and service.viewer_port is not None and is_loopback(host):  # the viewer listens on this machine only
        name = f"[{host}]" if ":" in host else host
        shown["viewer"] = f"http://{name}:{service.viewer_port}/?{urlencode({'job': job.id})}"
    directory = service.store.directory(job.id)
    shown["has_report"] = job.state.final and artefacts.find(directory, "report.json") is not None
    if artefacts.find(directory, "recording.rrd") is not None:
        recording = str(request.base_url) + f"v1/jobs/{job.id}/files/recording.rrd"
        shown["recording"] = "/recording/index.html?" + urlencode(
            {"url": recording, "renderer": "webgl", "hide_welcome_screen": "1", "persist": "false"})
    return shown


def _fraction(job: Job) -> float:
    """Return how much of the simulated time is done."""
    if job.state == "succeeded":
        return 1.0
    if not job.progress or not job.progress.get("until"):
        return 0.0
    return job.progress["time"] / job.progress["until"]


def _shipped() -> list[str]:
    """Return the shipped scenes, the quick start first."""
    return sorted(shipped_scenes(), key=lambda name: (name != "quickstart", name))
