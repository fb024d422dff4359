"""Yarns of fabrics over the upper edges of a box."""

from collections.abc import Iterator
from math import radians, sin

import numpy as np

from engine.arrays import Floats, Ints
from engine.scene.materials import known_materials
from engine.scene.placement import axes
from engine.scene.plan import Lines, cross_in_plan, sine_of_angle
from engine.scene.schema import Box, Fabric, Scene
from engine.scene.weave import Weave
from engine.yarns.assembly import YarnAssembly

_LEAST_SINE = sin(radians(10))  # a yarn that runs along an edge does not bend over it


def edge_crossings(
    scene: Scene, box: Box, fabric: Fabric, patch: Weave
) -> Iterator[tuple[int, Lines, Ints, Floats]]:
    """Yield a family of the patch (0 warps, 1 wefts), an edge, and yarns [n] over it at u [n] [m].

    Yields nothing for boxes without `edges` and for fabrics that do not lie on the box: free to move, parallel to its
    top, and no more than the thickness of their thickest yarn above it.
    """
    x, y, up = axes(box.rotation).T
    centre, half = np.array(box.position), np.array(box.size) / 2
    height = up @ (patch.warps.lines.start - centre) - half[2]
    known = known_materials(scene.materials)
    thickness = max(2 * known[name].radius for names in fabric.yarn_materials for name in names)
    flat = abs(up @ patch.normal) > 1 - 1e-9
    if not box.edges or fabric.kinematic or not flat or not 0 <= height <= thickness:
        return
    top = centre + half[2] * up
    for direction, outward, half_length, distance in ((y, x, half[1], half[0]), (x, y, half[0], half[1])):
        for side in (-1.0, 1.0):
            start = top + side * distance * outward - half_length * direction
            edge = Lines(start, direction, np.zeros(3), 1, 2 * half_length)
            for index, family in enumerate(patch.families):
                if abs(sine_of_angle(family.lines, edge, up)) >= _LEAST_SINE:
                    crossings = cross_in_plan(family.lines, edge, up)
                    i, j = crossings.lines()
                    yarn, u = family.find(i, crossings.distances(i, j)[0])
                    yield index, edge, yarn[yarn >= 0], u[yarn >= 0]


def add_edges(
    assembly: YarnAssembly, scene: Scene, box: Box, fabric: Fabric, patch: Weave, first_yarn: int, friction: float
) -> None:
    """Add a point wherever a yarn of the fabric crosses an upper edge of the box, at the yarn's own height."""
    for index, edge, yarn, u in edge_crossings(scene, box, fabric, patch):
        family = patch.families[index]
        x = family.at(yarn, u)
        from_start = ((x - edge.start) @ edge.along)[:, None] * edge.along
        middle = x - from_start + 0.5 * edge.length * edge.along
        assembly.edges(first_yarn + index * patch.warps.count + yarn, u, x, edge.along, friction, middle,
                       0.5 * edge.length)
