"""The web application: REST API, pages, and the checks in front of both."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI
from starlette.concurrency import run_in_threadpool

from service import api, pages, problems, recordings
from service.security import Guard
from service.server import Service


def create_app(service: Service) -> FastAPI:
    """Return the application that answers for `service`."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        service.start()
        yield
        await run_in_threadpool(service.close)  # here, since the server ends by the signal that ended it

    app = FastAPI(
        lifespan=lifespan, title="Strandline", version="1", docs_url=None, redoc_url=None, openapi_url="/openapi.json",
        description="Simulates yarns, strands and liquids as jobs: submit a scene, follow it, fetch frames, recording, report.")
    app.state.service = service
    app.include_router(api.router)
    app.include_router(api.health)
    app.include_router(pages.router)
    app.include_router(recordings.router)
    problems.install(app)
    app.add_middleware(Guard, token=service.token)
    return app
