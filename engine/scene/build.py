"""A scene as what steppers work on: models, states, obstacles, handles, settings."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from engine.arrays import Floats
from engine.contact.obstacles import ObstacleKind, Obstacles, posed
from engine.contact.surface import packed
from engine.geometry.handles import Handles
from engine.liquid.settings import LiquidSettings
from engine.scene.handles import handle_numbers, scripted_handles
from engine.scene.meshes import contact_reach, sampled_mesh
from engine.scene.placement import axes
from engine.scene.schema import Box, Cylinder, Mesh, Obstacle, Scene, Sphere
from engine.scene.size import SizeEstimate, estimate
from engine.strands.settings import StrandSettings
from engine.yarns.settings import YarnSettings

if TYPE_CHECKING:  # kernels are imported only for the components that a scene has
    from engine.contact.sphere_packing import Collisions
    from engine.contact.surface_roots import SurfaceRoots
    from engine.liquid.model import LiquidModel, LiquidState
    from engine.liquid.sinks import LiquidSinks
    from engine.liquid.sources import LiquidSources
    from engine.strands.model import StrandModel, StrandState
    from engine.yarns.model import YarnModel, YarnState

__all__ = ["Built", "SizeEstimate", "build", "estimate"]


@dataclass(frozen=True)
class Built:
    """Everything that a run needs; states are at time zero. What the scene does not have is None."""

    yarns: "YarnModel | None"
    state: "YarnState | None"  # of the yarns
    collisions: "Collisions | None"  # None where yarns meet at points only
    settings: YarnSettings
    strands: "StrandModel | None"
    strand_state: "StrandState | None"
    strand_drag: Floats | None  # force over velocity, of vertices [N s/m], shape [V]; None where nothing drags
    strand_settings: StrandSettings
    strand_roots: "tuple[SurfaceRoots, ...]"  # held by bodies that change their shape
    liquid: "LiquidModel | None"
    liquid_state: "LiquidState | None"
    liquid_settings: LiquidSettings
    liquid_obstacles: Obstacles  # those of the scene, and the walls of the tank
    sources: "LiquidSources | None"  # of the liquid
    sinks: "LiquidSinks | None"  # of the liquid
    handles: Handles
    obstacles: Obstacles
    gravity: Floats  # [m/s^2], shape [3]


def build(scene: Scene) -> Built:
    """Build a scene that `load_scene` accepted."""
    yarns = state = collisions = strands = strand_state = strand_drag = None
    liquid = liquid_state = sources = sinks = None
    handles = scripted_handles(scene.script)
    obstacles = liquid_obstacles = _obstacles(scene)
    strand_roots: tuple[SurfaceRoots, ...] = ()
    if scene.yarns or scene.fabrics:
        from engine.scene.yarns import build_yarns

        yarns, state, collisions = build_yarns(scene)
    if scene.strands:
        from engine.scene.strands import build_strands, roots_on_changing_bodies

        strands, strand_state, strand_drag = build_strands(scene)
        strand_roots = roots_on_changing_bodies(scene, strands, strand_state, obstacles)
    if scene.liquid is not None:
        from engine.scene.liquid_build import build_liquid, build_sinks, build_sources, with_walls

        liquid_obstacles = with_walls(obstacles, scene.liquid)
        liquid, liquid_state = build_liquid(scene, scene.liquid, posed(liquid_obstacles, handles, 0.0))
        sources, sinks = build_sources(scene, scene.liquid), build_sinks(scene.liquid)
    return Built(
        yarns=yarns,
        state=state,
        collisions=collisions,
        settings=YarnSettings(**scene.step.model_dump(exclude={"default", "min", "max"})),
        strands=strands,
        strand_state=strand_state,
        strand_drag=strand_drag,
        strand_settings=StrandSettings(**scene.strand_step.model_dump()),
        strand_roots=strand_roots,
        liquid=liquid,
        liquid_state=liquid_state,
        liquid_settings=LiquidSettings(**scene.liquid_step.model_dump()),
        liquid_obstacles=liquid_obstacles,
        sources=sources,
        sinks=sinks,
        handles=handles,
        obstacles=obstacles,
        gravity=np.array(scene.gravity),
    )


def _obstacles(scene: Scene) -> Obstacles:
    obstacles, numbers = scene.obstacles, handle_numbers(scene.script)
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
