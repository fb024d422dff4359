"""Which part of a large frame of strands is drawn, so that a browser on a small machine keeps up.

A frame within its budget is drawn whole. Of a larger one, long strands are drawn through every n-th vertex, as long as that
leaves each of them PIECES pieces: curls would be lost otherwise. If that is not enough, some strands of each group stand for
all, spread evenly over it and so much thicker that together they have the section of all. They are the same in every frame.
Ends are never moved.

Strands are much thinner than the pixels of a picture of the whole scene, so they are drawn a little thicker there. The region
around a place, or everything, can be drawn as it is.
"""

from dataclasses import dataclass, replace

import numpy as np

from engine.arrays import Flags, Floats, Ints
from engine.run.frames import StrandFrame
from viewer.detail import AUTO, Level, budget, distances_to, reach_of

PIECES = 64  # of a strand that leaving out vertices leaves at least
THINNEST = 1 / 3000  # of the diagonal of the strands' box: the least radius that is drawn where the whole scene is


@dataclass(frozen=True)
class Part:
    """What is drawn of a frame."""

    strands: StrandFrame
    said: str  # what that is, in words


def part(strands: StrandFrame, level: Level, focus: Floats) -> Part:
    """Return what is drawn of a frame; a region is the one around `focus` [m]."""
    if level == "full":
        return Part(strands, _counted(strands, strands))
    if level == "region":
        near = region(strands, focus, AUTO.segments)
        return Part(near, _counted(near, strands))
    drawn = coarse(strands, budget(level).segments)
    said = [_counted(drawn, strands)]
    if len(drawn.group) < len(strands.group):
        said.append(f"{len(drawn.group):,} of {len(strands.group):,} strands, as thick as all of them together")
    thicker = seen(drawn, strands)
    if thicker is not drawn:
        said.append(f"none drawn thinner than {2e3 * float(thicker.radius.min()):.2g} mm")
    return Part(thicker, "; ".join(said))


def coarse(strands: StrandFrame, segments: int) -> StrandFrame:
    """Return strands of no more than so many segments; there has to be room for a strand."""
    pieces = np.diff(strands.offsets) - 1
    if pieces.sum() <= segments:
        return strands
    along, most = np.ones_like(pieces), np.maximum(pieces // PIECES, 1)
    while (left := -(-pieces // along)).sum() > segments and (along < most).any():
        along = np.minimum(along + 1, most)
    stays = _standing_for_all(strands.group, left, segments)
    strand = vertex_strands(strands)
    place = np.arange(len(strand)) - strands.offsets[strand]
    kept = np.flatnonzero(stays[strand] & ((place % along[strand] == 0) | (place == pieces[strand])))
    _, group, count = np.unique(strands.group, return_inverse=True, return_counts=True)
    together = np.sqrt(count / np.maximum(np.bincount(group[stays], minlength=len(count)), 1))
    drawn = _through(strands, kept, np.diff(strand[kept], prepend=-1) > 0)
    return replace(drawn, radius=(drawn.radius * together[group][strand[kept]]).astype(np.float32))


def seen(drawn: StrandFrame, strands: StrandFrame) -> StrandFrame:
    """Return what is drawn of `strands` as thick as it has to be to be seen where all of them are."""
    least = THINNEST * extent(strands)
    if (drawn.radius >= least).all():
        return drawn
    return replace(drawn, radius=np.maximum(drawn.radius, np.float32(least)))


def region(strands: StrandFrame, centre: Floats, vertices: int) -> StrandFrame:
    """Return what is nearest to `centre` [m] as it is, up to so many vertices; every piece of a strand is one of its own."""
    distance = distances_to(strands.positions, centre)
    near = np.flatnonzero(distance < reach_of(distance, vertices))
    apart = (np.diff(near, prepend=-2) > 1) | (np.diff(vertex_strands(strands)[near], prepend=-1) > 0)
    return _through(strands, near, apart)


def segment_count(strands: StrandFrame) -> int:
    """Return the number of edges of all strands."""
    return int(np.maximum(np.diff(strands.offsets) - 1, 0).sum())


def vertex_strands(strands: StrandFrame) -> Ints:
    """Return the strand of every vertex, shape [V]."""
    return np.repeat(np.arange(len(strands.group)), np.diff(strands.offsets))


def scattered(count: int) -> Ints:
    """Return the numbers below `count` in an order that is always the same, and random: grooms follow regular sequences, and
    every n-th strand, or any other regular choice, may be all on one side of a head."""
    return np.random.default_rng(0).permutation(count)


def extent(strands: StrandFrame) -> float:
    """Return the diagonal of the box around all vertices [m]."""
    return float(np.linalg.norm(np.ptp(strands.positions, axis=0))) if len(strands.positions) else 0.0


def _standing_for_all(group: Ints, pieces: Ints, segments: int) -> Flags:
    """Return which strands are drawn, so that all have up to `segments` pieces; of each group the same share, if one at all."""
    rank = scattered(len(group))
    order = np.lexsort((rank, group))
    _, start, count = np.unique(group[order], return_index=True, return_counts=True)
    share = np.empty(len(group))  # of its group that comes before each strand
    share[order] = (np.arange(len(group)) - np.repeat(start, count)) / np.repeat(count, count)
    first = np.lexsort((rank, share))
    fitting = max(int(np.searchsorted(np.cumsum(pieces[first]), segments, side="right")), 1)
    stays = np.zeros(len(group), np.bool_)
    stays[first[:fitting]] = True
    return stays


def _through(strands: StrandFrame, vertices: Ints, begins: Flags) -> StrandFrame:
    """Return strands through some of the vertices, ascending, a new one from each on that `begins` one."""
    return StrandFrame(
        positions=strands.positions[vertices], offsets=np.append(np.flatnonzero(begins), len(vertices)),
        radius=strands.radius[vertices], group=strands.group[vertex_strands(strands)[vertices[begins]]],
        strain=strands.strain[vertices], curvature=strands.curvature[vertices], contact_force=strands.contact_force[vertices],
    )


def _counted(drawn: StrandFrame, strands: StrandFrame) -> str:
    n, m = segment_count(drawn), segment_count(strands)
    return f"shown {n:,} of {m:,} segments" if n < m else f"shown all {m:,} segments"
