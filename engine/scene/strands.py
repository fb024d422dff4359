"""Strands of a scene as model and state."""

from math import pi

import numpy as np

from engine.arrays import Flags, Floats, Ints
from engine.contact.obstacles import Obstacles
from engine.contact.surface_roots import SurfaceRoots, rooted
from engine.scene.groom import at_even_distances, grown
from engine.scene.handles import handle_numbers
from engine.scene.materials import Material, known_materials
from engine.scene.schema import Scene
from engine.scene.strand_groups import StrandHold, Strands
from engine.strands.assembly import StrandAssembly, StrandMaterial
from engine.strands.model import StrandModel, StrandState

_GRIPPED = {"free": 0, "pinned": 1, "clamped": 2}  # vertices that an end holds
PARALLEL = 1e-6  # sine of the angle below which a normal does not say what is across a strand


def build_strands(scene: Scene) -> tuple[StrandModel, StrandState, Floats | None]:
    """Return all strands, group after group, and their drag: force over velocity of each vertex [N s/m], shape [V], or None."""
    assembly, known, handles = StrandAssembly(), known_materials(scene.materials), handle_numbers(scene.script)
    bodies = {obstacle.name: obstacle for obstacle in scene.obstacles if obstacle.name is not None}
    handle_of: list[Ints] = []
    for index, group in enumerate(scene.strands):
        material = known[group.material]
        body = bodies[group.groom.on] if group.groom is not None and group.groom.on is not None else None
        root, tip = group.ends(None if body is None else body.handle)
        if group.groom is not None:
            curves = list(grown(group.groom, body, group.vertex_counts[0], group.widest(material.radius)))
        else:
            curves = [_curve(points, group.vertices) for points in group.curves]
        for x in curves:
            held, handle = _ends(len(x), root, tip, handles)
            assembly.strand(x, _semi_axes(x, group, material.radius), strand_material(material, group.width_ratio),
                            _normal(x, group), _straight(x) if group.rest == "straight" else None, held,
                            group=index, friction=group.friction)
            handle_of.append(handle)
    model, state = assembly.build()
    model = model._replace(handle=np.concatenate(handle_of))  # root and tip may have different ones
    damping = np.array([known[group.material].mass_damping for group in scene.strands])
    of_vertex = np.repeat(damping[model.group], np.diff(model.start))
    return model, state, of_vertex * model.mass if of_vertex.any() else None


def roots_on_changing_bodies(
    scene: Scene, model: StrandModel, state: StrandState, obstacles: Obstacles
) -> tuple[SurfaceRoots, ...]:
    """Return what bodies that change their shape hold: the roots of grooms on them which no handle of their own carries."""
    number = {obstacle.name: o for o, obstacle in enumerate(scene.obstacles)}
    of_strand, found = model.group, []
    for index, group in enumerate(scene.strands):
        o = number.get(group.groom.on) if group.groom is not None and group.groom.on is not None else None
        if o is None or not getattr(scene.obstacles[o], "shapes", ()) or group.root.handle is not None:
            continue
        gripped = _GRIPPED[group.ends(None)[0].hold or "free"]
        root = np.repeat(model.start[:-1][of_strand == index], gripped)
        vertex = root + np.tile(np.arange(gripped), len(root) // max(gripped, 1))
        found.append(rooted(obstacles, o, state.x, root, vertex))
    return tuple(found)


def strand_material(material: Material, width_ratio: float = 1.0) -> StrandMaterial:
    """Return what the engine takes of a material, whose figures per length are of a section of that width."""
    area = pi * material.radius**2 * width_ratio
    density, young = material.volume_density, material.youngs_modulus
    if material.linear_density is not None:
        density = material.linear_density / area
    if material.stretch_stiffness is not None:
        young = material.stretch_stiffness / area
    assert density is not None and young is not None  # the validator saw to it
    return StrandMaterial(density, young, young / (2.0 * (1.0 + material.poisson_ratio)), material.stretch_damping)


def _curve(points: tuple[tuple[float, float, float], ...], vertices: int | None) -> Floats:
    x = np.array(points, float)
    return x if vertices is None else at_even_distances(x, vertices)


def _semi_axes(x: Floats, group: Strands, radius: float) -> Floats:
    """Semi-axes of the edges, as thick as the strand is in their middle, shape [n-1, 2] [m]."""
    length = np.linalg.norm(np.diff(x, axis=0), axis=1)
    middle = (np.cumsum(length) - 0.5 * length) / length.sum()
    thick = radius * (1.0 + (group.tip_ratio - 1.0) * middle)
    return np.column_stack([thick, group.width_ratio * thick])


def _normal(x: Floats, group: Strands) -> Floats | None:
    if group.normal is None:
        return None
    normal, edge = np.array(group.normal), x[1] - x[0]
    across = np.linalg.norm(np.cross(normal, edge)) > PARALLEL * np.linalg.norm(normal) * np.linalg.norm(edge)
    return normal if across else None


def _straight(x: Floats) -> Floats:
    """A straight strand with edges as long as those through `x` [n, 3], along the first one."""
    length = np.linalg.norm(np.diff(x, axis=0), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(length)])
    return x[0] + arc[:, None] * (x[1] - x[0]) / length[0]


def _ends(count: int, root: StrandHold, tip: StrandHold, handles: dict[str | None, int]) -> tuple[Flags, Ints]:
    """What is held of `count` vertices and the edges behind them, shape [count, 4], and by which handles, shape [count]."""
    held, handle = np.zeros((count, 4), np.bool_), np.full(count, -1)
    for end, from_end, edge in ((root, np.arange(count), 0), (tip, np.arange(count)[::-1], count - 2)):
        gripped = from_end[: _GRIPPED[end.hold or "free"]]
        held[gripped, :3], handle[gripped] = True, handles[end.handle]
        held[edge, 3] |= end.hold == "clamped"
    return held, handle
