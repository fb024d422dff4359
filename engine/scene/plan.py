"""Straight parallel yarns, and where they cross in plan view."""

from dataclasses import dataclass, replace

import numpy as np

from engine.arrays import Floats, Ints


@dataclass(frozen=True)
class Lines:
    """Parallel straight lines, evenly spaced: the warps or the wefts of a patch, or one edge of a box."""

    start: Floats  # where the first line starts [m], shape [3]
    along: Floats  # unit direction of all, shape [3]
    step: Floats  # from the start of one line to that of the next [m], shape [3]
    count: int
    length: float  # of each [m]

    @property
    def pitch(self) -> float:
        """Distance of neighbouring lines [m]."""
        return float(np.linalg.norm(self.step))

    def longer(self, reach: float) -> "Lines":
        """Return the same lines with `reach` [m] more at both ends."""
        return replace(self, start=self.start - reach * self.along, length=self.length + 2.0 * reach)

    def at(self, line: Ints, distance: Floats) -> Floats:
        """Return the places at `distance` [n] from the start of each `line` [n], shape [n, 3] [m]."""
        return self.start + line[:, None] * self.step + distance[:, None] * self.along


@dataclass(frozen=True)
class PlanCrossings:
    """Where lines `a` cross lines `b`, seen along a normal; each line of `b` crosses a range of lines of `a`."""

    first: Ints  # first line of a that line j of b crosses, shape [lines of b]
    counts: Ints  # how many it crosses, shape [lines of b]
    # distances along a and b are affine in the two line numbers: offset, per line of a, per line of b
    along_a: Floats
    along_b: Floats

    @property
    def count(self) -> int:
        """Number of crossings n."""
        return int(self.counts.sum())

    def lines(self) -> tuple[Ints, Ints]:
        """Return the number of the line in a and in b for every crossing, each of shape [n]."""
        b = np.repeat(np.arange(len(self.counts)), self.counts)
        earlier = np.repeat(np.cumsum(self.counts) - self.counts, self.counts)
        return np.repeat(self.first, self.counts) + np.arange(self.count) - earlier, b

    def distances(self, a: Ints, b: Ints) -> tuple[Floats, Floats]:
        """Return the distances from the starts of lines a [n] and b [n] to their crossings [m], each of shape [n]."""
        u, v = (c[0] + c[1] * a + c[2] * b for c in (self.along_a, self.along_b))
        return u, v


def sine_of_angle(a: Lines, b: Lines, normal: Floats) -> float:
    """Return the signed sine of the angle from a to b, seen along the unit `normal` [3]."""
    return float(np.cross(a.along, b.along) @ normal)


def cross_in_plan(a: Lines, b: Lines, normal: Floats) -> PlanCrossings:
    """Return where lines a and b, which must not be parallel, cross when seen along the unit `normal` [3].

    The cost grows with the number of lines, not with that of their crossings.
    """
    to_a, to_b = np.cross(a.along, normal), np.cross(b.along, normal)  # across the lines, in plan
    sine = a.along @ to_b
    apart = np.array([b.start - a.start, -a.step, b.step])  # b - a for the first lines, and per line of each
    along_a = apart @ to_b / sine
    along_b = apart @ to_a / sine
    of_b = np.arange(b.count)
    low, high = np.zeros(b.count), np.full(b.count, a.count - 1.0)
    for (offset, per_a, per_b), length in ((along_a, a.length), (along_b, b.length)):
        # lines of a for which 0 <= offset + per_a * line + per_b * of_b <= length
        slope = per_a or np.finfo(float).tiny
        with np.errstate(over="ignore"):
            limits = (np.array([[0.0], [length]]) - offset - per_b * of_b) / slope
        low, high = np.maximum(low, limits.min(axis=0)), np.minimum(high, limits.max(axis=0))
    first = np.ceil(low)
    counts = np.maximum(np.floor(high) - first + 1, 0)
    first = np.where(counts > 0, first, 0)
    return PlanCrossings(first.astype(np.int64), counts.astype(np.int64), along_a, along_b)
