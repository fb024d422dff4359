"""The suite of benchmarks: throughput, share of this machine's bandwidth, scaling, and the ratio to a peer.

A benchmark is registered by `@benchmark` in a module of this package and yields a `Measurement` per case and size, and a
`Note` of what is missing.
Nothing here asserts on seconds.
"""

import importlib
import pkgutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from statistics import median
from time import perf_counter

import engine.bench
from engine.bench.machine import memory_bandwidth
from engine.run.machine import describe_machine
from engine.run.threads import set_threads
from engine.validate.fit import fitted_exponent


class UnknownBenchmark(Exception):
    """A name that is not in the suite."""


@dataclass(frozen=True)
class Standing:
    """How one choice of knobs stands among others for the same problem."""

    on_front: bool  # none is both faster and more accurate
    default: bool  # it is what scenes have where they say nothing


@dataclass(frozen=True)
class Measurement:
    """One case at one size."""

    case: str
    size: float  # items handled in `seconds`
    seconds: float  # median of repeats
    unit: str  # of an item, such as "crossings"
    bytes_moved: float | None = None  # in `seconds`, as far as they must pass between memory and processor
    peer: str | None = None  # who else did the same work in this run
    peer_seconds: float | None = None
    error: float | None = None  # of the result, so that speed is never without it
    standing: Standing | None = None  # where the size is a knob, not that of the problem
    converging: bool = False  # a point on the way to one solution, after iterations (the size) and seconds spent so far
    details: dict[str, float] = field(default_factory=dict)  # iterations, seconds of stages, ...


@dataclass(frozen=True)
class Note:
    """What the rows leave out, such as a peer that is not installed."""

    text: str


Progress = Callable[[str, str], None]
Measure = Callable[[], Iterator[Measurement | Note]]
_benchmarks: dict[str, tuple[str, Measure]] = {}


def benchmark(name: str, *, summary: str) -> Callable[[Measure], Measure]:
    """Register the decorated generator of measurements as the benchmark `name`."""

    def register(measure: Measure) -> Measure:
        if name in _benchmarks:
            raise ValueError(f"two benchmarks are called {name}")
        _benchmarks[name] = (summary, measure)
        return measure

    return register


def benchmarks() -> dict[str, str]:
    """Return the summary of every benchmark by name, after importing the modules that hold them."""
    for module in pkgutil.iter_modules(engine.bench.__path__):
        importlib.import_module(f"{engine.bench.__name__}.{module.name}")
    return {name: summary for name, (summary, _) in _benchmarks.items()}


def median_seconds(action: Callable[[], object], repeats: int = 5) -> float:
    """Return the median wall time [s] of `action` over `repeats` calls, after one that warms up."""
    action()
    samples = []
    for _ in range(repeats):
        began = perf_counter()
        action()
        samples.append(perf_counter() - began)
    return median(samples)


def run(names: Sequence[str] = (), on_progress: Progress | None = None, threads: int | None = None) -> list[dict]:
    """Run the benchmarks `names` (all when empty); each gives one object as `strandline bench --json` prints it.

    `on_progress` is called with a benchmark's name and each case that it finished. Raises UnknownBenchmark before
    anything runs. A benchmark that raises keeps the rows it has and says so in its note.
    """
    known = benchmarks()
    if unknown := [name for name in names if name not in known]:
        raise UnknownBenchmark(f"no benchmark is called {', '.join(unknown)}; there are {', '.join(sorted(known))}")
    used = set_threads(threads)
    bandwidth = memory_bandwidth(used)
    machine = describe_machine(used) | {"bandwidth_bytes_per_s": bandwidth}
    return [_measured(name, machine, on_progress or (lambda benchmark, case: None)) for name in names or known]


def _measured(name: str, machine: dict, tell: Progress) -> dict:
    summary, measure = _benchmarks[name]
    rows: list[dict] = []
    notes: list[str] = []
    try:
        for measurement in measure():
            if isinstance(measurement, Note):
                notes.append(measurement.text)
                continue
            rows.append(_row(measurement, machine["bandwidth_bytes_per_s"]))
            tell(name, f"{measurement.case} {measurement.size:g}")
    except Exception as error:  # one benchmark must not keep the others from being measured
        notes.append(f"ended by {type(error).__name__}: {error}")
    return {"name": name, "machine": machine, "rows": rows, "exponent": _exponent(rows), "note": "; ".join(notes),
            "summary": summary}


def _row(measured: Measurement, bandwidth: float) -> dict:
    rate = None if measured.bytes_moved is None else measured.bytes_moved / measured.seconds
    return {
        "case": measured.case,
        "size": measured.size,
        "seconds": measured.seconds,
        "throughput": measured.size / measured.seconds,
        "unit": f"{measured.unit}/s",
        "bandwidth_share": None if rate is None else rate / bandwidth,
        "peer": measured.peer,
        "peer_seconds": measured.peer_seconds,
        "ratio": None if measured.peer_seconds is None else measured.peer_seconds / measured.seconds,
        "error": measured.error,
        "standing": None if measured.standing is None else asdict(measured.standing),
        "converging": measured.converging,
        "details": dict(measured.details),
    }


def _exponent(rows: list[dict]) -> float | None:
    """Fitted p of seconds ~ size^p for the case with most sizes; None where the size is a knob, not that of a problem."""
    if any(row["standing"] for row in rows):
        return None
    by_case: dict[str, list[dict]] = {}
    for row in (row for row in rows if not row["converging"]):
        by_case.setdefault(row["case"], []).append(row)
    largest = max(by_case.values(), key=len, default=[])
    return fitted_exponent([row["size"] for row in largest], [row["seconds"] for row in largest])
