"""What one reads off a state of liquid: particles with speed, pressure and shear for pictures, and energies."""

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike

from engine.arrays import Flags, Floats, Singles
from engine.liquid.grid import SIDE, Grid, Indices
from engine.liquid.model import LiquidModel, LiquidState


def frame_arrays(model: LiquidModel, state: LiquidState, pressure: Singles) -> dict:
    """Return the arrays of a frame without a surface; `pressure` [P] [Pa] is as of the last step."""
    shear = shear_stress(model, state)
    yield_shear = model.yield_stress / np.sqrt(3.0)
    return dict(
        positions=state.x.astype(np.float32), radius=np.cbrt(0.75 / np.pi * present_volume(state)).astype(np.float32),
        speed=np.linalg.norm(state.velocity, axis=1).astype(np.float32), pressure=pressure, shear=shear.astype(np.float32),
        yielded=_flows(model, shear, yield_shear),
        surface_vertices=np.zeros((0, 3), np.float32), surface_faces=np.zeros((0, 3), np.int32),
    )


def present_volume(state: LiquidState) -> Floats:
    """Return the volumes of particles as they are now [m^3], shape [P]."""
    return state.volume if state.compression is None else state.volume * state.compression


def stressed(strain: Floats, shear_modulus: float) -> Floats:
    """Return the shear stress s = mu dev(b) [Pa] of elastic strains b [P, 6], shape [P, 6] (Fei 2019, eq. 13.9)."""
    s = shear_modulus * strain
    s[:, :3] -= s[:, :3].mean(axis=1)[:, None]
    return s


def shear_stress(model: LiquidModel, state: LiquidState) -> Floats:
    """Return the shear stress that a rheometer would show [Pa], ||s|| / sqrt(2), shape [P].

    Of a Newtonian liquid by the velocity gradient of particles, which have no part of a boundary layer thinner than a cell.
    """
    if state.strain is not None:
        s = stressed(state.strain, model.shear_modulus)
        return np.sqrt(0.5 * (s[:, :3] ** 2).sum(axis=1) + (s[:, 3:] ** 2).sum(axis=1))
    rate = 0.5 * (state.affine + state.affine.transpose(0, 2, 1))
    mean = np.trace(rate, axis1=1, axis2=2) / 3.0
    square = np.einsum("pij,pij->p", rate, rate) - 3.0 * mean**2
    return model.consistency * np.sqrt(np.maximum(square, 0.0) / 2.0)


def energies(model: LiquidModel, state: LiquidState, gravity: ArrayLike) -> dict[str, float]:
    """Return kinetic energy, with that of the affine part, and potential energy (elastic, compression, weight) [J].

    The weight's zero is at the origin. Source: Fei 2019, eqs. 13.4 and 13.5.
    """
    mass = model.density * state.volume
    affine = 0.25 * model.spacing**2 * np.einsum("pij,pij->p", state.affine, state.affine)
    kinetic = 0.5 * float(mass @ (np.einsum("pi,pi->p", state.velocity, state.velocity) + affine))
    potential = -float(mass @ (state.x @ np.asarray(gravity)))
    if state.strain is not None:
        trace = state.strain[:, :3].sum(axis=1)
        potential += 0.5 * model.shear_modulus * float(state.volume @ (trace - 3.0))
    if state.compression is not None:
        j = state.compression
        potential += 0.5 * model.bulk_modulus * float(state.volume @ (0.5 * (j * j - 1.0) - np.log(j)))
    return {"kinetic": kinetic, "potential": potential}


@njit(cache=True, parallel=True)
def of_cells(grid: Grid, x: Floats, row: Indices, values: Floats, result: Singles) -> None:
    """Write for particles at x [P, 3] [m] the number [P] of the cell that each is in, `values` [N] by `row` [B, 64], else 0."""
    for t in prange(len(grid.turn)):
        b = grid.turn[t]
        for p in range(grid.start[b], grid.start[b + 1]):
            cell = 0
            for k in range(3):
                at = int((x[p, k] - grid.origin[k]) / grid.spacing - SIDE * grid.place[b, k])
                cell = SIDE * cell + min(max(at, 0), SIDE - 1)
            n = row[b, cell]
            result[p] = values[n] if n >= 0 else 0.0


def _flows(model: LiquidModel, shear: Floats, yield_shear: float) -> Flags:
    return shear > yield_shear * (1.0 + 1e-9) if model.elastic else np.ones(len(shear), np.bool_)

