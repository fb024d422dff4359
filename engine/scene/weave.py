"""Plain-weave patches: two families of straight yarns that go over and under each other in turn."""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Floats
from engine.scene.placement import axes
from engine.scene.plan import Lines
from engine.scene.schema import Fabric
from engine.yarns.assembly import YarnAssembly, YarnMaterial
from engine.yarns.model import PointKind


@dataclass(frozen=True)
class Weave:
    """The geometry of a patch at the start."""

    warps: Lines
    wefts: Lines
    normal: Floats  # unit vector [3]

    @property
    def families(self) -> tuple[Lines, Lines]:
        """Warps and wefts, in the order in which their yarns are numbered."""
        return self.warps, self.wefts


def weave(fabric: Fabric) -> Weave:
    """Return the geometry of a patch: yarns end half a spacing beyond their last crossing."""
    across, along, normal = axes(fabric.rotation).T
    spacing, width, height = fabric.spacing, fabric.warps * fabric.spacing, fabric.wefts * fabric.spacing
    corner = np.array(fabric.position) - width / 2 * across - height / 2 * along
    return Weave(
        warps=Lines(corner + spacing / 2 * across, along, spacing * across, fabric.warps, height),
        wefts=Lines(corner + spacing / 2 * along, across, spacing * along, fabric.wefts, width),
        normal=normal,
    )


def add_weave(
    assembly: YarnAssembly, index: int, fabric: Fabric, warp: YarnMaterial, weft: YarnMaterial, level: int
) -> int:
    """Add the yarns and points of a patch, fabric `index` of the scene; returns the number of its first yarn.

    Its warps come first, then its wefts. `level` counts the fabrics below it, for `default_obstacle_distance`.
    """
    patch = weave(fabric)
    first = len(assembly.yarns)
    for lines, material in zip(patch.families, (warp, weft), strict=True):
        distance = fabric.obstacle_distance or default_obstacle_distance(material.radius, level)
        for _ in range(lines.count):
            assembly.yarn(material, lines.length, fabric.spacing, index, fabric.kinematic, distance)
    _add_crossings(assembly, first, fabric, patch)
    yarn = first
    for lines in patch.families:
        _add_ends(assembly, yarn, fabric, lines)
        yarn += lines.count
    return first


def default_obstacle_distance(radius: float, level: int) -> float:
    """Return the distance at which obstacles begin to push the yarns of a fabric with `level` fabrics below it [m].

    Layers of a stack coincide. The lowest alone should carry on what lies below it; those above it touch an obstacle
    only where they hang off it, so they come a little nearer to obstacles before these push.
    """
    return radius * 0.9**level


def _add_crossings(assembly: YarnAssembly, first: int, fabric: Fabric, patch: Weave) -> None:
    i, j = np.divmod(np.arange(fabric.warps * fabric.wefts), fabric.wefts)
    u, v = (j + 0.5) * fabric.spacing, (i + 0.5) * fabric.spacing
    warp, weft = first + i, first + fabric.warps + j
    warp_below = (i + j) % 2 == 0
    assembly.crossings(
        np.where(warp_below, warp, weft), np.where(warp_below, u, v),
        np.where(warp_below, weft, warp), np.where(warp_below, v, u),
        patch.warps.at(i, u), patch.normal, fabric.friction,
        # nothing slides in a patch whose shape is given
        PointKind.STITCH if fabric.kinematic else PointKind.CROSSING, pinned=fabric.kinematic,
    )


def _add_ends(assembly: YarnAssembly, first: int, fabric: Fabric, lines: Lines) -> None:
    line = np.arange(lines.count)
    outermost = (line == 0) | (line == lines.count - 1)
    pinned = fabric.kinematic or fabric.pins == "edges" or (fabric.pins == "corners") & outermost
    for end in (0.0, lines.length):
        u = np.full(lines.count, end)
        assembly.lagrangians(first + line, u, lines.at(line, u), pinned)
