"""How yarns lie over and under each other in pictures.

The two nodes of an Eulerian-on-Lagrangian contact share one point, and stacked fabrics share one surface: the method
ignores thickness, and yarns drawn where they are computed would run through each other. So for display only, each
yarn of a crossing moves by its radius to its own side of the point, and each fabric by the thickness of those below
it (Sánchez-Banderas 2020 does the same to render). Simulation and reports know nothing of this.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Flags, Floats, Ints
from engine.run.frames import YarnFrame
from engine.scene.build import Built
from engine.scene.schema import Scene
from engine.scene.stack import levels
from engine.yarns.model import YarnModel
from viewer.curves import smooth
from viewer.detail import line_yarns

PARALLEL = 1e-3  # sine of the angle below which two yarns define no side


Layout = Callable[[YarnFrame, int], YarnFrame]  # moves yarns to where they are drawn, cut into so many pieces at most


def layout_of(scene: Scene, built: Built) -> Layout:
    """Return how the yarns of a scene are laid out."""
    if built.yarns is None:
        return unchanged
    return partial(lay_out, model=built.yarns, lifts=yarn_lifts(scene, built.yarns))


def unchanged(yarns: YarnFrame, _most: int) -> YarnFrame:
    """Return the yarns as they are."""
    return yarns


def yarn_lifts(scene: Scene, model: YarnModel) -> Floats:
    """Return how far above its points the middle of each yarn's fabric is drawn, 0 for single yarns, shape [Y] [m].

    A fabric is four radii thick, two yarns over each other. Half of that would sink into what the lowest one lies on,
    from which its points keep a distance of one radius.
    """
    lifts = np.zeros(model.yarn_count)
    level = levels(scene.fabrics, scene.contacts)
    height = 0.0
    for here in sorted(set(level.values())):
        of_level = np.isin(model.fabric, [i for i, fabric in enumerate(scene.fabrics) if level[fabric.name] == here])
        radius = model.radius[of_level].max()
        lifts[of_level] = height + radius
        height += 4 * radius
    return lifts


def lay_out(yarns: YarnFrame, most: int, model: YarnModel, lifts: Floats) -> YarnFrame:
    """Return the yarns as curves through where they are drawn, cut finer than they are into up to `most` pieces.

    At the crossings of a fabric, and of single yarns, the way to go is known; between them it is interpolated along
    the yarn, beyond the last it stays the same. A yarn without crossings stays where it is. Yarns that are drawn
    thicker than they are lie as much higher.
    """
    line_yarn, positions = line_yarns(yarns), yarns.line_positions.astype(np.float64)
    line, pair, side = _crossings(line_yarn, yarns.line_points, model)
    tangents = _tangents(line_yarn, positions)
    up = side[:, None] * np.cross(tangents[line[:, 0]], tangents[line[:, 1]])
    sine = np.linalg.norm(up, axis=1)
    usable = sine > PARALLEL
    line, pair, up = line[usable], pair[usable], up[usable] / sine[usable, None]
    offsets, known = np.zeros_like(positions), np.zeros(len(line_yarn), bool)
    lifts = lifts * yarns.radius / model.radius
    for slot, sign in ((0, -1.0), (1, 1.0)):  # the second yarn of a point lies above the first
        yarn = pair[:, slot]
        offsets[line[:, slot]] = (lifts[yarn] + sign * yarns.radius[yarn])[:, None] * up
        known[line[:, slot]] = True
    offsets = _between(line_yarn, positions, offsets, known)
    return _curved(replace(yarns, line_positions=positions + offsets), most)


def _curved(yarns: YarnFrame, most: int) -> YarnFrame:
    """Return the yarns as smooth curves through their line nodes."""
    curves = smooth(yarns.line_positions, yarns.line_offsets, most)
    return replace(
        yarns, line_positions=curves.positions, line_points=yarns.line_points[curves.before],
        line_strain=curves.between(yarns.line_strain), line_offsets=curves.offsets,
    )


def _crossings(line_yarn: Ints, line_points: NDArray[np.int32], model: YarnModel) -> tuple[Ints, Ints, Floats]:
    """Return crossings of a fabric or of single yarns: line nodes and yarns of both, shape [Q, 2], and side [Q].

    A point one of whose yarns is not drawn there is none of them.
    """
    line_of = np.full((model.point_count, 2), -1, np.int64)  # line node of each slot of each point
    slot = (line_yarn != model.node_yarn[model.point_nodes[line_points, 0]]).astype(np.int64)
    line_of[line_points, slot] = np.arange(len(line_points))
    points = np.flatnonzero((line_of >= 0).all(axis=1))
    pair = model.node_yarn[model.point_nodes[points]]
    own = model.fabric[pair[:, 0]] == model.fabric[pair[:, 1]]
    return line_of[points[own]], pair[own], model.side[points[own]]


def _tangents(line_yarn: Ints, positions: Floats) -> Floats:
    """Return unit tangents at line nodes, shape [K, 3]."""
    node = np.arange(len(line_yarn))
    before, after = np.maximum(node - 1, 0), np.minimum(node + 1, len(node) - 1)
    before = np.where(line_yarn[before] == line_yarn, before, node)
    after = np.where(line_yarn[after] == line_yarn, after, node)
    along = positions[after] - positions[before]
    return along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), np.finfo(float).tiny)


def _between(line_yarn: Ints, positions: Floats, offsets: Floats, known: Flags) -> Floats:
    """Return the offsets with those not known interpolated along each yarn, shape [K, 3]."""
    node = np.arange(len(known))
    before = np.maximum.accumulate(np.where(known, node, -1))
    after = np.minimum.accumulate(np.where(known, node, len(node))[::-1])[::-1]
    has_before = (before >= 0) & (line_yarn[before] == line_yarn)
    has_after = (after < len(node)) & (line_yarn[np.minimum(after, len(node) - 1)] == line_yarn)
    before, after = np.where(has_before, before, after), np.where(has_after, after, before)
    placed = has_before | has_after
    before, after = np.where(placed, before, node), np.where(placed, after, node)
    steps = np.linalg.norm(np.diff(positions, axis=0, prepend=positions[:1]), axis=1)
    arc = np.cumsum(steps)
    span = arc[after] - arc[before]
    share = np.divide(arc - arc[before], span, out=np.zeros(len(node)), where=span > 0)[:, None]
    return (1 - share) * offsets[before] + share * offsets[after]
