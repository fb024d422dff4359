"""The shapes that a mesh changes to: the same triangles with their vertices elsewhere."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from engine.arrays import Floats
from engine.contact.surface import Surface
from engine.scene.beside import unread
from engine.scene.problems import Problem
from engine.scene.schema import Mesh

SHAPE_VERTEX_LIMIT = 50_000  # of all shapes of a scene together, so that the scene with them in it can be read again
STRIDE = 0.25  # of its narrowest side by which a vertex may go from one shape to the next: distances are blended in between


def later_shapes(mesh: Mesh, surface: Surface) -> list[tuple[float, Floats]]:
    """Return times [s] and vertices [V, 3] [m] of the shapes, vertices as in the `surface` that its own ones became."""
    if not mesh.shapes:
        return []
    _, origin = cKDTree(np.array(mesh.vertices)).query(surface.vertices)
    return [(shape.time, np.array(shape.vertices)[origin]) for shape in mesh.shapes]


def shape_problems(path: str, mesh: Mesh) -> Iterator[Problem]:
    """Yield what is wrong with the shapes of a mesh whose own vertices and faces are there."""
    before, last = np.array(mesh.vertices), 0.0
    narrowest = float(np.ptp(before, axis=0).min())
    for k, shape in enumerate(mesh.shapes):
        here = f"{path}.shapes[{k}]"
        if shape.time <= last:
            yield Problem(f"{here}.time", f"is {shape.time:g} s", f"more than {last:g} s: they ascend from that of the mesh")
        last = shape.time
        if shape.file is not None and shape.vertices:
            yield Problem(f"{here}.file", "stands beside vertices", "one of both")
        elif shape.file is not None:
            yield unread(f"{here}.file", "vertices")
        elif len(shape.vertices) != len(mesh.vertices):
            yield Problem(f"{here}.vertices", f"has {len(shape.vertices)}", f"the {len(mesh.vertices)} of the mesh, moved")
        else:
            now = np.array(shape.vertices)
            edge = now[np.array(mesh.faces)]
            if not np.linalg.norm(np.cross(edge[:, 1] - edge[:, 0], edge[:, 2] - edge[:, 0]), axis=1).min() > 0.0:
                yield Problem(f"{here}.vertices", "leave a triangle without area", "the triangles of the mesh, none collapsed")
            if (way := np.linalg.norm(now - before, axis=1).max()) > STRIDE * narrowest:
                yield Problem(f"{here}.vertices", f"one is {way:.3g} m from where it was in the shape before",
                              f"at most {STRIDE * narrowest:.3g} m, {STRIDE:g} of the mesh's narrowest side: shapes in between, "
                              "or a handle for what moves as a whole")
            before = now
