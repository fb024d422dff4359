"""What a measurement was made on."""

import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def describe_machine(threads: int) -> dict:
    """Return processor, threads in use and versions, as reports and benchmarks state them."""
    return {"cpu": processor(), "threads": threads, "versions": versions()}


def processor() -> str:
    """Return the name of the processor."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:  # not Linux
        pass
    return platform.processor() or platform.machine()


def versions() -> dict[str, str]:
    """Return the versions of what results depend on; packages that are not installed are left out."""
    found = {"python": platform.python_version()}
    for package in ("strandline", "numpy", "numba", "scipy", "h5py"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found
