"""Strands on a slope: Coulomb's law of a strand on a plane, and on two strands that are held."""

from collections.abc import Callable
from math import atan, cos, degrees, radians, sin

import numpy as np

from engine.arrays import Floats
from engine.contact.obstacles import ObstacleKind, ObstacleMotion, Obstacles, motion
from engine.geometry.handles import no_handles
from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandAssembly, StrandMaterial
from engine.strands.model import StrandModel, StrandState
from engine.validate.catalogue import CaseResult, case, timed_rows
from engine.validate.strands import EARTH

RADIUS, LENGTH, VERTICES = 5e-5, 0.02, 12  # [m], [m]
HAIR = StrandMaterial(density=1300.0, young=3e9, shear=1e9, damping=1e-3)  # damped, so that it settles
SUPPORTS = (-0.0049, 0.0051)  # where a strand lies on two others, on no vertex [m]
COEFFICIENTS = (0.3, 0.6, 1.0)
STEEP = 60.0  # [deg]
STEP = 1e-3  # at which the critical angle is sought [s]
SETTLING, SLIDING = 20e-3, 10e-3  # [s]
ANGLE_BAR = 0.2  # [deg]
BRACKET = (5.0, STEEP)  # between which the critical angle is sought [deg]

Scene = tuple[StrandModel, StrandState, ObstacleMotion | None]


@case("contact-incline", bar=0.01, summary="strand on a plane and on strands: slides above tan a = mu with g (sin a - mu cos a)")
def incline(quick: bool) -> CaseResult:
    """Worst relative error of the acceleration at 60 degrees; the critical angle is a condition beside it."""
    coefficients = COEFFICIENTS[1:2] if quick else COEFFICIENTS

    def error(h: float) -> float:
        return max(_acceleration_error(place, mu, h) for place in PLACES.values() for mu in coefficients)

    rows = timed_rows("dt [s]", (2e-3, STEP, STEP / 2), error)
    failures, worst = [], 0.0
    for name, place in PLACES.items():
        for mu in coefficients:
            found, coulomb = critical_angle(place, mu), degrees(atan(mu))
            worst = max(worst, abs(found - coulomb))
            if not abs(found - coulomb) <= ANGLE_BAR:
                failures.append(f"{name}, mu = {mu:g}: slides from {found:.2f} deg on, not from {coulomb:.2f} deg")
    return CaseResult(rows, max(row.error for row in rows), failures=failures,
                      note=f"mu of {coefficients}; critical angles within {worst:.2g} deg")


def critical_angle(place: Callable[[float], Scene], mu: float) -> float:
    """Return the slope [deg] at which a strand begins to slide, by bisection to a twentieth of the bar."""
    still, slides = BRACKET
    while slides - still > ANGLE_BAR / 20:
        angle = 0.5 * (still + slides)
        # faster than a tenth of the bar in slope would make it
        if acceleration(place, mu, angle, STEP) > EARTH * sin(radians(ANGLE_BAR / 10)):
            slides = angle
        else:
            still = angle
    return 0.5 * (still + slides)


def _acceleration_error(place: Callable[[float], Scene], mu: float, h: float) -> float:
    wanted = EARTH * (sin(radians(STEEP)) - mu * cos(radians(STEEP)))
    return abs(acceleration(place, mu, STEEP, h) / wanted - 1.0)


def acceleration(place: Callable[[float], Scene], mu: float, angle: float, h: float) -> float:
    """Return the acceleration [m/s^2] of what is free down a slope of `angle` [deg], which is along x.

    What gravity is across the slope acts first, and alone until the strand has settled: bending vibrations would change what
    presses it on the slope.
    """
    model, state, obstacles = place(mu)
    free = ~model.held[:, 0]
    speed = []
    across, along = -EARTH * cos(radians(angle)), EARTH * sin(radians(angle))
    for gravity, duration in ((np.array([0.0, 0.0, across]), SETTLING), (np.array([along, 0.0, across]), SLIDING)):
        stepper = StrandStepper(model, gravity)
        for _ in range(round(duration / h)):
            report = stepper.step(state, h, obstacles=obstacles)
            if not report.accepted:
                raise RuntimeError(report.reason)
        speed.append(float(np.average(state.velocity[free, 0], weights=model.mass[free])))
    return (speed[1] - speed[0]) / SLIDING


def on_plane(mu: float, direction: int) -> Scene:
    """Return a strand on a plane, along its slope (direction 0) or across it (direction 1)."""
    s = np.linspace(-0.5 * LENGTH, 0.5 * LENGTH, VERTICES)
    assembly = StrandAssembly()
    assembly.strand(_line(s, direction, np.array([0.0, 0.0, RADIUS])), RADIUS, HAIR, friction=mu)
    plane = Obstacles(np.array([ObstacleKind.PLANE]), np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)), np.array([mu]))
    return *assembly.build(), motion(plane, no_handles(), 0.0, 1.0)


def on_strands(mu: float) -> Scene:
    """Return a strand across the slope on two held ones along it."""
    s = np.linspace(-0.5 * LENGTH, 0.5 * LENGTH, VERTICES)
    assembly = StrandAssembly()
    assembly.strand(_line(s, 1, np.array([0.0, 0.0, 2.0 * RADIUS])), RADIUS, HAIR, friction=mu)
    for y in SUPPORTS:
        held = np.ones((VERTICES, 4), np.bool_)
        assembly.strand(_line(s, 0, np.array([0.1 * LENGTH, y, 0.0])), RADIUS, HAIR, friction=mu, held=held)
    return *assembly.build(), None


def _line(s: Floats, axis: int, middle: Floats) -> Floats:
    points = np.tile(middle, (len(s), 1))
    points[:, axis] += s
    return points


PLACES: dict[str, Callable[[float], Scene]] = {
    "along a plane": lambda mu: on_plane(mu, 0), "across a plane": lambda mu: on_plane(mu, 1), "on strands": on_strands,
}
