"""The geometry of woven patches at the start: two families of straight yarns on a grid."""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Flags, Floats, Ints
from engine.scene.outline import Pieces, cut
from engine.scene.placement import axes
from engine.scene.plan import Lines
from engine.scene.schema import Fabric


@dataclass(frozen=True)
class Family:
    """The warps or the wefts of a patch: each yarn is a piece of one of the lines of the grid."""

    lines: Lines
    pieces: Pieces
    spacing: float  # of the crossings along the yarns [m]

    @property
    def count(self) -> int:
        """Number of yarns."""
        return len(self.pieces.line)

    @property
    def lengths(self) -> Floats:
        """Length of each yarn [m]."""
        return self.pieces.high - self.pieces.low

    @property
    def first(self) -> Floats:
        """How far from its start each yarn has its first crossing [m]."""
        return (np.ceil(self.pieces.low / self.spacing - 0.5) + 0.5) * self.spacing - self.pieces.low

    @property
    def last(self) -> Floats:
        """How far from its start each yarn has its last crossing [m]."""
        return (np.floor(self.pieces.high / self.spacing - 0.5) + 0.5) * self.spacing - self.pieces.low

    def divisions(self, segments: int) -> tuple[Ints, Floats]:
        """Return yarn [n] and u [n] [m] of the places that divide yarns, crossings and ends not among them.

        There are so many `segments` between neighbouring crossings, and none is longer between ends and crossings.
        """
        before, between, behind = self._segments(segments)
        inner = before + between + behind - 1
        yarn = np.repeat(np.arange(self.count), inner)
        number = 1 + np.arange(len(yarn)) - np.repeat(np.cumsum(inner) - inner, inner)
        from_first = number - before[yarn]
        from_last = from_first - between[yarn]
        u = self.first[yarn] + from_first * self.spacing / segments
        u = np.where(from_first < 0, (self.first / before)[yarn] * number, u)
        u = np.where(from_last > 0, self.last[yarn] + ((self.lengths - self.last) / behind)[yarn] * from_last, u)
        divides = (from_first < 0) | (from_last > 0) | (from_first % segments > 0)
        return yarn[divides], u[divides]

    def division_count(self, segments: int) -> int:
        """Return the number of `divisions`."""
        before, between, behind = self._segments(segments)
        return int((before + behind - 2 + between // segments * (segments - 1)).sum())

    def _segments(self, segments: int) -> tuple[Ints, Ints, Ints]:
        """Numbers of segments before the first crossing of each yarn, between its crossings, and behind the last one."""
        longest = self.spacing / segments
        before, between, behind = self.first / longest, (self.last - self.first) / longest, (self.lengths - self.last) / longest
        # a hair less, so that rounding adds no segment where they fit evenly
        return (np.ceil(before - 1e-9).astype(np.int64), np.round(between).astype(np.int64),
                np.ceil(behind - 1e-9).astype(np.int64))

    def at(self, yarn: Ints, u: Floats) -> Floats:
        """Return the places at `u` [n] from the start of each `yarn` [n], shape [n, 3] [m]."""
        return self.lines.at(self.pieces.line[yarn], self.pieces.low[yarn] + u)

    def find(self, line: Ints, distance: Floats) -> tuple[Ints, Floats]:
        """Return the yarn at `distance` [n] from the start of each `line` [n], -1 where there is none, and its u [m]."""
        yarn, u, _ = self.find_near(line, np.clip(distance, 0.0, self.lines.length), 0.0)
        return yarn, u

    def find_near(self, line: Ints, distance: Floats, reach: float) -> tuple[Ints, Floats, Floats]:
        """Return the yarn nearest to `distance` [n] from the start of each `line` [n], and u of its nearest place.

        Returns besides how far beyond its ends that is [m], shape [n]. Where that is more than `reach` [m], it is -1.
        """
        # complex numbers sort by the line first, then along it
        behind = np.searchsorted(self.pieces.line + 1j * self.pieces.low, line + 1j * distance, side="right")
        yarn = np.clip(behind - [[1], [0]], 0, self.count - 1)  # the one that begins before, and the one after it
        place = distance - self.pieces.low[yarn]
        u = np.clip(place, 0.0, self.lengths[yarn])
        beyond = np.where(self.pieces.line[yarn] == line, np.abs(place - u), np.inf)
        nearer = beyond.argmin(axis=0), np.arange(len(line))
        return np.where(beyond[nearer] <= reach, yarn[nearer], -1), u[nearer], beyond[nearer]


@dataclass(frozen=True)
class Weave:
    """The geometry of a patch at the start."""

    warps: Family
    wefts: Family
    frame: Floats  # unit vectors across the warps, along them, and up as columns [3, 3]
    centre: Floats  # [m], shape [3]
    kept: Flags | None  # crossings of the grid that an outline leaves, shape [warps, wefts]; None where it has none

    @property
    def families(self) -> tuple[Family, Family]:
        """Warps and wefts, in the order in which their yarns are numbered."""
        return self.warps, self.wefts

    @property
    def normal(self) -> Floats:
        """Unit vector upwards [3]."""
        return self.frame[:, 2]

    @property
    def yarn_count(self) -> int:
        """Number of warps and wefts."""
        return self.warps.count + self.wefts.count

    @property
    def crossing_count(self) -> int:
        """Number of places where a warp crosses a weft."""
        return self.warps.lines.count * self.wefts.lines.count if self.kept is None else int(self.kept.sum())

    def division_count(self, segments: int) -> int:
        """Return the number of places that divide warps and wefts into so many `segments` between crossings."""
        return sum(family.division_count(segments) for family in self.families)

    def crossings(self) -> tuple[Ints, Ints]:
        """Return the lines of the warp and of the weft for every crossing, each of shape [n]."""
        if self.kept is None:
            return np.divmod(np.arange(self.crossing_count), self.wefts.lines.count)
        i, j = np.nonzero(self.kept)
        return i, j

    def local(self, x: Floats) -> Floats:
        """Return places `x` [n, 3] in the patch's own plane about its centre, shape [n, 2] [m]."""
        return (x - self.centre) @ self.frame[:, :2]


def weave(fabric: Fabric) -> Weave:
    """Return the geometry of a patch: yarns end half a spacing beyond their last crossing, or earlier at its outline."""
    frame = axes(fabric.rotation)
    across, along, _ = frame.T
    (between_warps, between_wefts), centre = fabric.spacings, np.array(fabric.position)
    width, height = fabric.warps * between_warps, fabric.wefts * between_wefts
    corner = centre - width / 2 * across - height / 2 * along
    warps = Lines(corner + between_warps / 2 * across, along, between_warps * across, fabric.warps, height)
    wefts = Lines(corner + between_wefts / 2 * along, across, between_wefts * along, fabric.wefts, width)
    if fabric.outline is None:
        kept, warp_pieces, weft_pieces = None, _whole(warps), _whole(wefts)
    else:
        counts, outline = (fabric.warps, fabric.wefts), np.array(fabric.outline)
        kept, warp_pieces, weft_pieces = cut(outline, counts, fabric.spacings)
    return Weave(Family(warps, warp_pieces, between_wefts), Family(wefts, weft_pieces, between_warps), frame, centre, kept)


def _whole(lines: Lines) -> Pieces:
    return Pieces(np.arange(lines.count), np.zeros(lines.count), np.full(lines.count, lines.length))
