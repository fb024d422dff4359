"""Choices of knobs for one problem: what each took, how far off it came out, and which of them nothing beats."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite
from statistics import median
from time import perf_counter
from typing import TypeVar

from engine.bench.suite import Measurement, Standing
from engine.run.adaptivity import StepTooSmall

LEAST = 0.5  # [s]; shorter runs are repeated until they have taken as long

Result = TypeVar("Result")


@dataclass(frozen=True)
class Choice:
    """One choice of knobs."""

    case: str  # "problem, all knobs but the step"
    steps: float  # of default size in a step-adaptive run
    seconds: float  # median
    error: float | None  # None where the run failed
    default: bool = False
    details: dict[str, float] = field(default_factory=dict)

    @property
    def off(self) -> float:
        """The error, infinite where the run failed."""
        return inf if self.error is None else self.error


def tried(
    case: str, steps: float, simulate: Callable[[], Result], error: Callable[[Result], float], default: bool = False,
    **details: float,
) -> Choice:
    """Return how `simulate` does, whose result is off by `error`.

    A run that raises RuntimeError or StepTooSmall, or ends in what is not a number, has failed.
    """
    seconds: list[float] = []
    started = perf_counter()
    while perf_counter() - started < LEAST:
        began = perf_counter()
        try:
            result = simulate()
        except (RuntimeError, StepTooSmall):
            return Choice(case, steps, perf_counter() - began, None, default, details)
        seconds.append(perf_counter() - began)
    off = error(result)
    return Choice(case, steps, median(seconds), off if isfinite(off) else None, default, details)


def rows(own: Sequence[Choice], peer: str | None = None, peers: Sequence[Choice] = ()) -> Iterator[Measurement]:
    """Yield a row for every choice, the peer's too; on the front are those than which none is both faster and more accurate.

    The peer's time of a row is that of its fastest choice with at most the same error: none where all have more, or the row
    failed.
    """
    everyone = (*own, *peers)
    for number, choice in enumerate(everyone):
        beaten = any(other.seconds < choice.seconds and other.off < choice.off for other in everyone)
        same = [other.seconds for other in peers if other.off <= choice.off < inf] if number < len(own) else []
        yield Measurement(
            choice.case, choice.steps, choice.seconds, "steps", peer=peer if number < len(own) else None,
            peer_seconds=min(same, default=None), error=choice.error,
            standing=Standing(on_front=choice.error is not None and not beaten, default=choice.default),
            details=choice.details,
        )
