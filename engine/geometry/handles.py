"""Scripted motion of pinned points: rigid motions along keyframes."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from engine.arrays import Floats, Ints


@dataclass(frozen=True)
class Handles:
    """H handles; handle i has moved by `offset` and turned by `angles` at `time`, linear in between, constant outside."""

    start: Ints  # keyframes of handle i are start[i] ... start[i+1]-1, shape [H+1]
    time: Floats  # [s], ascending in each handle, shape [sum of keyframes]
    offset: Floats  # [m], shape [sum of keyframes, 3]
    angles: Floats | None = None  # about the fixed x, y, z axes, in this order [degrees], shape [sum of keyframes, 3]
    pivot: Floats | None = None  # places at the start about which handles turn [m], shape [H, 3]; given with `angles`

    def offsets(self, time: float) -> Floats:
        """Return the translation of every handle at `time` [s], shape [H, 3] [m]."""
        return self._between(self.offset, time)

    def carry(self, x: Floats, handle: Ints, time: float, h: float) -> Floats:
        """Return where `x` [n, 3] held by `handle` [n] at `time` [s] is a step `h` [s] later, shape [n, 3] [m]."""
        before, after = self.offsets(time), self.offsets(time + h)
        carried = x + (after - before)[handle]
        if self.angles is not None and self.pivot is not None and self.angles.any():
            turned, turn = self._rotations(self.angles, time), self._rotations(self.angles, time + h)
            change = turn @ turned.transpose(0, 2, 1) - np.eye(3)
            # x = pivot + offset + rotation (start - pivot), taken as a difference to keep what does not turn in place
            carried += np.einsum("nij,nj->ni", change[handle], x - (self.pivot + before)[handle])
        return carried

    def turns(self, time: float) -> Floats:
        """Return how every handle has turned up to `time` [s] since time 0, as rotations of shape [H, 3, 3]."""
        if self.angles is None:
            return np.tile(np.eye(3), (len(self.start) - 1, 1, 1))
        return self._rotations(self.angles, time) @ self._rotations(self.angles, 0.0).transpose(0, 2, 1)

    def _rotations(self, angles: Floats, time: float) -> Floats:
        return Rotation.from_euler("xyz", self._between(angles, time), degrees=True).as_matrix()

    def _between(self, values: Floats, time: float) -> Floats:
        return np.array([
            [np.interp(time, self.time[a:b], values[a:b, k]) for k in range(3)]
            for a, b in zip(self.start[:-1], self.start[1:], strict=True)
        ]).reshape(-1, 3)


def no_handles() -> Handles:
    """Return an empty set of handles."""
    return Handles(np.zeros(1, np.int64), np.zeros(0), np.zeros((0, 3)))
