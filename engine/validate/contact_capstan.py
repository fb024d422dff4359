"""A strand over a fixed cylinder, pulled at one end until it slips: the capstan."""

from math import cos, exp, pi, sin

import numpy as np

from engine.arrays import Floats
from engine.contact.obstacles import ObstacleKind, ObstacleMotion, Obstacles, motion
from engine.geometry.handles import no_handles
from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandAssembly, StrandMaterial
from engine.strands.loads import StrandLoads
from engine.strands.model import StrandModel, StrandState
from engine.validate.catalogue import CaseResult, case, timed_rows
from engine.validate.fit import fitted_exponent

FRICTION, TURN = 0.3, pi  # mu, phi
RADIUS, CYLINDER = 5e-5, 5e-3  # of the strand and of what it lies on [m]
HAIR = StrandMaterial(density=1300.0, young=3e9, shear=1e9)
LOAD = 1e-3  # that the pulled end lifts [N]
SPEED, PULLED, STEP = 1e-4, 0.04, 1e-3  # of the pulled end [m/s], [s], [s]; normals lag behind by what it goes in a step
TAIL = 6  # segments beyond the cylinder at either end
SEGMENTS = (16, 32, 64, 128)  # on the cylinder


@case("contact-capstan", bar=0.02, summary="strand pulled over a cylinder: error of T2/T1 against exp(mu phi)")
def capstan(quick: bool) -> CaseResult:
    """Relative error of the ratio of tensions in steady slip."""
    rows = timed_rows("segments", SEGMENTS, lambda segments: abs(ratio(int(segments)) / exp(FRICTION * TURN) - 1.0))
    order = fitted_exponent([1.0 / row.value for row in rows], [row.error for row in rows])
    return CaseResult(rows, rows[-1].error, order, note=f"mu {FRICTION}, phi pi, without bending stiffness")


def ratio(segments: int, step: float = STEP) -> float:
    """Return T2 / T1 of a strand with so many segments on the cylinder, pulled in steps of `step` [s].

    Raises RuntimeError where a step is rejected.
    """
    model, state = hung(segments)
    obstacles, stepper = cylinder(), StrandStepper(model, np.zeros(3))
    force = np.zeros_like(state.x)
    force[0, 2] = -LOAD
    for _ in range(round(PULLED / step)):
        x = state.x - np.array([0.0, 0.0, SPEED * step])  # only the last vertex is held
        report = stepper.step(state, step, StrandLoads(force=force), (x, np.zeros(len(x))), obstacles)
        if not report.accepted:
            raise RuntimeError(report.reason)
    tension = tensions(model, state)
    return float(tension[-1] / tension[0])


def hung(segments: int) -> tuple[StrandModel, StrandState]:
    """Return a strand whose segments touch the upper half of the cylinder with their middles; its last vertex is held.

    It is taken to be a string: what bends in going on and off the cylinder would change the tension, too.
    """
    angle = np.linspace(0.0, TURN, segments + 1)
    across = (CYLINDER + RADIUS) / cos(0.5 * TURN / segments)
    arc = across * np.column_stack([-np.cos(angle), 0.0 * angle, np.sin(angle)])
    down = np.array([0.0, 0.0, -2.0 * across * sin(0.5 * TURN / segments)])
    hanging = np.arange(1, TAIL + 1)[:, None] * down
    points = np.vstack([arc[0] + hanging[::-1], arc, arc[-1] + hanging])
    held = np.zeros((len(points), 4), np.bool_)
    held[-1, :3] = True
    assembly = StrandAssembly()
    assembly.strand(points, RADIUS, HAIR, friction=FRICTION, held=held)
    model, state = assembly.build()
    return model._replace(bending_stiffness=0.0 * model.bending_stiffness), state


def cylinder() -> ObstacleMotion:
    """Return the cylinder, about the y axis, at rest."""
    upright = np.array([[[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]])
    size = np.array([[CYLINDER, 20.0 * CYLINDER, 0.0]])
    return motion(Obstacles(np.array([ObstacleKind.CYLINDER]), np.zeros((1, 3)), upright, size, np.array([FRICTION])),
                  no_handles(), 0.0, 1.0)


def tensions(model: StrandModel, state: StrandState) -> Floats:
    """Return the tension of every edge of a single strand [N]."""
    length = np.linalg.norm(np.diff(state.x, axis=0), axis=1)
    return model.stretch_stiffness[:-1] * (length - model.rest_length[:-1])
