"""What compiling ahead does for liquids: the kernels that a step calls last, from pressure to particles."""

import numpy as np

from engine.geometry.solids import Solids
from engine.liquid import evolve
from engine.liquid.boundary_layer import extend
from engine.liquid.grid import sorted_grid
from engine.liquid.mirror import reflect
from engine.liquid.model import LiquidModel
from engine.liquid.observe import of_cells
from engine.liquid.pressure import accelerate, divergence, pressure, spread_outwards, wet_cells
from engine.liquid.shear import add_diagonal, add_elastic_impulse, add_tangent_impulse, add_viscous_impulse
from engine.liquid.surface import deep
from engine.liquid.transfer import to_particles
from engine.liquid.walls import open_space, push_out


def rest_of_a_step(elastic: bool, no_slip: bool) -> None:
    """Take a few particles from their velocities on the grid to their next places, `elastic` ones with their strain.

    Those that stick have a boundary layer, and shear stress by a solve.
    """
    nowhere = np.full(3, np.inf)
    model = LiquidModel(1.0, np.inf, float(elastic), 0.0, 1.0, 1.0, 0.0, np.inf, 0.0, 1.0, np.zeros(3), np.zeros(3, np.int64),
                        False, -nowhere, nowhere)
    x, velocity, affine, volume = np.full((8, 3), 0.5), np.zeros((8, 3)), np.zeros((8, 3, 3)), np.ones(8)
    grid, _ = sorted_grid(model, x)
    u, filled, nothing = grid.faces(), np.ones_like(grid.cells()), open_space(grid)
    if elastic:
        strain, tangent, force = np.tile([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], (8, 1)), np.zeros((8, 8), np.float32), grid.faces()
        add_tangent_impulse(grid, x, tangent, u, force)
        add_elastic_impulse(grid, x, volume, strain, u, 1.0, 1.0, 0.0, 1.0, 1.0, True, force, tangent)
        evolve.flow(affine, 1.0, 1.0, 0.0, 1.0, 1.0, 0.0, True, strain, volume.copy())
        add_diagonal(grid, x, tangent[:, 6], force)
    elif no_slip:
        add_viscous_impulse(grid, x, volume, u, 1.0, 1.0, grid.faces())
        add_diagonal(grid, x, volume.astype(np.float32), grid.faces())
    plane = Solids(np.zeros(1, np.int64), np.full((1, 3), -9.0), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 4), np.int64),
                   np.zeros(0))
    push_out(grid, nothing.near, nothing.distance, 1.0, plane, plane, 1.0, x, velocity)
    evolve.wrap(x, model.origin, model.spacing * model.period)
    evolve.shift(grid, x, u)
    evolve.move(x, velocity, 0.0)
    if no_slip:
        extend(grid, plane, plane, 1.0, nothing.mirror.face, u, u, u)
    to_particles(grid, x, u, velocity, affine)
    wet = wet_cells(grid, filled, filled, nothing.open, np.ones_like(u), np.broadcast_to(0.0, filled.shape), model.period)
    p, _ = pressure(wet, np.ones(len(wet.cell)), 1e-3, 2)
    of_cells(grid, x, wet.row, p, np.zeros(8, np.float32))
    deep(grid, filled, nothing.distance)
    solved = accelerate(grid, wet.row, p, np.zeros(len(p)), filled, nothing.open, np.broadcast_to(1.0, u.shape), u)
    spread_outwards(grid, u, solved, u)
    reflect(nothing.mirror, u)
    divergence(grid, u, nothing.open, nothing.speed, wet.cell[:0], p)
