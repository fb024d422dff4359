"""The catalogue of validation cases: each a function that measures error against something nobody here wrote.

A case is registered by `@case` in a module of this package and returns a `CaseResult`; whether it passes is decided
here, from its bar, so that no case can be its own judge.
"""

import importlib
import pkgutil
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from math import isfinite

import engine.validate
from engine.run.machine import describe_machine
from engine.run.threads import set_threads


class UnknownCase(Exception):
    """An id that is not in the catalogue."""


@dataclass(frozen=True)
class Row:
    """One run of a case: what its knob was set to, what that cost and what it bought."""

    knob: str  # name and unit, such as "dt [s]"
    value: float
    error: float
    seconds: float


@dataclass(frozen=True)
class CaseResult:
    """What a case measured."""

    rows: list[Row]
    error: float  # the number that the bar is about, in the bar's unit
    order: float | None = None  # fitted order of convergence
    note: str = ""  # what a reader should know
    failures: list[str] = field(default_factory=list)  # conditions beside the bar that do not hold


@dataclass(frozen=True)
class Case:
    """An entry of the catalogue."""

    id: str
    bar: float  # the error must not be above
    order: float | None  # the fitted order must not be below, None where order is not judged
    summary: str
    measure: Callable[[bool], CaseResult]  # called with whether to be quick


Progress = Callable[[int, int, str], None]
_cases: dict[str, Case] = {}


def case(
    id: str, *, bar: float, summary: str, order: float | None = None
) -> Callable[[Callable[[bool], CaseResult]], Callable[[bool], CaseResult]]:
    """Register the decorated function `measure(quick) -> CaseResult` as the case `id`.

    It passes when its error is at most `bar`, its fitted order at least `order` where that is given, and it names no
    failures. With `quick` it measures the part that continuous integration can afford.
    """

    def register(measure: Callable[[bool], CaseResult]) -> Callable[[bool], CaseResult]:
        if id in _cases:
            raise ValueError(f"two cases are called {id}")
        _cases[id] = Case(id, bar, order, summary, measure)
        return measure

    return register


def timed_rows(knob: str, values: Sequence[float], error: Callable[[float], float]) -> list[Row]:
    """Return one row for each of the knob's values, after an untimed run of the first, which compiles the kernels."""
    error(values[0])
    rows = []
    for value in values:
        start = time.perf_counter()
        measured = error(value)
        rows.append(Row(knob, value, measured, time.perf_counter() - start))
    return rows


def cases() -> dict[str, Case]:
    """Return all cases by id, after importing the modules that hold them."""
    for module in pkgutil.iter_modules(engine.validate.__path__):
        importlib.import_module(f"{engine.validate.__name__}.{module.name}")
    return dict(_cases)


def run(
    ids: Sequence[str] = (), quick: bool = False, on_progress: Progress | None = None, threads: int | None = None
) -> dict:
    """Run the cases `ids` (all when empty) and return what `strandline validate --json` prints.

    `on_progress` is called with how many cases are done, how many there are, and the id of the next ("" at the end).
    Raises UnknownCase before anything runs. A case that raises is a failing case.
    """
    known = cases()
    if unknown := [id for id in ids if id not in known]:
        raise UnknownCase(f"no case is called {', '.join(unknown)}; there are {', '.join(sorted(known))}")
    chosen = [known[id] for id in ids or known]
    machine = describe_machine(set_threads(threads))
    tell = on_progress or (lambda done, total, next_id: None)
    entries = []
    for done, entry in enumerate(chosen):
        tell(done, len(chosen), entry.id)
        entries.append(_judged(entry, quick))
    tell(len(chosen), len(chosen), "")
    return {"cases": entries, "machine": machine}


def passed(result: dict) -> bool:
    """Return whether every case of a result of `run` is at its bar."""
    return all(entry["status"] == "pass" for entry in result["cases"])


def _judged(entry: Case, quick: bool) -> dict:
    try:
        result = entry.measure(quick)
    except Exception as error:  # one case must not keep the others from being measured
        result = CaseResult([], float("nan"), failures=[f"{type(error).__name__}: {error}"])
    failures = list(result.failures)
    if not result.error <= entry.bar and not failures:  # written so that nan is above the bar
        failures.append(f"error {result.error:.3g} is above the bar {entry.bar:.3g}")
    if entry.order is not None and not failures and (result.order is None or not result.order >= entry.order):
        failures.append(f"order {result.order} is below {entry.order}")
    return {
        "id": entry.id,
        "status": "fail" if failures or not result.error <= entry.bar else "pass",
        "error": _number(result.error),
        "bar": entry.bar,
        "order": _number(result.order),
        "order_bar": entry.order,
        "rows": [asdict(row) | {"error": _number(row.error)} for row in result.rows],
        "note": "; ".join(part for part in [*failures, result.note] if part),
        "summary": entry.summary,
    }


def _number(value: float | None) -> float | None:
    """JSON has no nan and no infinity."""
    return float(value) if value is not None and isfinite(value) else None
