"""Level of detail: which part of a large frame is drawn, so that a browser on a small machine keeps up.

A frame within its budget is drawn whole. Of a larger one, cloth is drawn as a coarser cloth of the same weave: every
n-th yarn of each fabric, n times as thick, through its crossings with the other yarns that are left. With n = 1, 5, 9,
... the order of over and under repeats as in the cloth itself for all weaves whose period divides four (plain, basket,
twills), where leaving out nodes along the yarns would alias their crimp. Single yarns stay, as thick as they are, on
every 4n-th of their nodes. Yarn ends are never moved. Of the points, states share the budget evenly, so that rare
ones are all there, and of frequent ones those on drawn yarns come first.

Instead, the region around a place can be drawn as it is.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Flags, Floats, Ints
from engine.run.frames import YarnFrame
from engine.yarns.model import NodeState

WEAVE_PERIOD = 4  # yarns after which the weaves repeat that are drawn coarser without changing
GROWTH = 1.2  # from one coarseness that is tried to the next
SCATTER = np.uint32(2654435769)  # 2^32 over the golden ratio: multiples of it spread evenly (Knuth, vol. 3, sec. 6.4)


@dataclass(frozen=True)
class Detail:
    """How much is drawn at most; there has to be room for one segment of each fabric."""

    segments: int  # straight pieces of yarn
    nodes: int  # points with their state


Level = Literal["auto", "fine", "region", "full"]
AUTO = Detail(20_000, 10_000)  # 1.3 MB an update; two processors that draw without a graphics card take a second
FINE = Detail(60_000, 30_000)  # 4 MB an update, for a graphics card, and for recordings and pictures


def part(yarns: YarnFrame, level: Level, focus: Floats) -> YarnFrame:
    """Return what is drawn of a frame; a region is the one around `focus` [m]."""
    if level == "full":
        return yarns
    return region(yarns, focus, AUTO) if level == "region" else coarse(yarns, budget(level))


def budget(level: Level) -> Detail:
    """Return the budget of a level; that of `full` bounds how finely curves are cut only."""
    return FINE if level in ("fine", "full") else AUTO


def coarse(yarns: YarnFrame, detail: Detail) -> YarnFrame:
    """Return the frame within the budget; it has as many yarns as before, of which those left out have no nodes."""
    lines = yarns
    if segment_count(yarns) > detail.segments:
        every = _next_coarseness(np.sqrt(np.count_nonzero(_shared(yarns.line_points)) / detail.segments))
        while segment_count(lines := _coarse_lines(yarns, every, detail.segments)) > detail.segments:
            every = _next_coarseness(GROWTH * every)
    if len(yarns.node_points) > detail.nodes:
        lines = _with_nodes(lines, _preferred_nodes(yarns, lines.line_points, detail.nodes))
    return lines


def region(yarns: YarnFrame, centre: Floats, detail: Detail) -> YarnFrame:
    """Return what is nearest to `centre` [m] as it is: of each yarn the one piece that comes closest.

    The ball that holds it is as large as the budget allows.
    """
    line_distance, node_distance = (distances_to(p, centre) for p in (yarns.line_positions, yarns.node_positions))
    reach = min(reach_of(line_distance, detail.segments), reach_of(node_distance, detail.nodes))
    yarn, inside = line_yarns(yarns), line_distance < reach
    begins = inside & ~np.concatenate([[False], inside[:-1] & (yarn[:-1] == yarn[1:])])
    piece = np.cumsum(begins) - 1
    nodes = np.flatnonzero(inside)
    nearest_first = nodes[np.lexsort((line_distance[nodes], yarn[nodes]))]
    _, first = np.unique(yarn[nearest_first], return_index=True)
    chosen = np.zeros(len(nodes) + 1, bool)
    chosen[piece[nearest_first[first]]] = True
    cut = _with_lines(yarns, inside & chosen[piece], yarns.radius)
    return _with_nodes(cut, np.flatnonzero(node_distance < reach))


def segment_count(yarns: YarnFrame) -> int:
    """Return the number of straight pieces of all yarns."""
    return int(np.maximum(np.diff(yarns.line_offsets) - 1, 0).sum())


def statement(whole: YarnFrame, part: YarnFrame, nodes: bool) -> str:
    """Return what is drawn of a frame, in words; `nodes` says whether its points are drawn too."""
    counts = [(segment_count(part), segment_count(whole), "segments")]
    if nodes:
        counts.append((len(part.node_points), len(whole.node_points), "nodes"))
    said = ", ".join(f"{n:,} of {m:,} {what}" if n < m else f"all {m:,} {what}" for n, m, what in counts)
    thicker = round(float((part.radius / whole.radius).max(initial=1.0)))
    return f"shown {said}" + (f"; every {thicker}th yarn, {thicker} times as thick" if thicker > 1 else "")


def line_yarns(yarns: YarnFrame) -> Ints:
    """Return the yarn of every line node, shape [K]."""
    return np.repeat(np.arange(len(yarns.radius)), np.diff(yarns.line_offsets))


def _next_coarseness(least: float) -> int:
    """Return the first number from `least` on that leaves 1 when divided by the period of weaves."""
    return int(np.ceil((least - 1) / WEAVE_PERIOD)) * WEAVE_PERIOD + 1


def _coarse_lines(yarns: YarnFrame, every: int, segments: int) -> YarnFrame:
    woven = yarns.fabric >= 0
    every_single = max(-(-2 * int(np.count_nonzero(~woven)) // segments), 1)
    stays = _stays(yarns.fabric, np.where(woven, every, every_single))
    node = np.flatnonzero(np.repeat(stays, np.diff(yarns.line_offsets)))
    point = yarns.line_points[node]
    shared = _shared(point)  # with another yarn that stays
    ends = yarns.line_offsets[:-1][stays], yarns.line_offsets[1:][stays] - 1
    kept = np.zeros(len(yarns.line_points), bool)
    kept[node[shared]] = kept[ends[0]] = kept[ends[1]] = True
    last_kept = np.maximum.accumulate(np.where(kept[node], node, -1))
    kept[node] |= (node - last_kept) % (WEAVE_PERIOD * every) == 0
    return _with_lines(yarns, kept, np.where(woven, every * yarns.radius, yarns.radius))


def _shared(points: NDArray[np.int32]) -> Flags:
    """Return which line nodes lie at a point of two yarns: all but ends and points between crossings go on in coarse cloth."""
    return np.bincount(points)[points] > 1


def _stays(fabric: Ints, every: Ints) -> Flags:
    """Return which yarns are drawn: of each fabric every n-th, equally far from its first and last; shape [Y]."""
    order = np.argsort(fabric, kind="stable")
    _, start, count = np.unique(fabric[order], return_index=True, return_counts=True)
    rank, size = np.empty_like(order), np.empty_like(order)
    rank[order] = np.arange(len(order)) - np.repeat(start, count)
    size[order] = np.repeat(count, count)
    return rank % every == (size - 1) % every // 2


def _preferred_nodes(yarns: YarnFrame, drawn_points: NDArray[np.int32], budget: int) -> Ints:
    """Return which points are drawn, ascending: the same from frame to frame as long as their states stay."""
    on_line = np.zeros(max(yarns.node_points.max(initial=0), drawn_points.max(initial=0)) + 1, bool)
    on_line[drawn_points] = True
    counts = np.bincount(yarns.node_states, minlength=len(NodeState))
    chosen = []
    for left, state in zip(range(len(NodeState), 0, -1), np.argsort(counts, kind="stable"), strict=True):
        of_state = np.flatnonzero(yarns.node_states == state)
        share = min(len(of_state), budget // left)
        budget -= share
        point = yarns.node_points[of_state]
        rank = (point.astype(np.uint32) * SCATTER).astype(np.int64) + (~on_line[point]).astype(np.int64) * (1 << 32)
        chosen.append(of_state[np.argpartition(rank, share - 1)[:share]] if share else of_state[:0])
    return np.sort(np.concatenate(chosen))


def _with_lines(yarns: YarnFrame, kept: Flags, radius: Floats) -> YarnFrame:
    before = np.concatenate([[0], np.cumsum(kept)])
    return replace(
        yarns, line_positions=yarns.line_positions[kept], line_strain=yarns.line_strain[kept],
        line_points=yarns.line_points[kept], line_offsets=before[yarns.line_offsets], radius=radius,
    )


def _with_nodes(yarns: YarnFrame, chosen: Ints) -> YarnFrame:
    return replace(
        yarns, node_positions=yarns.node_positions[chosen], node_states=yarns.node_states[chosen],
        node_points=yarns.node_points[chosen],
    )


def distances_to(positions: NDArray[np.floating], centre: Floats) -> Floats:
    """Return how far `positions` [n, 3] are from `centre` [3] [m], shape [n]."""
    return np.linalg.norm(positions - centre, axis=1)


def reach_of(distances: Floats, count: int) -> float:
    """Return the distance below which there are no more than `count`, infinity where there are no more in all."""
    return np.inf if len(distances) <= count else float(np.partition(distances, count)[count])
