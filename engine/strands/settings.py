"""Numerical settings of the strand method, all of them knobs of speed against error."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class StrandSettings:
    """Knobs of one implicit step of discrete elastic rods in contact."""

    integrator: Literal["euler", "bdf2"] = "euler"  # BDF2 is of second order in the step where strands touch nothing
    tolerance: float = 1e-6  # residual force that ends Newton, relative to the largest weight or force within the strand
    max_newton: int = 50  # iterations after which the step is tried again with half the size
    contact: Literal["cone", "penalty", "none"] = "cone"  # how strands touch each other and obstacles
    contact_tolerance: float = 1e-2  # displacement that Coulomb's law still asks for, over the distance of touch
    max_contact_rounds: int = 10  # of solving all contacts under linear strands, before strands are solved again
    max_rounds: int = 20  # of strands and contacts in turn, after which the step is tried again with half the size
    penalty_factor: float = 1.0  # stiffness of contact by penalties, over the strands' own stretch stiffness
    cohesion: float = 0.0  # force that holds strands together which touch [N/m]
    cohesion_reach: float = 0.0  # distance of their surfaces up to which strands that part are held [m]
