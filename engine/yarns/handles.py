"""Scripted motion of pinned points: translations along keyframes."""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Floats, Ints


@dataclass(frozen=True)
class Handles:
    """H handles; handle i moves by `offset` at `time`, linear in between, constant outside."""

    start: Ints  # keyframes of handle i are start[i] ... start[i+1]-1, shape [H+1]
    time: Floats  # [s], ascending in each handle, shape [sum of keyframes]
    offset: Floats  # [m], shape [sum of keyframes, 3]

    def offsets(self, time: float) -> Floats:
        """Return the translation of every handle at `time` [s], shape [H, 3] [m]."""
        return np.array([
            [np.interp(time, self.time[a:b], self.offset[a:b, k]) for k in range(3)]
            for a, b in zip(self.start[:-1], self.start[1:], strict=True)
        ]).reshape(-1, 3)


def no_handles() -> Handles:
    """Return an empty set of handles."""
    return Handles(np.zeros(1, np.int64), np.zeros(0), np.zeros((0, 3)))
