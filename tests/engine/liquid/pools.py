"""Liquids to test with: models, particles on lattices, solids that hold them, and where the cells of a grid are."""

import numpy as np

from engine.geometry.signed_distance import PLANE
from engine.geometry.solids import Solids
from engine.liquid.grid import CELLS, SIDE
from engine.liquid.model import LiquidModel, LiquidState
from engine.liquid.transfer import to_grid

SPACING = 0.01
FOAM = {"density": 80.0, "shear_modulus": 300.0, "yield_stress": 30.0, "consistency": 8.0, "flow_index": 0.5}
CREAM = FOAM | {"bulk_modulus": 1e5}
UNSTRAINED = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)


def liquid(**changes) -> LiquidModel:
    """Water that sees no end of the world, but for what is said."""
    whole = {
        "density": 1000.0, "bulk_modulus": np.inf, "shear_modulus": 0.0, "yield_stress": 0.0, "consistency": 0.0,
        "flow_index": 1.0, "surface_tension": 0.0, "tearing_strain": np.inf, "recovery_rate": 0.0, "spacing": SPACING,
        "origin": np.zeros(3), "period": np.zeros(3, np.int64), "no_slip": False, "low": np.full(3, -1e9),
        "high": np.full(3, 1e9),
    } | changes
    return LiquidModel(**whole | {"period": np.array(whole["period"], np.int64)})


def lattice(low, high, pitch=SPACING / 2):
    """Places in the middles of cubes that fill a box, shape [P, 3]."""
    axes = [a + pitch * (np.arange(round((b - a) / pitch)) + 0.5) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def particles(model: LiquidModel, x, volume=(SPACING / 2) ** 3, velocity=0.0) -> LiquidState:
    """Particles at x [P, 3] that are not strained."""
    count = len(x)
    return LiquidState(
        x=np.array(x, float), velocity=np.broadcast_to(velocity, (count, 3)).astype(float), affine=np.zeros((count, 3, 3)),
        volume=np.broadcast_to(volume, count).astype(float), strain=np.tile(UNSTRAINED, (count, 1)) if model.elastic else None,
        compression=None if model.incompressible else np.ones(count), plastic_strain=np.zeros(count) if model.elastic else None,
        emitted=np.zeros(0, np.int64), drained=np.zeros(1),
    )


def on_grid(grid, x, volume, density=1.0, velocity=None):
    """Mass and momentum of faces and filled shares of cells, of particles of one volume sorted on their grid."""
    mass, momentum, filled, count = grid.faces(), grid.faces(), grid.cells(), len(x)
    velocity = np.zeros((count, 3)) if velocity is None else velocity
    to_grid(grid, x, velocity, np.zeros((count, 3, 3)), np.full(count, volume), density, 0.0, 0.0, np.zeros((0, 6)),
            mass, momentum, filled)
    return mass, momentum, filled


def planes(*sides) -> Solids:
    """Solids behind planes, each given by a point and a normal that points away from the solid."""
    centre = np.array([point for point, _ in sides], float).reshape(-1, 3)
    rotation = np.empty((len(sides), 3, 3))
    for o, (_, normal) in enumerate(sides):
        n = np.array(normal, float) / np.linalg.norm(normal)
        along = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
        along /= np.linalg.norm(along)
        rotation[o] = np.stack([along, np.cross(n, along), n], axis=1)
    return Solids(np.full(len(sides), PLANE), centre, rotation, np.zeros((len(sides), 3)), np.zeros((len(sides), 4), np.int64),
                  np.zeros(0))


def tank(low, high, sides="xXyYz") -> Solids:
    """Planes on sides of a box: those at low x, y, z in small letters, at high ones in capitals."""
    normals = dict(zip("xyzXYZ", np.concatenate([np.eye(3), -np.eye(3)]), strict=True))
    return planes(*((low if side.islower() else high, normals[side]) for side in sides))


def cells_of(grid):
    """Coordinates of all cells, shape [B, 64, 3]."""
    c = np.arange(CELLS)
    return SIDE * grid.place[:, None, :].astype(np.int64) + np.stack([c // 16, c // 4 % 4, c % 4], axis=1)


def centres(grid):
    """Middles of all cells [m], shape [B, 64, 3]."""
    return grid.origin + grid.spacing * (cells_of(grid) + 0.5)


def face_centres(grid, axis):
    """Middles of the faces across an axis [m], shape [B, 64, 3]."""
    return centres(grid) - 0.5 * grid.spacing * np.eye(3)[axis]


def on_faces(grid, field):
    """Components of a velocity field x [..., 3] -> [..., 3] at the faces that carry them, shape [3, B, 64]."""
    return np.stack([field(face_centres(grid, axis))[..., axis] for axis in range(3)])
