"""What a scene's liquid is (`LiquidModel`, which stays) and how it is (`LiquidState`, which changes).

Symmetric tensors have their six entries in the order xx, yy, zz, yz, xz, xy. Stresses are those of the thesis: shear stress
s = mu dev(b), which yields at ||s|| = sqrt(2/3) tau_Y and flows by its eq. 13.13; scenes may say what a rheometer measured.
"""

from dataclasses import dataclass
from math import isinf
from typing import NamedTuple

from engine.arrays import Floats, Ints


class LiquidModel(NamedTuple):
    """One liquid and the grid that it moves on. Limits are exact: what is absent is infinite or zero, not large or small."""

    density: float  # at rest [kg/m^3]
    bulk_modulus: float  # kappa [Pa], inf where the liquid is incompressible
    shear_modulus: float  # mu [Pa], 0 where it is Newtonian or inviscid: then nothing keeps an elastic strain
    yield_stress: float  # tau_Y of von Mises [Pa]
    consistency: float  # eta [Pa s^n]; of a Newtonian liquid eta/2 is its viscosity
    flow_index: float  # n
    surface_tension: float  # [N/m]
    tearing_strain: float  # plastic strain beyond which it bears no tension, inf where it never tears
    recovery_rate: float  # at which the plastic strain is forgotten [1/s]
    spacing: float  # of the grid's cells [m]
    origin: Floats  # a corner of cells [m], shape [3]
    period: Ints  # cells after which space repeats along each axis: a multiple of 8, or 4; 0 where it does not, shape [3]
    no_slip: bool  # at solids
    low: Floats  # what leaves the box from `low` to `high` [m] is removed, shape [3]
    high: Floats  # [m], shape [3]

    @property
    def incompressible(self) -> bool:
        """Whether volume never changes."""
        return isinf(self.bulk_modulus)

    @property
    def elastic(self) -> bool:
        """Whether particles keep an elastic strain."""
        return self.shear_modulus > 0.0


@dataclass
class LiquidState:
    """All that changes in time, of P particles; a checkpoint is exactly these arrays, without those that are None."""

    x: Floats  # places [m], shape [P, 3]
    velocity: Floats  # [m/s], shape [P, 3]
    affine: Floats  # velocity gradient, rows are components of velocity [1/s], shape [P, 3, 3]
    volume: Floats  # at rest [m^3], shape [P]
    strain: Floats | None  # volume-preserving left Cauchy-Green strain of the elastic part, shape [P, 6]
    compression: Floats | None  # J, volume over volume at rest, shape [P]
    plastic_strain: Floats | None  # accumulated, and forgotten at the rate of recovery, shape [P]
    emitted: Ints  # layers of particles that each source has let out so far, shape [E]
    drained: Floats  # volume at rest that left through sinks and out of the box [m^3], shape [1]
