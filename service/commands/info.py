"""The commands that only tell: `schema`, `scenes`, `doctor`."""

import importlib.metadata
import json
import os
import platform
import shutil
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from service.terminal import DEFAULT_DATA, EXIT_INVALID, fail, out
from service.wording import duration, extent, label, number, size

PACKAGES = ("numpy", "numba", "llvmlite", "scipy", "h5py", "pydantic", "fastapi", "uvicorn", "viser", "rerun-sdk")
PORTS = (8765, 8766)

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def schema() -> None:
    """Print the JSON Schema of a scene."""
    from engine.scene.load import scene_schema

    print(json.dumps(scene_schema(), indent=2))


def scenes(
    name: Annotated[str | None, typer.Argument(help="Print this scene's JSON, to start your own from.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the scenes that ship with Strandline, or print one."""
    from engine.scene.load import load_scene, shipped_scenes
    from engine.scene.size import estimate

    shipped = shipped_scenes()
    if name is not None:
        if name not in shipped:
            fail(f"{name}: no such scene (allowed: {', '.join(sorted(shipped))})", EXIT_INVALID)
        print(shipped[name].read_text(), end="")
        return
    rows = {key: load_scene(path) for key, path in sorted(shipped.items())}
    if as_json:
        out.print_json(json.dumps({key: {"duration": scene.duration, **vars(estimate(scene))}
                                   for key, scene in rows.items()}))
        return
    table = Table(box=None, pad_edge=False, collapse_padding=True)
    for column in ("scene", "size", "simulated", "steps", "frames"):
        table.add_column(column, justify="left" if column == "scene" else "right", no_wrap=True)
    for key, scene in rows.items():
        guess = estimate(scene)
        table.add_row(key, extent(vars(guess)), duration(scene.duration), number(guess.steps), number(guess.frames))
    out.print(table)


def doctor(data: Annotated[Path, typer.Option(help="Directory of all jobs.")] = DEFAULT_DATA,
           as_json: AsJson = False) -> None:
    """Show what this machine offers: versions, threads, caches, ports, disk."""
    findings = _findings(data)
    if as_json:
        out.print_json(json.dumps(findings))
        return
    table = Table(box=None, show_header=False)
    table.add_column(style="dim")
    table.add_column()
    for section, entries in findings.items():
        table.add_row(f"[bold]{section}", "")
        for key, value in entries.items():
            table.add_row(f"  {label(key.removesuffix('_bytes'))}", _shown(key, value))
    out.print(table)


def _shown(key: str, value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return size(value) if key.endswith("bytes") else escape(str(value))


def _findings(data: Path) -> dict[str, dict[str, Any]]:
    import psutil

    from engine.run.compile_cache import ENGINE, cache_parent, source_hash
    from service.server import CannotServe, free_port

    def version(package: str) -> str:
        try:
            return importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            return "missing"

    def is_free(port: int) -> bool:
        try:
            free_port(port)
        except CannotServe:
            return False
        return True

    cache = cache_parent() / source_hash(ENGINE)
    existing = next(path for path in (data.absolute(), *data.absolute().parents) if path.exists())
    return {
        "versions": {"strandline": version("strandline"), "python": platform.python_version(),
                     **{package: version(package) for package in PACKAGES}},
        "machine": {"system": platform.platform(), "processors": os.cpu_count(),
                    "threads_per_run": len(os.sched_getaffinity(0)), "memory_bytes": psutil.virtual_memory().total,
                    "memory_free_bytes": psutil.virtual_memory().available},
        "compiled kernels": {"directory": str(cache), "present": cache.exists(), "size_bytes": _size_of(cache),
                             "all_versions_bytes": _size_of(cache_parent())},
        "ports free": {str(port): is_free(port) for port in PORTS},
        "disk": {"data": str(data), "free_bytes": shutil.disk_usage(existing).free},
    }


def _size_of(directory: Path) -> int:
    return sum(path.stat().st_size for path in directory.rglob("*") if path.is_file())
