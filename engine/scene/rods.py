"""Single yarns along lines of points, with eyelets and crossings at some of these points."""

from collections.abc import Callable, Mapping, Set

import numpy as np

from engine.arrays import Floats, Ints
from engine.scene.schema import Scene, Yarn
from engine.yarns.assembly import YarnAssembly, YarnMaterial
from engine.yarns.model import PointKind

_GRIPPED = {"free": 0, "pinned": 1, "clamped": 2}  # fixed nodes that an end holds
_KINDS = {"crossing": PointKind.CROSSING, "contact": PointKind.CONTACT, "stitch": PointKind.STITCH}


def piece_lengths(yarn: Yarn) -> Floats:
    """Return the lengths of the straight pieces between the points of a yarn [m]."""
    return np.linalg.norm(np.diff(np.array(yarn.points), axis=0), axis=1)


def piece_segments(yarn: Yarn) -> Ints:
    """Return the number of segments of every piece: none is longer than the length of the yarn over `segments`."""
    pieces = piece_lengths(yarn)
    # a hair less than the share, so that rounding adds no segment to pieces that divide evenly
    return np.maximum(np.ceil(yarn.segments * pieces / pieces.sum() - 1e-9), 1).astype(np.int64)


def held_points(scene: Scene) -> dict[str, set[int]]:
    """Return, for every single yarn, the indices of its points that eyelets or crossings hold."""
    held = {yarn.name: {eyelet.point for eyelet in yarn.eyelets} for yarn in scene.yarns}
    for crossing in scene.crossings:
        for side in (crossing.lower, crossing.upper):
            held[side.yarn].add(side.point)
    return held


def fixed_nodes(yarn: Yarn, held: Set[int]) -> tuple[Floats, Floats]:
    """Return arc length fractions [n] and positions [n, 3] of the fixed nodes: ends, divisions, points not held."""
    points, segments = np.array(yarn.points), piece_segments(yarn)
    piece = np.repeat(np.arange(len(segments)), segments)
    within = np.arange(len(piece)) - np.repeat(np.cumsum(segments) - segments, segments)
    fraction = (within / segments[piece])[:, None]
    free = (within > 0) | ~np.isin(piece, list(held))
    x = points[piece] + fraction * (points[piece + 1] - points[piece])
    corner = corner_fractions(yarn)
    along = corner[piece] + fraction[:, 0] * (corner[piece + 1] - corner[piece])
    return np.append(along[free], 1.0), np.vstack([x[free], points[-1]])


def corner_fractions(yarn: Yarn) -> Floats:
    """Return the arc length up to each point of the yarn, as fractions of the whole."""
    arc = np.concatenate([[0.0], np.cumsum(piece_lengths(yarn))])
    return arc / arc[-1]


def undeformed_length(yarn: Yarn) -> float:
    """Return the undeformed length of the yarn [m]."""
    return float(piece_lengths(yarn).sum()) * yarn.length_factor


def add_rods(
    assembly: YarnAssembly, scene: Scene, material: Callable[[str], YarnMaterial], handles: Mapping[str | None, int]
) -> None:
    """Add all single yarns, then their crossings; `handles` are the numbers of handles by name, -1 for None."""
    held = held_points(scene)
    places: dict[str, tuple[int, Floats]] = {}  # number of a yarn, and u of its points
    for yarn in scene.yarns:
        index = _add_rod(assembly, yarn, material(yarn.material), held[yarn.name], handles)
        places[yarn.name] = index, corner_fractions(yarn) * undeformed_length(yarn)
        for eyelet in yarn.eyelets:
            u, x = places[yarn.name][1][eyelet.point], np.array(yarn.points[eyelet.point])
            assembly.eyelet(index, u, x, eyelet.friction)
    points = {yarn.name: yarn.points for yarn in scene.yarns}
    for crossing in scene.crossings:
        (below, u), (above, v) = places[crossing.lower.yarn], places[crossing.upper.yarn]
        x = np.array(points[crossing.lower.yarn][crossing.lower.point])
        assembly.crossing(below, u[crossing.lower.point], above, v[crossing.upper.point], x, np.array(crossing.up),
                          crossing.friction, _KINDS[crossing.kind])


def _add_rod(
    assembly: YarnAssembly, yarn: Yarn, material: YarnMaterial, held: Set[int], handles: Mapping[str | None, int]
) -> int:
    """Add one yarn with its fixed nodes; returns its number."""
    length = undeformed_length(yarn)
    index = assembly.yarn(material, length, length / int(piece_segments(yarn).sum()), kinematic=yarn.kinematic)
    along, x = fixed_nodes(yarn, held)
    pinned, handle = np.full(len(along), yarn.kinematic), np.full(len(along), -1)
    for end, from_end in ((yarn.start, np.arange(len(along))), (yarn.end, np.arange(len(along))[::-1])):
        gripped = from_end[: _GRIPPED[end.hold]]
        pinned[gripped], handle[gripped] = True, handles[end.handle]
    assembly.lagrangians(index, along * length, x, pinned, handle)
    return index
