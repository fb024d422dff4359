"""Transfers between particles and the grid: what they must conserve, and the fields that they must not change."""

import numpy as np

from engine.arrays import Floats
from engine.liquid.grid import CELLS, SIDE, Grid, sorted_grid
from engine.liquid.model import LiquidModel
from engine.liquid.transfer import to_grid, to_particles
from engine.scene.liquid_materials import LiquidMaterial
from engine.validate.catalogue import CaseResult, case, timed_rows
from engine.validate.liquids import liquid

COUNTS = (1, 10, 1000, 100_000)  # of particles
SPACING, PER_CELL = 0.02, 8.0  # [m]; particles
RUNS = 3  # of each count, other particles in each


@case("liq-transfer", bar=1e-12, summary="mass, momenta and affine fields, from particles to the grid and back")
def transfer(quick: bool) -> CaseResult:
    """Worst relative error of what faces have from particles, at random and of many sizes, and particles from faces."""
    rows = timed_rows("particles", COUNTS[:3] if quick else COUNTS, error)
    return CaseResult(rows, max(row.error for row in rows))


def error(count: float) -> float:
    """Return the worst error over several seeds."""
    return max(max(conserved(int(count), seed), of_affine_field(int(count), seed)) for seed in range(RUNS))


def conserved(count: int, seed: int) -> float:
    """Return by how much mass, momentum and angular momentum change on their way, of particles that have nothing in common.

    They are relative to the sum of what single particles have.
    """
    random = np.random.default_rng(seed)
    model, x, volume = _particles(count, random)
    velocity, affine = random.normal(size=(count, 3)), random.normal(size=(count, 3, 3)) / SPACING
    grid, order = sorted_grid(model, x)
    x, volume = x[order], volume[order]
    mass = model.density * volume
    before = _momenta(mass, x, velocity, affine)
    size = np.abs(mass[:, None] * velocity).sum(), np.abs(mass[:, None] * np.cross(x, velocity)).sum()
    of_faces, u = _faces(grid, model, x, volume, velocity, affine)
    on_grid = _momenta_of_faces(grid, of_faces, u)
    to_particles(grid, x, u, velocity, affine)
    after = _momenta(mass, x, velocity, affine)
    lost = [np.abs(of_faces.sum(axis=(1, 2)) / mass.sum() - 1.0).max()]
    for there in (on_grid, after):
        lost += [np.abs(a - b).max() / scale for a, b, scale in zip(there, before, size, strict=True)]
    return float(max(lost))


def of_affine_field(count: int, seed: int) -> float:
    """Return how far an affine field of velocity is from itself after the way to the grid and back, relative to its largest."""
    random = np.random.default_rng(seed)
    model, x, volume = _particles(count, random)
    gradient, middle = random.normal(size=(3, 3)) / SPACING, random.normal(size=3)
    grid, order = sorted_grid(model, x)
    x, volume = x[order], volume[order]
    field = middle + x @ gradient.T
    velocity, affine = field.copy(), np.tile(gradient, (count, 1, 1))
    _, u = _faces(grid, model, x, volume, velocity, affine)
    to_particles(grid, x, u, velocity, affine)
    largest = np.abs(field).max()
    return float(max(np.abs(velocity - field).max(), SPACING * np.abs(affine - gradient).max()) / largest)


def _particles(count: int, random: np.random.Generator) -> tuple[LiquidModel, Floats, Floats]:
    """Particles of up to ten times the volume of others, in a cube about the origin."""
    side = SPACING * max(np.cbrt(count / PER_CELL), 1.0)
    x = random.uniform(-0.5 * side, 0.5 * side, (count, 3))
    return liquid(LiquidMaterial(density=1000.0), SPACING), x, SPACING**3 / PER_CELL * random.uniform(0.2, 2.0, count)


def _faces(grid: Grid, model: LiquidModel, x: Floats, volume: Floats, velocity: Floats, affine: Floats) -> tuple[Floats, Floats]:
    """Mass [kg] and velocity [m/s] of faces [3, B, 64]."""
    mass, momentum, filled = grid.faces(), grid.faces(), grid.cells()
    to_grid(grid, x, velocity, affine, volume, model.density, 0.0, 0.0, np.zeros((0, 6)), mass, momentum, filled)
    return mass, np.divide(momentum, mass, out=momentum, where=mass > 0.0)


def _momenta(mass: Floats, x: Floats, velocity: Floats, affine: Floats) -> tuple[Floats, Floats]:
    """Momentum and angular momentum of particles [3]: m x cross v, and m D sum of c_a cross e_a of the affine part."""
    turning = np.cross(affine, np.eye(3)).sum(axis=1)  # row a of the gradient is c_a
    angular = mass @ np.cross(x, velocity) + 0.25 * SPACING**2 * mass @ turning
    return mass @ velocity, angular


def _momenta_of_faces(grid: Grid, mass: Floats, u: Floats) -> tuple[Floats, Floats]:
    """Momentum and angular momentum [3] of faces, each of which has a component of velocity only."""
    cell = np.arange(CELLS)
    corner = SIDE * grid.place[:, None, :] + np.stack([cell // 16, cell // SIDE % SIDE, cell % SIDE], axis=1)
    angular = np.zeros(3)
    for axis in range(3):
        centre = grid.origin + grid.spacing * (corner + 0.5 * (1.0 - np.eye(3)[axis]))
        angular += np.einsum("bc,bck->k", mass[axis] * u[axis], np.cross(centre, np.eye(3)[axis]))
    return (mass * u).sum(axis=(1, 2)), angular
