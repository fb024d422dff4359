"""What acts on strands within a step, and what inertia makes of it (Fei 2019, eq. 14.1).

All that is quadratic in the places at the end of a step adds up to one mass and one place for every vertex: inertia would take
it there, gravity, given forces and implicit drag included.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from engine.arrays import Floats
from engine.strands.backward_difference import BackwardDifference
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
    """What makes sum m |x - target|^2 / (2 h*^2) the potential of inertia and all loads, and the like of spin.

    h*, c and y_(n-1) are those of `engine.strands.backward_difference`.
    """

    mass: Floats  # m, that of drag included [kg], shape [V]
    target: Floats  # [m], shape [V, 3]
    weight: Floats  # without drag [N], shape [V]
    spun: Floats  # turns of edges in the step that inertia would make [rad], shape [V]
    effective: Floats  # h* [s], shape [V]
    lean: Floats  # c, shape [V]
    earlier_x: Floats  # y_(n-1) where c is not 0 [m], shape [V, 3]
    earlier_m1: Floats  # shape [V, 3]
    earlier_twist: Floats  # [rad], shape [V]


def inertia(
    model: StrandModel, state: StrandState, loads: StrandLoads, gravity: Floats, difference: BackwardDifference
) -> Inertia:
    """Return the inertia of a step under `loads` and `gravity` [3] [m/s^2], whose rates are those of `difference`."""
    step = difference.effective[:, None]
    place = difference.base(state.x, state.earlier_x)
    velocity = difference.base(state.velocity, state.earlier_velocity)
    mass = model.mass if loads.film_mass is None else model.mass + loads.film_mass
    weight = mass * np.linalg.norm(gravity)
    impulse = mass[:, None] * (velocity + step * gravity)
    if loads.force is not None:
        impulse += step * loads.force
    if loads.film_mass is not None and loads.film_velocity is not None:
        impulse += loads.film_mass[:, None] * (_along_film(model, state, loads.film_velocity, difference) - velocity)
    if loads.drag is not None:
        mass = mass + difference.effective * loads.drag
        if loads.stream is not None:
            impulse += step * loads.drag[:, None] * loads.stream
    # turns count from the start of the step, where the last one lies behind
    spun = difference.lean * state.turn + difference.effective * difference.base(state.spin, state.earlier_spin)
    return Inertia(mass, place + step * impulse / mass[:, None], weight, spun, difference.effective, difference.lean,
                   state.earlier_x, state.earlier_m1, state.earlier_twist)


def _along_film(model: StrandModel, state: StrandState, film_velocity: Floats, difference: BackwardDifference) -> Floats:
    """What `difference` goes on from of the velocity that the film sees on its way along the strands, shape [V, 3]."""
    now = carried_velocity(model, state.velocity, film_velocity, np.full_like(state.last_step, difference.h))
    if not difference.lean.any():
        return now
    return difference.base(now, carried_velocity(model, state.earlier_velocity, film_velocity, difference.h + state.last_step))


def carried_velocity(model: StrandModel, velocity: Floats, film_velocity: Floats, ago: Floats) -> Floats:
    """Return the `velocity` [V, 3] of strands where the film of each vertex was `ago` [S] [s], shape [V, 3] (Fei 2019, eq. 14.2).

    Linear between vertices; beyond an end it is that of the end. The force that follows is the last one of eq. 13.50; the one
    in eq. 14.1 is printed with the other sign.
    """
    carried = np.empty_like(velocity)
    for first, last, time in zip(model.start[:-1], model.start[1:], ago, strict=True):
        along = np.concatenate([[0.0], np.cumsum(model.rest_length[first : last - 1])])
        origin = along - time * film_velocity[first:last]
        for k in range(3):
            carried[first:last, k] = np.interp(origin, along, velocity[first:last, k])
    return carried
