"""How fast a run goes, and how long it will take."""

import math
import time
from collections import deque
from typing import Any

WINDOW = 20.0  # the pace is that of the last seconds: a run that meets contact slows down [s]


class Pace:
    """Simulated against passed time, over a sliding window."""

    def __init__(self) -> None:
        """Start without a pace."""
        self._seen: deque[tuple[float, float]] = deque()

    def note(self, simulated: float) -> None:
        """Take note that `simulated` seconds have been reached now."""
        now = time.monotonic()
        self._seen.append((now, simulated))
        while self._seen[0][0] < now - WINDOW and len(self._seen) > 2:
            self._seen.popleft()

    def seconds_left(self, until: float) -> float | None:
        """Return how many seconds the rest up to the simulated time `until` [s] takes, None while unknown."""
        if len(self._seen) < 2:
            return None
        (first_now, first), (last_now, last) = self._seen[0], self._seen[-1]
        if last <= first:
            return None
        return max(0.0, until - last) * (last_now - first_now) / (last - first)


def finite(value: Any) -> Any:
    """Return `value` fit for JSON: numbers that are not finite become None, NumPy scalars plain numbers."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
