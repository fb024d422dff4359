"""Numerical settings of the yarn method, all of them knobs of speed against error."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class YarnSettings:
    """Knobs of one implicit Euler step of Eulerian-on-Lagrangian rods."""

    safety_distance: float = 0.1  # EoL nodes keep this far apart, in rest segments (Sánchez-Banderas 2020, sec. 4.1)
    constraint_factor: float = 3.0  # k_c of EIL contacts over k_s / rest segment (sec. 4.2 uses 1000)
    gap_tolerance: float = 5e-4  # gap of EIL contacts that is left, in yarn radii
    friction_law: Literal["isotropic", "box"] = "isotropic"  # limits of two yarns: on their slip, or one along each
    friction_factor: float = 0.1  # stiffness of friction anchors over k_s / rest segment
    parallel_factor: float = 1.0  # stiffness of contact of parallel yarns of a fabric over k_s / rest segment
    obstacle_factor: float = 1.0  # stiffness of obstacle contact over k_s / rest segment
    tolerance: float = 1e-2  # residual force that ends Newton, relative to the force scale of the step
    max_newton: int = 30  # iterations after which the step is tried again with half the size
    linear_tolerance: float = 3e-3  # relative residual of the linear solve inside Newton
    max_linear: int = 2000  # iterations of the linear solve
    gauge: float = 1e-5  # viscous hold of u over h k_s / rest segment, for the null modes of parallel contact
    eil: bool = True  # replace offending EoL nodes; off only to show what then fails
    optimal_transition: bool = False  # move u at transitions as Appendix A of Sánchez-Banderas 2020 says
    separation_time: float = 3e-3  # for which a contact between fabrics pulls before it is removed [s]
    separation_force: float = 1.0  # pull that counts as pulling, in weights of a rest segment or 1/1000 of the largest tension
    dynamic_contacts: bool = False  # contacts between fabrics begin where yarns would pass through each other
