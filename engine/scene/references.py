"""What must agree between the parts of a scene: names, numbers of points, places, times."""

from collections.abc import Iterator, Sequence

import numpy as np

from engine.scene.liquid_materials import known_liquids
from engine.scene.liquid_problems import liquid_problems
from engine.scene.materials import known_materials
from engine.scene.meshes import mesh_problems
from engine.scene.outline import touching_sides
from engine.scene.problems import Problem, unknown_name
from engine.scene.rods import held_points, piece_lengths, piece_segments
from engine.scene.schema import Box, Fabric, Handle, Obstacle, Scene, Yarn
from engine.scene.stack import COUNTED, levels
from engine.scene.strand_groups import Strands
from engine.scene.strand_problems import strand_problems
from engine.scene.weave import weave


def disagreements(scene: Scene) -> Iterator[Problem]:
    """Yield what does not agree; later checks rely on earlier ones, so the first kind of problems ends the search."""
    checks = (_step, _components, _names, _known_names, _lines, _held_points, _ends, _patches, _outlines, _stacks, _edges,
              _crimp, mesh_problems, *strand_problems, *liquid_problems)
    for check in checks:
        problem = None
        for problem in check(scene):
            yield problem
        if problem:
            return


def _step(scene: Scene) -> Iterator[Problem]:
    step = scene.step
    if step.min > step.default:
        yield Problem("step.min", f"is {step.min:g}", f"at most the default step, {step.default:g}")
    if step.max < step.default:
        yield Problem("step.max", f"is {step.max:g}", f"at least the default step, {step.default:g}")


def _components(scene: Scene) -> Iterator[Problem]:
    """There is something to simulate, of one kind."""
    yarns = bool(scene.yarns or scene.fabrics)
    if scene.liquid is not None and (yarns or scene.strands):
        yield Problem("liquid", "stands beside yarns, fabrics or strands: they do not feel each other yet",
                      "liquid and obstacles only")
    elif scene.liquid is not None and scene.contact.self:
        yield Problem("contact.self", "is about yarns only", "false")
    elif scene.liquid is None and not yarns and not scene.strands:
        yield Problem("", "has nothing to simulate", "a liquid, or one entry at least in strands, yarns or fabrics")
    elif yarns and scene.strands:
        yield Problem("strands", "stand beside yarns or fabrics: the two do not feel each other yet", "one of both in a scene")
    elif scene.strands and scene.contact.self:
        yield Problem("contact.self", "is about yarns only", "false: strands have strand_step.contact")


def _names(scene: Scene) -> Iterator[Problem]:
    kinds: dict[str, Sequence[Yarn | Fabric | Strands | Obstacle | Handle]] = {
        "yarns": scene.yarns, "fabrics": scene.fabrics, "strands": scene.strands, "obstacles": scene.obstacles,
        "script.handles": scene.script.handles,
    }
    for path, parts in kinds.items():
        first: dict[str, int] = {}
        for i, part in enumerate(parts):
            if part.name is not None and first.setdefault(part.name, i) != i:
                other = f"{path}[{first[part.name]}]"
                yield Problem(f"{path}[{i}].name", f"is the name of {other} too", "a name of its own")


def _known_names(scene: Scene) -> Iterator[Problem]:
    known = {
        "material": list(known_materials(scene.materials)),
        "liquid material": list(known_liquids(scene.liquid_materials)), "fabric": [fabric.name for fabric in scene.fabrics],
        "yarn": [yarn.name for yarn in scene.yarns], "handle": [handle.name for handle in scene.script.handles],
        "obstacle": [obstacle.name for obstacle in scene.obstacles if obstacle.name is not None],
    }
    sets = {kind: set(names) for kind, names in known.items()}
    for kind, path, name in _references(scene):
        if name is not None and name not in sets[kind]:
            yield unknown_name(path, name, known[kind], kind)


def _references(scene: Scene) -> Iterator[tuple[str, str, str | None]]:
    """Yield the kind of thing, the path of the reference and the name for all references by name."""
    for i, yarn in enumerate(scene.yarns):
        yield "material", f"yarns[{i}].material", yarn.material
        yield "handle", f"yarns[{i}].start.handle", yarn.start.handle
        yield "handle", f"yarns[{i}].end.handle", yarn.end.handle
    for i, obstacle in enumerate(scene.obstacles):
        yield "handle", f"obstacles[{i}].handle", obstacle.handle
    for i, crossing in enumerate(scene.crossings):
        yield "yarn", f"crossings[{i}].lower.yarn", crossing.lower.yarn
        yield "yarn", f"crossings[{i}].upper.yarn", crossing.upper.yarn
    for i, fabric in enumerate(scene.fabrics):
        yield "material", f"fabrics[{i}].material", fabric.material
        yield "material", f"fabrics[{i}].weft_material", fabric.weft_material
        for family, names in (("warp", fabric.warp_stripes), ("weft", fabric.weft_stripes)):
            yield from (("material", f"fabrics[{i}].{family}_stripes[{k}]", name) for k, name in enumerate(names))
        for k, hold in enumerate(fabric.holds):
            yield "handle", f"fabrics[{i}].holds[{k}].handle", hold.handle
    for i, contact in enumerate(scene.contacts):
        yield "fabric", f"contacts[{i}].lower", contact.lower
        yield "fabric", f"contacts[{i}].upper", contact.upper
    for i, group in enumerate(scene.strands):
        yield "material", f"strands[{i}].material", group.material
        yield "handle", f"strands[{i}].root.handle", group.root.handle
        yield "handle", f"strands[{i}].tip.handle", group.tip.handle
        if group.groom is not None:
            yield "obstacle", f"strands[{i}].groom.on", group.groom.on
    if scene.liquid is not None:
        yield "liquid material", "liquid.material", scene.liquid.material
        for i, nozzle in enumerate(scene.liquid.sources):
            yield "handle", f"liquid.sources[{i}].handle", nozzle.handle


def _lines(scene: Scene) -> Iterator[Problem]:
    """Pieces of lines have a length, keyframes a time between them."""
    for i, yarn in enumerate(scene.yarns):
        for piece in np.flatnonzero(piece_lengths(yarn) < 1e-9):
            yield Problem(f"yarns[{i}].points[{piece + 1}]", "repeats the point before it", "a point elsewhere")
    for i, handle in enumerate(scene.script.handles):
        for k in np.flatnonzero(np.diff([keyframe.time for keyframe in handle.keyframes]) <= 0):
            path = f"script.handles[{i}].keyframes[{k + 1}].time"
            yield Problem(path, "is not after the keyframe before it", f"more than {handle.keyframes[k].time:g}")


def _held_points(scene: Scene) -> Iterator[Problem]:
    """Eyelets and crossings hold points between the ends, each one only, and crossings points that coincide."""
    yarns = {yarn.name: yarn for yarn in scene.yarns}
    held: set[tuple[str, int]] = set()
    for name, point, path in _uses_of_points(scene):
        if point >= len(yarns[name].points) - 1:
            inner = len(yarns[name].points) - 2
            yield Problem(path, f"is no point between the ends of {name}", f"1 to {inner}" if inner else "none")
        elif (name, point) in held:
            yield Problem(path, f"point {point} of {name} has an eyelet or a crossing already", "another point")
        else:
            held.add((name, point))
    for i, crossing in enumerate(scene.crossings):
        sides = crossing.lower, crossing.upper
        if sides[0].yarn == sides[1].yarn:
            yield Problem(f"crossings[{i}].upper.yarn", "is the lower yarn too", "another yarn")
        elif all((side.yarn, side.point) in held for side in sides):
            lower, upper = (yarns[side.yarn].points[side.point] for side in sides)
            if not np.allclose(lower, upper, rtol=1e-12, atol=1e-9):
                yield Problem(f"crossings[{i}]", f"its points do not coincide: {list(lower)} and {list(upper)}",
                              "two points at one place")


def _uses_of_points(scene: Scene) -> Iterator[tuple[str, int, str]]:
    """Yield yarn, point and path for everything that holds a point of a yarn."""
    for i, yarn in enumerate(scene.yarns):
        for k, eyelet in enumerate(yarn.eyelets):
            yield yarn.name, eyelet.point, f"yarns[{i}].eyelets[{k}].point"
    for i, crossing in enumerate(scene.crossings):
        yield crossing.lower.yarn, crossing.lower.point, f"crossings[{i}].lower.point"
        yield crossing.upper.yarn, crossing.upper.point, f"crossings[{i}].upper.point"


def _ends(scene: Scene) -> Iterator[Problem]:
    """Handles carry held ends only, and a clamp has a fixed point beside the end to hold."""
    held = held_points(scene)
    for i, yarn in enumerate(scene.yarns):
        segments = piece_segments(yarn)
        beside = {"start": (segments[0], 1), "end": (segments[-1], len(yarn.points) - 2)}
        for name, hold in (("start", yarn.start), ("end", yarn.end)):
            if hold.handle is not None and hold.hold == "free":
                yield Problem(f"yarns[{i}].{name}.handle", "carries a free end", "a pinned or clamped end")
            count, point = beside[name]
            if hold.hold == "clamped" and count == 1 and (len(segments) == 1 or point in held[yarn.name]):
                yield Problem(f"yarns[{i}].{name}.hold", "has no fixed point beside the end to clamp",
                              "pinned, or more segments")


def _patches(scene: Scene) -> Iterator[Problem]:
    """Rows of a pattern are of one length, holds hold something, and nothing that is held already."""
    for i, fabric in enumerate(scene.fabrics):
        rows = () if isinstance(fabric.pattern, str) else fabric.pattern
        for k, row in enumerate(rows):
            if len(row) != len(rows[0]):
                yield Problem(f"fabrics[{i}].pattern[{k}]", f"has {len(row)} entries", f"{len(rows[0])}, as the first row")
        if fabric.kinematic and fabric.holds:
            yield Problem(f"fabrics[{i}].holds", "hold a patch that stays where it is", "none where kinematic is true")
        for k, hold in enumerate(fabric.holds):
            if hold.extent[0] > hold.extent[1]:
                yield Problem(f"fabrics[{i}].holds[{k}].extent", "ends before it begins", "the smaller share first")


def _outlines(scene: Scene) -> Iterator[Problem]:
    """Outlines are simple polygons, on grids that can be looked at crossing by crossing, and leave some of them."""
    looked_at = 0
    for i, fabric in enumerate(scene.fabrics):
        if fabric.outline is None:
            continue
        path = f"fabrics[{i}].outline"
        looked_at += fabric.warps * fabric.wefts
        if looked_at > COUNTED:
            yield Problem(path, f"cuts grids of more than {COUNTED:,} crossings in all", "a grid no larger than the outline")
            return
        meeting = next(touching_sides(np.array(fabric.outline)), None)
        if meeting:
            yield Problem(path, "its sides from points {} and {} meet".format(*meeting), "a polygon that nowhere meets itself")
        elif not weave(fabric).crossing_count:
            yield Problem(path, "leaves no crossing of the patch", "an outline around one crossing at least")


def _stacks(scene: Scene) -> Iterator[Problem]:
    """Fabrics in contact lie in one plane, each pair once, and nothing lies above itself."""
    fabrics = {fabric.name: fabric for fabric in scene.fabrics}
    patches = {fabric.name: weave(fabric) for fabric in scene.fabrics}
    pairs: set[tuple[str, str]] = set()
    for i, contact in enumerate(scene.contacts):
        path, pair = f"contacts[{i}]", (contact.lower, contact.upper)
        if pair in pairs:
            yield Problem(path, "gives the same two fabrics as an entry before it", "one entry for each pair")
        pairs.add(pair)
        below, above = patches[contact.lower], patches[contact.upper]
        height = below.normal @ (above.warps.lines.start - below.warps.lines.start)
        spacing = min(fabrics[contact.lower].spacings)
        if abs(below.normal @ above.normal) < 1 - 1e-9 or abs(height) > 1e-6 * spacing:
            yield Problem(path, f"{contact.lower} and {contact.upper} do not lie in one plane",
                          "fabrics in one plane: the model neglects the thickness of layers")
    if scene.contacts and max(levels(scene.fabrics, scene.contacts).values()) >= len(scene.fabrics):
        yield Problem("contacts", "put a fabric above itself", "stacks from lower to upper")


def _crimp(scene: Scene) -> Iterator[Problem]:
    """Fabrics with crimp are whole rectangles that move, away from what has nodes of its own on their yarns."""
    stacked = {name for contact in scene.contacts for name in (contact.lower, contact.upper)}
    edges = any(isinstance(box, Box) and box.edges for box in scene.obstacles)
    for i, fabric in enumerate(scene.fabrics):
        reasons = {
            "a scene with edges that yarns slide over": edges, "a fabric in contact with another": fabric.name in stacked,
            "a fabric with an outline": fabric.outline is not None, "a kinematic fabric": fabric.kinematic,
        }
        if fabric.crimp != "flat" and any(reasons.values()):
            where = next(reason for reason, holds in reasons.items() if holds)
            yield Problem(f"fabrics[{i}].crimp", f"is {fabric.crimp} in {where}", "flat")


def _edges(scene: Scene) -> Iterator[Problem]:
    """Edges that yarns slide over stay where they are."""
    for i, box in enumerate(scene.obstacles):
        if isinstance(box, Box) and box.edges and box.handle is not None:
            yield Problem(f"obstacles[{i}].handle", "carries a box with edges", "edges: false, or no handle")
