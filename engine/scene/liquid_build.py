"""Liquid of a scene as model and state, with what lets it out, takes it away and holds it."""

from dataclasses import replace
from math import radians

import numpy as np

from engine.arrays import Floats
from engine.contact.obstacles import ObstacleKind, Obstacles
from engine.geometry.solids import Solids, inside
from engine.liquid.model import LiquidModel, LiquidState
from engine.liquid.sinks import LiquidSinks
from engine.liquid.sources import LiquidSources
from engine.scene.handles import handle_numbers
from engine.scene.liquid import SIDES, Liquid, LiquidBox, LiquidMesh, LiquidShape
from engine.scene.liquid_bounds import bounds, origin, period
from engine.scene.liquid_materials import known_liquids, liquid_constants, sticks
from engine.scene.liquid_seeding import frame, holds, opening, own_pitch, seeded
from engine.scene.schema import Scene

IDENTITY = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)  # strain of what is not deformed


def build_liquid(scene: Scene, liquid: Liquid, solids: Solids) -> tuple[LiquidModel, LiquidState]:
    """Return the liquid of a scene and how it is at the start, outside of `solids` as they stand then."""
    model = _model(scene, liquid)
    return model, _state(liquid, model, solids)


def build_sources(scene: Scene, liquid: Liquid) -> LiquidSources:
    """Return the nozzles of a scene, their layers as thick as the lattice is wide or, where they cease, fitted to the time."""
    numbers, nozzles = handle_numbers(scene.script), liquid.sources
    place, volume, thickness, layers = [], [], [], []
    for nozzle in nozzles:
        x, area = opening(nozzle, liquid.pitch)
        d, count = liquid.pitch, np.inf
        if nozzle.end is not None:
            column = nozzle.speed * (nozzle.end - nozzle.begin)
            count = max(np.round(column / d), 1.0)
            d = column / count
        place.append(x)
        volume.append(area * d)
        thickness.append(d)
        layers.append(count)
    flow = [frame(np.array(nozzle.direction))[:, 2] for nozzle in nozzles]
    return LiquidSources(
        place=tuple(place),
        volume=np.array(volume, float),
        jitter=np.full(len(nozzles), 0.5 * liquid.jitter * liquid.pitch),
        flow=np.array(flow, float).reshape(-1, 3),
        speed=np.array([nozzle.speed for nozzle in nozzles], float),
        thickness=np.array(thickness, float),
        begin=np.array([nozzle.begin for nozzle in nozzles], float),
        layers=np.array(layers, float),
        handle=np.array([numbers[nozzle.handle] for nozzle in nozzles], np.int64),
        seed=liquid.seed,
    )


def build_sinks(liquid: Liquid) -> LiquidSinks:
    """Return the sinks of a scene."""
    return LiquidSinks(
        np.array([sink.low for sink in liquid.sinks], float).reshape(-1, 3),
        np.array([sink.high for sink in liquid.sinks], float).reshape(-1, 3),
    )


def with_walls(obstacles: Obstacles, liquid: Liquid) -> Obstacles:
    """Return obstacles as liquid meets them: the walls of its tank come after those of the scene."""
    centre, rotation = [], []
    for number, side in enumerate(SIDES):
        k, far = divmod(number, 2)
        if liquid.tank is None or side in liquid.tank.open or "xyz"[k] in liquid.periodic:
            continue
        centre.append(liquid.tank.high if far else liquid.tank.low)
        rotation.append(frame((-1.0 if far else 1.0) * np.eye(3)[k]))
    if not centre:
        return obstacles
    count, surfaces = len(centre), obstacles.surfaces
    if surfaces is not None:
        surfaces = replace(surfaces, surface=surfaces.surface + (None,) * count, shapes=surfaces.shapes + (None,) * count,
                           lattice=np.concatenate([surfaces.lattice, np.zeros((count, 4), np.int64)]))
    return Obstacles(
        kind=np.concatenate([obstacles.kind, np.full(count, ObstacleKind.PLANE)]),
        centre=np.concatenate([obstacles.centre, centre]),
        rotation=np.concatenate([obstacles.rotation, rotation]),
        size=np.concatenate([obstacles.size, np.zeros((count, 3))]),
        friction=np.concatenate([obstacles.friction, np.zeros(count)]),
        handle=None if obstacles.handle is None else np.concatenate([obstacles.handle, np.full(count, -1)]),
        surfaces=surfaces,
    )


def _model(scene: Scene, liquid: Liquid) -> LiquidModel:
    material = known_liquids(scene.liquid_materials)[liquid.material]
    repeats = np.array([round(period(liquid, axis)) if axis in liquid.periodic else 0 for axis in ("x", "y", "z")], np.int64)
    low, high = bounds(scene, liquid)
    around = repeats * liquid.spacing  # what leaves a period is not gone: it is taken back into it
    return LiquidModel(
        *liquid_constants(material),
        spacing=liquid.spacing,
        origin=origin(scene, liquid),
        period=repeats,
        no_slip=sticks(material, liquid.walls),
        low=low - around,
        high=high + around,
    )


def _state(liquid: Liquid, model: LiquidModel, solids: Solids) -> LiquidState:
    parts = [_particles(liquid, i, model, solids) for i in range(len(liquid.initial))]
    x, velocity, volume = (
        np.concatenate([np.zeros((0, *shape)), *values])
        for shape, values in zip(((3,), (3,), ()), zip(*parts, strict=True) if parts else ((),) * 3, strict=True)
    )
    gradients = np.array([_gradient(shape) for shape in liquid.initial]).reshape(-1, 3, 3)
    counts = np.array([len(values) for values, _, _ in parts], np.int64)
    return LiquidState(
        x=x, velocity=velocity, affine=np.repeat(gradients, counts, axis=0), volume=volume,
        strain=np.tile(IDENTITY, (len(x), 1)) if model.elastic else None,
        compression=None if model.incompressible else np.ones(len(x)),
        plastic_strain=np.zeros(len(x)) if model.elastic else None,
        emitted=np.zeros(len(liquid.sources), np.int64),
        drained=np.zeros(1),
    )


def _particles(liquid: Liquid, i: int, model: LiquidModel, solids: Solids) -> tuple[Floats, Floats, Floats]:
    """Places, velocities and volumes of the particles in shape `i` that are in none before it."""
    shape, random = liquid.initial[i], np.random.default_rng((liquid.seed, i))
    x, volume = seeded(shape, own_pitch(liquid, shape), liquid.jitter, random)
    velocity = np.array(shape.velocity) + (x - _middle(shape)) @ _gradient(shape).T
    x = _within_period(model, x)
    free = ~inside(solids, x)
    for earlier in liquid.initial[:i]:
        free &= ~holds(earlier, x)
    return x[free], velocity[free], volume[free]


def _gradient(shape: LiquidShape) -> Floats:
    """Velocity gradient [1/s] of a shape that turns, shape [3, 3]."""
    spin = np.array([radians(rate) for rate in shape.angular_velocity])
    return np.cross(spin, np.eye(3)).T


def _within_period(model: LiquidModel, x: Floats) -> Floats:
    length = np.where(model.period > 0, model.period * model.spacing, np.inf)
    turns = np.floor((x - model.origin) / length)
    return x - np.where(model.period > 0, turns * model.period * model.spacing, 0.0)


def _middle(shape: LiquidShape) -> Floats:
    if isinstance(shape, LiquidBox):
        return 0.5 * (np.array(shape.low) + np.array(shape.high))
    return np.array(shape.position if isinstance(shape, LiquidMesh) else shape.centre)
