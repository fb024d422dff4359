"""Numerical settings of the liquid method, all of them knobs of speed against error."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class LiquidSettings:
    """Knobs of one step of particles and grid."""

    courant: float = 1.0  # cells that the fastest particle may cross in a step: u h / dx
    pressure_tolerance: float = 1e-5  # residual of the pressure, relative to its right-hand side
    shear_tolerance: float = 1e-3  # residual of the momentum under shear stress, relative to that at the start
    max_newton: int = 10  # iterations after which the step is tried again with half the size
    max_linear: int = 200  # iterations of each linear solve
    plastic_flow: Literal["implicit", "analytic"] = "implicit"  # how stress beyond yield relaxes in a step
    shear: Literal["implicit", "explicit"] = "implicit"  # when in the step shear stress acts: at its end or its start
    pressure: Literal["implicit", "explicit"] = "implicit"  # the same of pressure; that of the incompressible is implicit
    spread: float = 0.5  # of what particles are too dense or too sparse, that a step mends, whatever its size
