"""Server-sent events: what the store recorded, replayed from any point and then followed."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable

from starlette.concurrency import run_in_threadpool

from service.lifecycle import JobState
from service.store import Event, Store, timestamp

POLL = 0.15  # [s]
HEARTBEAT = 15.0  # a comment this often keeps proxies from closing a quiet stream [s]


async def stream(store: Store, after: int, job: str | None, stopping: Callable[[], bool]) -> AsyncIterator[str]:
    """Yield the events after the event `after`, of one job until it ends, or of all jobs while the service runs."""
    quiet = 0.0
    yield "retry: 1000\n\n"
    while not stopping():
        events = await run_in_threadpool(store.events, after, job)
        for event in events:
            after = event.id
            yield encode(event)
        if job is not None and events and ends(events[-1]):
            return
        quiet = 0.0 if events else quiet + POLL
        if quiet >= HEARTBEAT:
            quiet = 0.0
            yield ": still here\n\n"
        await asyncio.sleep(POLL)


def ends(event: Event) -> bool:
    """Return whether a job's events end with this one."""
    return event.kind == "state" and JobState(event.data["state"]).final


def encode(event: Event) -> str:
    """Return an event as it goes over the wire; its data always names job and time."""
    data = {"at": timestamp(event.time), **event.data, "job": event.job}
    return f"id: {event.id}\nevent: {event.kind}\ndata: {json.dumps(data)}\n\n"
