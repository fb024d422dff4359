"""What a scene may say about time steps: their size, and the knobs of speed against error within them."""

from typing import Annotated, Literal

from pydantic import Field

from engine.liquid.settings import LiquidSettings
from engine.scene.quantities import Count, NotNegative, Part, Positive, Seconds
from engine.strands.settings import StrandSettings
from engine.yarns.settings import YarnSettings


class Step(Part):
    """The time step of all that moves, and the knobs of speed against error of one step of yarns."""

    default: Seconds = 1e-3
    """Time step [s]."""
    min: Seconds = Field(default_factory=lambda step: max(step["default"] / 1024, 1e-9))
    """A job whose step must become shorter than this [s] fails; by default after ten halvings."""
    max: Seconds = Field(default_factory=lambda step: step["default"])
    """The step never grows longer than this [s]; by default no longer than `default`."""
    safety_distance: Annotated[float, Field(gt=0, le=0.45)] = YarnSettings.safety_distance
    """Nodes that come nearer than this, in rest segments, become EIL nodes."""
    constraint_factor: Positive = YarnSettings.constraint_factor
    """Stiffness that holds EIL contacts together, over stretch stiffness / rest segment."""
    gap_tolerance: Positive = YarnSettings.gap_tolerance
    """Gap of EIL contacts that a step may leave, in yarn radii."""
    friction_law: Literal["isotropic", "box"] = YarnSettings.friction_law
    """Friction between two yarns is limited in every direction alike, or (`box`) along each yarn by itself, up to sqrt 2
    too strongly between them."""
    friction_factor: Positive = YarnSettings.friction_factor
    """Stiffness of friction anchors, over stretch stiffness / rest segment."""
    parallel_factor: NotNegative = YarnSettings.parallel_factor
    """Stiffness of contact between neighbouring parallel yarns of a fabric, over stretch stiffness / rest segment."""
    obstacle_factor: Positive = YarnSettings.obstacle_factor
    """Stiffness of contact with obstacles, over stretch stiffness / rest segment."""
    tolerance: Annotated[float, Field(gt=0, le=1)] = YarnSettings.tolerance
    """Residual force that ends Newton's iterations, relative to the force scale of the step."""
    max_newton: Annotated[int, Field(ge=1, le=1000)] = YarnSettings.max_newton
    """Newton iterations after which the step is tried again with half the size."""
    linear_tolerance: Annotated[float, Field(gt=0, lt=1)] = YarnSettings.linear_tolerance
    """Relative residual of the linear solve inside Newton."""
    max_linear: Count = YarnSettings.max_linear
    """Iterations of the linear solve."""
    gauge: Annotated[float, Field(ge=0, le=1)] = YarnSettings.gauge
    """Viscous hold of sliding coordinates, for contacts of parallel yarns."""
    eil: bool = YarnSettings.eil
    """Replace nodes that come too near to each other by EIL nodes; off only to show what then fails."""
    optimal_transition: bool = YarnSettings.optimal_transition
    """Move nodes along the yarn where they change kind, for the smallest jump of energy."""
    separation_time: NotNegative = YarnSettings.separation_time
    """For how long a contact between fabrics pulls, without a break, before it is removed [s]; one step at least."""
    separation_force: NotNegative = YarnSettings.separation_force
    """Pull that counts as pulling, in weights of a rest segment or, where that is more, thousandths of the largest tension:
    layers under tension are not flatter than that. Forces about to count are found to ten times this, or the tolerance."""
    dynamic_contacts: bool = YarnSettings.dynamic_contacts
    """Let contacts of `contacts` that have ended, or lie within their `reach`, begin where yarns would pass through each
    other."""


class StrandStep(Part):
    """The knobs of speed against error of one step of strands; its size is that of `step`."""

    integrator: Literal["euler", "bdf2"] = StrandSettings.integrator
    """Implicit Euler, of first order in the step, or the backward differentiation formula BDF2, of second order at the same cost
    where strands touch nothing; those that do take implicit Euler's step."""
    tolerance: Annotated[float, Field(gt=0, le=1)] = StrandSettings.tolerance
    """Residual force that ends Newton's iterations, relative to the largest weight or force within the strand."""
    max_newton: Annotated[int, Field(ge=1, le=1000)] = StrandSettings.max_newton
    """Newton iterations after which the step is tried again with half the size."""
    contact: Literal["cone", "penalty", "none"] = StrandSettings.contact
    """How strands touch each other and obstacles: without overlap and with Coulomb's law (`cone`), by springs (`penalty`,
    for comparison), or not at all."""
    contact_tolerance: Annotated[float, Field(gt=0, le=1)] = StrandSettings.contact_tolerance
    """Displacement that Coulomb's law may still ask for at the end of a step, over the distance at which strands touch."""
    max_contact_rounds: Annotated[int, Field(ge=1, le=1000)] = StrandSettings.max_contact_rounds
    """Rounds of all contacts with strands as they give way linearly, before strands are solved again."""
    max_rounds: Annotated[int, Field(ge=1, le=1000)] = StrandSettings.max_rounds
    """Rounds of strands and contacts in turn, after which the step is tried again with half the size."""
    penalty_factor: Positive = StrandSettings.penalty_factor
    """Stiffness of contact by springs, over the strands' own stretch stiffness."""
    cohesion: NotNegative = StrandSettings.cohesion
    """Force per length that holds strands together which touch [N/m]."""
    cohesion_reach: NotNegative = StrandSettings.cohesion_reach
    """Distance of their surfaces up to which strands that part are held [m]."""


class LiquidStep(Part):
    """The knobs of speed against error of one step of liquid; its size is that of `step`, and what `courant` leaves of it."""

    courant: Annotated[float, Field(gt=0, le=1.5)] = LiquidSettings.courant
    """Cells of the grid that the fastest particle may cross in a step, at most."""
    pressure_tolerance: Annotated[float, Field(gt=0, lt=1)] = LiquidSettings.pressure_tolerance
    """Residual that ends the solve for pressure, relative to its right-hand side."""
    shear_tolerance: Annotated[float, Field(gt=0, lt=1)] = LiquidSettings.shear_tolerance
    """Residual that ends Newton's iterations under shear stress, relative to that at their start."""
    max_newton: Annotated[int, Field(ge=1, le=1000)] = LiquidSettings.max_newton
    """Newton iterations after which the step is tried again with half the size."""
    max_linear: Count = LiquidSettings.max_linear
    """Iterations of each linear solve."""
    plastic_flow: Literal["implicit", "analytic"] = LiquidSettings.plastic_flow
    """How stress beyond yield relaxes: by implicit Euler, or by the closed form for a strain that is held."""
    shear: Literal["implicit", "explicit"] = LiquidSettings.shear
    """Whether the shear stress of elastic strain acts as it is at the end of a step or at its start; explicit, it needs short
    steps, and walls brake what sticks to them by more than stress does. That of a Newtonian liquid is implicit where needed."""
    pressure: Literal["implicit", "explicit"] = LiquidSettings.pressure
    """The same of pressure; explicit for liquids that have a bulk modulus only."""
    spread: Annotated[float, Field(ge=0, le=1)] = LiquidSettings.spread
    """Share of what particles are too dense or too sparse, that a step mends by moving them; with 0, volume drifts."""
