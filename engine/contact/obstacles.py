"""Rigid obstacles as packed signed distances."""

from dataclasses import dataclass
from enum import IntEnum

from engine.yarns.model import Floats, Ints


class ObstacleKind(IntEnum):
    """Shape of an obstacle in its own frame."""

    PLANE = 0  # solid below its local z = 0
    BOX = 1  # size: half extents
    SPHERE = 2  # size[0]: radius
    CYLINDER = 3  # axis along local z; size[0]: radius, size[1]: half height


@dataclass(frozen=True)
class Obstacles:
    """K obstacles; friction is theirs, and acts on whatever touches them."""

    kind: Ints  # ObstacleKind, shape [K]
    centre: Floats  # [m], shape [K, 3]
    rotation: Floats  # columns are the local axes in the world, shape [K, 3, 3]
    size: Floats  # [m], shape [K, 3]
    friction: Floats  # Coulomb coefficient, shape [K]
