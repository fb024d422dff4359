"""What must agree where a scene has strands: materials, curves, grooms, ends."""

from collections.abc import Iterator

import numpy as np

from engine.scene.beside import unread
from engine.scene.curve_files import CURVE_POINT_LIMIT
from engine.scene.materials import known_materials
from engine.scene.problems import Problem
from engine.scene.schema import Plane, Scene
from engine.scene.strand_groups import MOST_VERTICES, Groom
from engine.scene.surfaces import ground

LEAST_EDGE = 1e-9  # [m]
LEAST_TURN = 4  # vertices that a curl needs in one turn
_OF_YARNS = ("bending_stiffness", "bending_modulus", "shear_stiffness")


def _materials(scene: Scene) -> Iterator[Problem]:
    """Strands bend as their section does."""
    known = known_materials(scene.materials)
    for i, group in enumerate(scene.strands):
        for name in _OF_YARNS:
            if getattr(known[group.material], name):
                yield Problem(f"strands[{i}].material", f"{group.material} has a {name}, but how strands bend follows from "
                              "radius and Young's modulus", f"materials without {', '.join(_OF_YARNS)}")


def _curves(scene: Scene) -> Iterator[Problem]:
    """Curves are there, have edges of some length, and as many vertices as a strand may have."""
    if sum(len(curve) for group in scene.strands for curve in group.curves) > CURVE_POINT_LIMIT:
        yield Problem("strands", "their curves have too many points", f"at most {CURVE_POINT_LIMIT:,} in all")
        return
    for i, group in enumerate(scene.strands):
        if group.file is not None:
            yield unread(f"strands[{i}].file", "curves")
        for k, curve in enumerate(group.curves):
            path, length = f"strands[{i}].curves[{k}]", np.linalg.norm(np.diff(np.array(curve), axis=0), axis=1)
            for point in np.flatnonzero(length < LEAST_EDGE):
                yield Problem(f"{path}[{point + 1}]", "repeats the point before it", "a point elsewhere")
            if group.vertices is None and not 3 <= len(curve) <= MOST_VERTICES:
                yield Problem(path, f"has {len(curve)} points", f"3 to {MOST_VERTICES}, or vertices of the group")
            elif group.vertices is not None and length.sum() < group.vertices * LEAST_EDGE:
                yield Problem(path, f"is {length.sum():.3g} m long", f"at least {LEAST_EDGE:g} m for each vertex")


def _grooms(scene: Scene) -> Iterator[Problem]:
    """Grooms have a surface to grow on, ways that lead somewhere, and vertices enough for their curls."""
    bodies = {obstacle.name: obstacle for obstacle in scene.obstacles if obstacle.name is not None}
    for i, group in enumerate(scene.strands):
        groom, path = group.groom, f"strands[{i}].groom"
        if groom is None:
            continue
        problems = list(_ways(groom, path))
        body = bodies[groom.on] if groom.on is not None else None
        if isinstance(body, Plane):
            problems.append(Problem(f"{path}.on", f"{groom.on} is a plane, which has no end", "another obstacle, or rectangle"))
        elif not problems and ground(groom, body) is None:
            problems.append(Problem(f"{path}.facing", "is where the surface nowhere faces", "another way, or a larger within"))
        if groom.clump is not None and groom.clump.count > groom.count:
            problems.append(Problem(f"{path}.clump.count", f"is {groom.clump.count}", f"at most the {groom.count} strands"))
        edge = groom.length * (1.0 - groom.length_spread) / group.vertex_counts[0]
        if edge < LEAST_EDGE:
            problems.append(Problem(f"{path}.length", "is too short for its vertices", f"at least {LEAST_EDGE:g} m for each"))
        if groom.curl is not None:
            turn = np.hypot(groom.curl.pitch, 2.0 * np.pi * groom.curl.radius) / edge
            if turn < LEAST_TURN:
                problems.append(Problem(f"{path}.curl", f"has {turn:.2g} vertices in a turn",
                                        f"{LEAST_TURN} at least: more vertices, or wider curls"))
        yield from problems


def _ways(groom: Groom, path: str) -> Iterator[Problem]:
    for name in ("facing", "direction"):
        way = getattr(groom, name)
        if way is not None and not np.linalg.norm(way) > LEAST_EDGE:
            yield Problem(f"{path}.{name}", "has no length", "a way that leads somewhere")


def _ends(scene: Scene) -> Iterator[Problem]:
    """Handles carry held ends only, and two clamps hold different vertices."""
    for i, group in enumerate(scene.strands):
        ends = dict(zip(("root", "tip"), group.ends(None), strict=True))
        for name, end in ends.items():
            if end.hold == "free" and end.handle is not None:
                yield Problem(f"strands[{i}].{name}.handle", "carries a free end", "a pinned or clamped end")
        if all(end.hold == "clamped" for end in ends.values()) and min(group.vertex_counts) < 4:
            yield Problem(f"strands[{i}].tip.hold", "is clamped where the root is, with three vertices in all",
                          "pinned, or more vertices")


strand_problems = (_materials, _curves, _grooms, _ends)  # each relies on those before it
