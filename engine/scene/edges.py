"""Yarns of fabrics over the upper edges of a box."""

from collections.abc import Iterator
from math import radians, sin

import numpy as np

from engine.scene.materials import known_materials
from engine.scene.placement import axes
from engine.scene.plan import Lines, PlanCrossings, cross_in_plan, sine_of_angle
from engine.scene.schema import Box, Fabric, Scene
from engine.scene.weave import weave
from engine.yarns.assembly import YarnAssembly

_LEAST_SINE = sin(radians(10))  # a yarn that runs along an edge does not bend over it


def edge_crossings(scene: Scene, box: Box, fabric: Fabric) -> Iterator[tuple[int, Lines, PlanCrossings]]:
    """Yield a family of the fabric (0 warps, 1 wefts), an edge, and where the family crosses the edge in plan view.

    Yields nothing for boxes without `edges` and for fabrics that do not lie on the box: free to move, parallel to its
    top, and no more than the thickness of their warps above it.
    """
    patch, (x, y, up) = weave(fabric), axes(box.rotation).T
    centre, half = np.array(box.position), np.array(box.size) / 2
    height = up @ (patch.warps.start - centre) - half[2]
    thickness = 2 * known_materials(scene.materials)[fabric.material].radius
    flat = abs(up @ patch.normal) > 1 - 1e-9
    if not box.edges or fabric.kinematic or not flat or not 0 <= height <= thickness:
        return
    top = centre + half[2] * up
    for direction, outward, half_length, distance in ((y, x, half[1], half[0]), (x, y, half[0], half[1])):
        for side in (-1.0, 1.0):
            start = top + side * distance * outward - half_length * direction
            edge = Lines(start, direction, np.zeros(3), 1, 2 * half_length)
            for family, lines in enumerate(patch.families):
                if abs(sine_of_angle(lines, edge, up)) >= _LEAST_SINE:
                    yield family, edge, cross_in_plan(lines, edge, up)


def add_edges(
    assembly: YarnAssembly, scene: Scene, box: Box, fabric: Fabric, first_yarn: int, friction: float
) -> None:
    """Add a point wherever a yarn of the fabric crosses an upper edge of the box, at the yarn's own height."""
    patch = weave(fabric)
    for family, edge, crossings in edge_crossings(scene, box, fabric):
        lines = patch.families[family]
        i, j = crossings.lines()
        u = np.clip(crossings.distances(i, j)[0], 0.0, lines.length)
        assembly.edges(first_yarn + family * fabric.warps + i, u, lines.at(i, u), edge.along, friction)
