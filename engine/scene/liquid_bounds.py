"""The box that a scene's liquid may be in, and what of it repeats."""

import numpy as np

from engine.arrays import Floats
from engine.scene.liquid import Axis, Liquid, LiquidBall, LiquidBox, LiquidCylinder, LiquidShape
from engine.scene.meshes import surface_of
from engine.scene.placement import axes
from engine.scene.schema import Box, Cylinder, Mesh, Obstacle, Scene, Sphere

REACH = 20.0  # of the box by default, in sizes of what is there at the start
LEAST_SIZE = 16.0  # cells that what is there is large at least


def period(liquid: Liquid, axis: Axis) -> float:
    """Return after how many cells the world repeats along an axis that is periodic."""
    assert liquid.repeated is not None  # the scene was refused otherwise
    k = "xyz".index(axis)
    return (liquid.repeated.high[k] - liquid.repeated.low[k]) / liquid.spacing


def bounds(scene: Scene, liquid: Liquid) -> tuple[Floats, Floats]:
    """Return the corners of the box beyond which liquid is removed [m], each of shape [3]."""
    if liquid.bounds is not None:
        return np.array(liquid.bounds.low), np.array(liquid.bounds.high)
    regions = [(region.low, region.high) for region in (*liquid.sinks, liquid.tank) if region is not None]
    around = [
        *((np.array(low), np.array(high)) for low, high in regions),
        *(_around_shape(shape) for shape in liquid.initial),
        *((np.array(nozzle.centre),) * 2 for nozzle in liquid.sources),
        *(_around_obstacle(obstacle) for obstacle in scene.obstacles),
    ]
    low, high = np.min([a for a, _ in around], axis=0), np.max([b for _, b in around], axis=0)
    reach = REACH * max(float(np.max(high - low)), LEAST_SIZE * liquid.spacing)
    return low - reach, high + reach


def _around_shape(shape: LiquidShape) -> tuple[Floats, Floats]:
    if isinstance(shape, LiquidBox):
        return np.array(shape.low), np.array(shape.high)
    if isinstance(shape, LiquidBall):
        return np.array(shape.centre) - shape.radius, np.array(shape.centre) + shape.radius
    if isinstance(shape, LiquidCylinder):
        half = float(np.hypot(shape.radius, 0.5 * shape.height))
        return np.array(shape.centre) - half, np.array(shape.centre) + half
    corners = np.array(shape.position) + surface_of(shape).vertices @ axes(shape.rotation).T
    return corners.min(axis=0), corners.max(axis=0)


def _around_obstacle(obstacle: Obstacle) -> tuple[Floats, Floats]:
    half = 0.0
    if isinstance(obstacle, Box):
        half = 0.5 * float(np.linalg.norm(obstacle.size))
    elif isinstance(obstacle, Sphere):
        half = obstacle.radius
    elif isinstance(obstacle, Cylinder):
        half = float(np.hypot(obstacle.radius, 0.5 * obstacle.height))
    elif isinstance(obstacle, Mesh):
        half = float(np.linalg.norm(surface_of(obstacle).vertices, axis=1).max())
    return np.array(obstacle.position) - half, np.array(obstacle.position) + half
