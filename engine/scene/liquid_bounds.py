"""The box that a scene's liquid may be in, where its grid begins, and what repeats."""

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
    low, high = _around(scene, liquid)
    reach = REACH * max(float(np.max(high - low)), LEAST_SIZE * liquid.spacing)
    return low - reach, high + reach


def origin(scene: Scene, liquid: Liquid) -> Floats:
    """Return a corner of cells [m], shape [3]: the low one of tank, bounds or, without both, of what is there at first."""
    return _around(scene, liquid)[0] if liquid.repeated is None else np.array(liquid.repeated.low)


def _around(scene: Scene, liquid: Liquid) -> tuple[Floats, Floats]:
    """Corners of the box around all that is there at the start, each of shape [3] [m]."""
    regions = [(region.low, region.high) for region in (*liquid.sinks, liquid.tank) if region is not None]
    around = [
        *((np.array(low), np.array(high)) for low, high in regions),
        *(_around_shape(shape) for shape in liquid.initial),
        *((np.array(nozzle.centre),) * 2 for nozzle in liquid.sources),
        *(_around_obstacle(obstacle) for obstacle in scene.obstacles),
    ]
    return np.min([low for low, _ in around], axis=0), np.max([high for _, high in around], axis=0)


def _around_shape(shape: LiquidShape) -> tuple[Floats, Floats]:
    if isinstance(shape, LiquidBox):
        return np.array(shape.low), np.array(shape.high)
    if isinstance(shape, LiquidBall):
        return np.array(shape.centre) - shape.radius, np.array(shape.centre) + shape.radius
    if isinstance(shape, LiquidCylinder):
        half = _half_cylinder(np.array(shape.axis), shape.radius, shape.height)
        return np.array(shape.centre) - half, np.array(shape.centre) + half
    corners = np.array(shape.position) + surface_of(shape).vertices @ axes(shape.rotation).T
    return corners.min(axis=0), corners.max(axis=0)


def _around_obstacle(obstacle: Obstacle) -> tuple[Floats, Floats]:
    frame, half = axes(obstacle.rotation), np.zeros(3)  # of a plane, nothing but the place that it is given by
    if isinstance(obstacle, Box):
        half = np.abs(frame) @ np.array(obstacle.size) / 2
    elif isinstance(obstacle, Sphere):
        half = np.full(3, obstacle.radius)
    elif isinstance(obstacle, Cylinder):
        half = _half_cylinder(frame[:, 2], obstacle.radius, obstacle.height)
    elif isinstance(obstacle, Mesh):
        corners = np.array(obstacle.position) + surface_of(obstacle).vertices @ frame.T
        return corners.min(axis=0), corners.max(axis=0)
    return np.array(obstacle.position) - half, np.array(obstacle.position) + half


def _half_cylinder(axis: Floats, radius: float, height: float) -> Floats:
    """Half lengths [m] of the box around a cylinder along `axis` [3], shape [3]."""
    along = np.abs(axis) / np.linalg.norm(axis)
    return radius * np.sqrt(np.maximum(1.0 - along**2, 0.0)) + 0.5 * height * along
