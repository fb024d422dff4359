"""What acts on strands within a step, and what inertia makes of it (Fei 2019, eq. 14.1).

All that is quadratic in the places at the end of a step adds up to one mass and one place for every vertex: inertia would take
it there, gravity, given forces and implicit drag included.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from engine.arrays import Floats
from engine.strands.model import StrandModel, StrandState


@dataclass(frozen=True)
class StrandLoads:
    """Loads on V vertices; what is None is not there."""

    force: Floats | None = None  # [N], shape [V, 3]
    drag: Floats | None = None  # force over relative velocity [N s/m], shape [V]
    stream: Floats | None = None  # velocity of what drags [m/s], shape [V, 3]; at rest where None
    film_mass: Floats | None = None  # that moves with the vertices [kg], shape [V]
    film_velocity: Floats | None = None  # of the film along the edges behind vertices, relative to them [m/s], shape [V]


class Inertia(NamedTuple):
    """What makes sum m |x - target|^2 / (2 h^2) the potential of inertia and all loads."""

    mass: Floats  # m, that of drag included [kg], shape [V]
    target: Floats  # [m], shape [V, 3]
    weight: Floats  # without drag [N], shape [V]


def inertia(model: StrandModel, state: StrandState, loads: StrandLoads, gravity: Floats, h: float) -> Inertia:
    """Return the inertia of a step of `h` [s] under `loads` and `gravity` [3] [m/s^2]."""
    mass = model.mass if loads.film_mass is None else model.mass + loads.film_mass
    weight = mass * np.linalg.norm(gravity)
    impulse = mass[:, None] * (state.velocity + h * gravity)
    if loads.force is not None:
        impulse += h * loads.force
    if loads.film_mass is not None and loads.film_velocity is not None:
        impulse += loads.film_mass[:, None] * (carried_velocity(model, state, loads.film_velocity, h) - state.velocity)
    if loads.drag is not None:
        mass = mass + h * loads.drag
        if loads.stream is not None:
            impulse += h * loads.drag[:, None] * loads.stream
    return Inertia(mass, state.x + h * impulse / mass[:, None], weight)


def carried_velocity(model: StrandModel, state: StrandState, film_velocity: Floats, h: float) -> Floats:
    """Return the strand's velocity where the film of each vertex was a step `h` [s] ago, shape [V, 3] (Fei 2019, eq. 14.2).

    Linear between vertices; beyond an end it is that of the end. The force that follows is the last one of eq. 13.50; the one
    in eq. 14.1 is printed with the other sign.
    """
    carried = np.empty_like(state.velocity)
    for first, last in zip(model.start[:-1], model.start[1:], strict=True):
        along = np.concatenate([[0.0], np.cumsum(model.rest_length[first : last - 1])])
        origin = along - h * film_velocity[first:last]
        for k in range(3):
            carried[first:last, k] = np.interp(origin, along, state.velocity[first:last, k])
    return carried
