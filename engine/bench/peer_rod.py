"""The way of the peer PyElastica through the same rods: Cosserat rods, with shear, by an explicit method of second order."""

from math import ceil, hypot, sqrt

import numpy as np

from engine.arrays import Floats
from engine.bench.rod_problems import LENGTH, RADIUS, RUBBER, SHEAR_FACTOR, RodProblem

NAME = "PyElastica"


def installed() -> bool:
    """Return whether there is the peer."""
    try:
        import elastica  # noqa: F401
    except ImportError:
        return False
    return True


def stable_steps(problem: RodProblem, segments: int, share: float) -> int:
    """Return how many steps of that `share` of the largest stable one a problem takes.

    That is 2 over the highest frequency, in which shear turns sections and the bending of neighbours turns them back.
    """
    segment = LENGTH / (segments + 0.5)
    turning = sqrt(SHEAR_FACTOR * RUBBER.shear / RUBBER.density) / RADIUS
    bending = sqrt(RUBBER.young / RUBBER.density) / segment
    return ceil(problem.duration * hypot(turning, bending) / share)


def swing(problem: RodProblem, segments: int, steps: int) -> Floats:
    """Return the places of the tip after each step, shape [steps, 3] [m]; vertices, clamp and damping are this engine's.

    Raises ImportError where the peer is not installed.
    """
    import elastica

    class Simulator(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.Damping):
        """What the rod takes part in."""

    segment, h = LENGTH / (segments + 0.5), problem.duration / steps
    rod = elastica.CosseratRod.straight_rod(
        segments + 1, np.array([-0.5 * segment, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]),
        segment * (segments + 1), RADIUS, RUBBER.density, youngs_modulus=RUBBER.young, shear_modulus=RUBBER.shear,
    )
    rod.velocity_collection[2, 2:] = problem.speed(rod.position_collection[0, 2:])
    rod.omega_collection[1] = np.diff(rod.velocity_collection[2]) / segment  # sections stay across
    simulator = Simulator()
    simulator.append(rod)
    simulator.constrain(rod).using(elastica.FixedConstraint, constrained_position_idx=(0, 1), constrained_director_idx=(0,))
    simulator.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=np.array([0.0, 0.0, -problem.gravity]))
    simulator.dampen(rod).using(elastica.AnalyticalLinearDamper, uniform_damping_constant=problem.damping, time_step=h)
    simulator.finalize()
    stepper, time, tips = elastica.PositionVerlet(), 0.0, np.empty((steps, 3))
    for step in range(steps):
        time = stepper.step(simulator, time, h)
        tips[step] = rod.position_collection[:, -1]
    return tips
