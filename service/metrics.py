"""What the service measures of itself, in the text format of Prometheus."""

import shutil
from collections.abc import Mapping
from typing import TYPE_CHECKING

import psutil

if TYPE_CHECKING:
    from service.server import Service


def exposition(service: "Service") -> str:
    """Return all metrics of a service."""
    lines: list[str] = []
    census = service.store.census()
    _metric(lines, "strandline_jobs", "Jobs by state.", {f'state="{state}"': n for state, n in census.items()})
    running = service.supervisor.running()
    _metric(lines, "strandline_workers", "Worker processes.", {"": len(running)})
    memory = {f'job="{job}"': size for job, pid in running.items() if (size := _resident(pid)) is not None}
    _metric(lines, "strandline_worker_memory_bytes", "Resident memory of each worker.", memory)
    pace = {f'job="{job}"': job_.progress["s_per_step"] for job in running
            if (job_ := service.store.get(job)) and job_.progress and job_.progress.get("s_per_step")}
    _metric(lines, "strandline_seconds_per_step", "Seconds that a step takes at present.", pace)
    _metric(lines, "strandline_disk_free_bytes", "Free space for results.",
            {"": shutil.disk_usage(service.store.data).free})
    return "\n".join(lines) + "\n"


def _metric(lines: list[str], name: str, help_text: str, values: Mapping[str, float]) -> None:
    lines += [f"# HELP {name} {help_text}", f"# TYPE {name} gauge"]
    lines += [f"{name}{{{labels}}} {value}" if labels else f"{name} {value}" for labels, value in values.items()]


def _resident(pid: int) -> int | None:
    """Return the resident memory of a process, None where it has just ended [bytes]."""
    try:
        return psutil.Process(pid).memory_info().rss
    except psutil.NoSuchProcess:
        return None
