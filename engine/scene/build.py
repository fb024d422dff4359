"""A scene as what steppers work on: models, states, obstacles, handles, settings."""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Floats
from engine.contact.obstacles import ObstacleKind, Obstacles
from engine.contact.sphere_packing import Collisions, collisions_at_start
from engine.contact.surface import packed
from engine.scene.edges import add_edges
from engine.scene.fabrics import add_fabric
from engine.scene.materials import known_materials, yarn_material
from engine.scene.meshes import contact_reach, sampled_mesh
from engine.scene.placement import axes
from engine.scene.rods import add_rods
from engine.scene.schema import Box, Cylinder, Mesh, Obstacle, Scene, Script, Sphere
from engine.scene.size import SizeEstimate, estimate
from engine.scene.stack import add_contacts, levels
from engine.scene.weave import weave
from engine.yarns.assembly import YarnAssembly, YarnMaterial
from engine.yarns.handles import Handles
from engine.yarns.model import YarnModel, YarnState
from engine.yarns.settings import YarnSettings

__all__ = ["Built", "SizeEstimate", "build", "estimate"]


@dataclass(frozen=True)
class Built:
    """Everything that a run needs; `state` is at time zero."""

    yarns: YarnModel | None
    state: YarnState | None
    handles: Handles
    obstacles: Obstacles
    collisions: Collisions | None  # None where yarns meet at points only
    gravity: Floats  # [m/s^2], shape [3]
    settings: YarnSettings


def build(scene: Scene) -> Built:
    """Build a scene that `load_scene` accepted. Single yarns come first, then fabrics, each in their order."""
    model, state = _yarns(scene).build()
    return Built(
        yarns=model,
        state=state,
        handles=_handles(scene.script),
        obstacles=_obstacles(scene),
        collisions=_collisions(scene, model, state),
        gravity=np.array(scene.gravity),
        settings=YarnSettings(**scene.step.model_dump(exclude={"default", "min", "max"})),
    )


def _yarns(scene: Scene) -> YarnAssembly:
    assembly = YarnAssembly()
    known = known_materials(scene.materials)

    def material(name: str) -> YarnMaterial:
        return yarn_material(known[name])

    handles = _handle_numbers(scene.script)
    add_rods(assembly, scene, material, handles)
    level = levels(scene.fabrics, scene.contacts)
    patches = {fabric.name: weave(fabric) for fabric in scene.fabrics}
    first_yarn = {}
    for index, fabric in enumerate(scene.fabrics):
        first_yarn[fabric.name] = add_fabric(
            assembly, index, fabric, patches[fabric.name], material, level[fabric.name], handles)
    for contact in scene.contacts:
        lower, upper = contact.lower, contact.upper
        add_contacts(assembly, contact, patches[lower], patches[upper], first_yarn[lower], first_yarn[upper])
    # over an edge, a fabric slides on the fabric below it, the lowest one on the box
    below = {contact.upper: contact.friction for contact in scene.contacts}
    for box in scene.obstacles:
        if isinstance(box, Box):
            for fabric in scene.fabrics:
                friction = below.get(fabric.name, box.friction)
                add_edges(assembly, scene, box, fabric, patches[fabric.name], first_yarn[fabric.name], friction)
    return assembly


def _handles(script: Script) -> Handles:
    keyframes = [keyframe for handle in script.handles for keyframe in handle.keyframes]
    counts = [len(handle.keyframes) for handle in script.handles]
    return Handles(
        start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        time=np.array([keyframe.time for keyframe in keyframes], float),
        offset=np.array([keyframe.offset for keyframe in keyframes], float).reshape(-1, 3),
        angles=np.array([keyframe.rotation for keyframe in keyframes], float).reshape(-1, 3),
        pivot=np.array([handle.pivot for handle in script.handles], float).reshape(-1, 3),
    )


def _collisions(scene: Scene, model: YarnModel, state: YarnState) -> Collisions | None:
    if not scene.contact.self:
        return None
    contact = scene.contact
    return collisions_at_start(model, state, contact.thickness, contact.stiffness, contact.spacing)


def _handle_numbers(script: Script) -> dict[str | None, int]:
    """Numbers of handles by name, -1 for None."""
    return {None: -1, **{handle.name: number for number, handle in enumerate(script.handles)}}


def _obstacles(scene: Scene) -> Obstacles:
    obstacles, numbers = scene.obstacles, _handle_numbers(scene.script)
    handle = np.array([numbers[obstacle.handle] for obstacle in obstacles], np.int64)
    rotation = np.array([axes(obstacle.rotation) for obstacle in obstacles], float).reshape(-1, 3, 3)
    meshes = [sampled_mesh(obstacle, contact_reach(scene)) if isinstance(obstacle, Mesh) else None for obstacle in obstacles]
    middle = np.array([np.zeros(3) if mesh is None else mesh.middle for mesh in meshes]).reshape(-1, 3)
    size = [_size(obstacle) if mesh is None else mesh.size for obstacle, mesh in zip(obstacles, meshes, strict=True)]
    return Obstacles(
        kind=np.array([ObstacleKind[obstacle.shape.upper()] for obstacle in obstacles], np.int64),
        centre=np.array([obstacle.position for obstacle in obstacles], float).reshape(-1, 3)
        + np.einsum("oij,oj->oi", rotation, middle),
        rotation=rotation,
        size=np.array(size, float).reshape(-1, 3),
        friction=np.array([obstacle.friction for obstacle in obstacles], float),
        handle=handle if np.any(handle >= 0) else None,
        surfaces=packed(meshes),
    )


def _size(obstacle: Obstacle) -> tuple[float, float, float]:
    """Numbers that `Obstacles.size` holds for each shape."""
    if isinstance(obstacle, Box):
        x, y, z = obstacle.size
        return x / 2, y / 2, z / 2
    if isinstance(obstacle, Sphere):
        return obstacle.radius, 0.0, 0.0
    if isinstance(obstacle, Cylinder):
        return obstacle.radius, obstacle.height / 2, 0.0
    return 0.0, 0.0, 0.0
