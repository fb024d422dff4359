"""Fabrics of a scene as yarns and points: crossings, ends, and what holds them."""

from collections.abc import Callable, Mapping

import numpy as np

from engine.arrays import Flags
from engine.scene.patterns import PATTERNS, warp_over
from engine.scene.schema import Fabric
from engine.scene.weave import Family, Weave
from engine.yarns.assembly import YarnAssembly, YarnMaterial
from engine.yarns.model import PointKind

# family (0 warps, 1 wefts) that ends at an edge, and whether with its first or last ends
_ENDING = {"bottom": (0, False), "top": (0, True), "left": (1, False), "right": (1, True)}


def add_fabric(
    assembly: YarnAssembly, index: int, fabric: Fabric, patch: Weave, material: Callable[[str], YarnMaterial], level: int,
    handles: Mapping[str | None, int],
) -> int:
    """Add the yarns and points of a patch, fabric `index` of the scene; returns the number of its first yarn.

    Its warps come first, then its wefts. `level` counts the fabrics below it, for `default_obstacle_distance`; `handles`
    are the numbers of handles by name, -1 for None.
    """
    first = len(assembly.yarns)
    for family, names in zip(patch.families, fabric.yarn_materials, strict=True):
        materials = [material(name) for name in names]
        for line, length in zip(family.pieces.line.tolist(), family.lengths.tolist(), strict=True):
            of_yarn = materials[line % len(materials)]
            distance = fabric.obstacle_distance or default_obstacle_distance(of_yarn.radius, level)
            assembly.yarn(of_yarn, length, family.spacing / fabric.segments_per_crossing, index, fabric.kinematic, distance,
                          family.spacing)
    _add_crossings(assembly, first, fabric, patch, handles)
    _add_ends(assembly, first, fabric, patch, handles)
    if fabric.segments_per_crossing > 1:
        _add_divisions(assembly, first, fabric, patch, handles)
    return first


def default_obstacle_distance(radius: float, level: int) -> float:
    """Return the distance at which obstacles begin to push the yarns of a fabric with `level` fabrics below it [m].

    Layers of a stack coincide. The lowest alone should carry on what lies below it; those above it touch an obstacle
    only where they hang off it, so they come a little nearer to obstacles before these push.
    """
    return radius * 0.9**level


def _add_crossings(
    assembly: YarnAssembly, first: int, fabric: Fabric, patch: Weave, handles: Mapping[str | None, int]
) -> None:
    i, j = patch.crossings()
    warp, u = patch.warps.find(i, (j.astype(float) + 0.5) * patch.warps.spacing)
    weft, v = patch.wefts.find(j, (i.astype(float) + 0.5) * patch.wefts.spacing)
    pinned, handle = np.full(len(i), fabric.kinematic), np.full(len(i), -1)
    for hold in fabric.holds:
        if hold.hold == "clamped":
            index, last = _ENDING[hold.edge]
            family, yarn, along = ((patch.warps, warp, u), (patch.wefts, weft, v))[index]
            # no more than half a spacing from the end, others at least one
            beside = (family.lengths[yarn] - along if last else along) < family.spacing
            held = beside & _ends_at(family, last, hold.extent)[yarn]
            pinned[held], handle[held] = True, handles[hold.handle]
    above = warp_over(_repeat(fabric), i, j)
    of_warp, of_weft = first + warp, first + patch.warps.count + weft
    assembly.crossings(
        np.where(above, of_weft, of_warp), np.where(above, v, u),
        np.where(above, of_warp, of_weft), np.where(above, u, v),
        patch.warps.at(warp, u), patch.normal, fabric.friction,
        # nothing slides in a patch whose shape is given
        PointKind.STITCH if fabric.kinematic else PointKind.CROSSING, pinned, handle,
        crimp=fabric.crimp != "flat", set_as_woven=fabric.crimp == "set",
    )


def _repeat(fabric: Fabric) -> Flags:
    """One repeat of the pattern [wefts, warps], true where the warp is on top."""
    return PATTERNS[fabric.pattern] if isinstance(fabric.pattern, str) else np.array(fabric.pattern, np.bool_)


def _add_ends(
    assembly: YarnAssembly, first: int, fabric: Fabric, patch: Weave, handles: Mapping[str | None, int]
) -> None:
    for index, family in enumerate(patch.families):
        line, yarn = family.pieces.line, np.arange(family.count)
        outermost = (line == 0) | (line == family.lines.count - 1)
        always = fabric.kinematic or fabric.pins == "edges" or (fabric.pins == "corners") & outermost
        for last, u in enumerate((np.zeros(family.count), family.lengths)):
            pinned, handle = np.full(family.count, always), np.full(family.count, -1)
            for hold in fabric.holds:
                if _ENDING[hold.edge] == (index, last):
                    held = _ends_at(family, bool(last), hold.extent)
                    pinned[held], handle[held] = True, handles[hold.handle]
            assembly.lagrangians(first + yarn, u, family.at(yarn, u), pinned, handle)
        first += family.count


def _add_divisions(
    assembly: YarnAssembly, first: int, fabric: Fabric, patch: Weave, handles: Mapping[str | None, int]
) -> None:
    """Add the points between crossings; a clamp holds those between the crossings and the ends that it holds."""
    for index, family in enumerate(patch.families):
        yarn, u = family.divisions(fabric.segments_per_crossing)
        pinned, handle = np.full(len(u), fabric.kinematic), np.full(len(u), -1)
        for hold in fabric.holds:
            of_family, last = _ENDING[hold.edge]
            if hold.hold == "clamped" and of_family == index:
                beyond = u > family.last[yarn] if last else u < family.first[yarn]
                held = beyond & _ends_at(family, last, hold.extent)[yarn]
                pinned[held], handle[held] = True, handles[hold.handle]
        assembly.lagrangians(first + yarn, u, family.at(yarn, u), pinned, handle)
        first += family.count


def _ends_at(family: Family, last: bool, extent: tuple[float, float]) -> Flags:
    """Which yarns have their first (or last) end within part of an edge: each line has its outermost piece there."""
    line, count = family.pieces.line, family.lines.count
    outermost = (np.diff(line, append=count) if last else np.diff(line, prepend=-1)) > 0
    share = (line + 0.5) / count
    return outermost & (extent[0] <= share) & (share <= extent[1])
