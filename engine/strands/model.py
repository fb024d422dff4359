"""What a scene's strands are (`StrandModel`, which stays) and how they are (`StrandState`, which changes).

All strands are packed one behind the other. Arrays have an entry for every vertex; in those of edges it belongs to the edge
towards the next vertex, and the last of every strand is not used.
"""

from dataclasses import dataclass
from typing import NamedTuple

from engine.arrays import Flags, Floats, Ints


class StrandModel(NamedTuple):
    """S strands with V vertices."""

    start: Ints  # strand s has the vertices start[s] ... start[s+1]-1, shape [S+1]
    radius: Floats  # semi-axes of the cross-section of edges along m1 and m2 [m], shape [V, 2]
    mass: Floats  # of vertices [kg], shape [V]
    spin_inertia: Floats  # of edges about themselves [kg m^2], shape [V]
    rest_length: Floats  # of edges [m], shape [V]
    stretch_stiffness: Floats  # E A / l of edges [N/m], shape [V]
    bending_stiffness: Floats  # E I_1 / l and E I_2 / l of vertices, l between the middles of their edges [N m], shape [V, 2]
    twist_stiffness: Floats  # G J / l of vertices [N m], shape [V]
    rest_curvature: Floats  # kappa_1, kappa_2 in the frames of both edges, shape [V, 2, 2]
    rest_twist: Floats  # of vertices [rad], shape [V]
    damping: Floats  # viscous over elastic stiffness, of vertices and edges [s], shape [V]
    held: Flags  # x, y, z of the vertex, turn of the edge are given, shape [V, 4]
    handle: Ints  # script handle that carries what is held of a vertex and its edge, -1 for none, shape [V]
    group: Ints  # of strands that belong together, shape [S]
    friction: Floats  # Coulomb coefficient of a strand, on another the geometric mean of both, shape [S]


@dataclass
class StrandState:
    """All that changes in time; a checkpoint is exactly these arrays."""

    x: Floats  # places of vertices [m], shape [V, 3]
    velocity: Floats  # of vertices [m/s], shape [V, 3]
    m1: Floats  # first material direction of edges, shape [V, 3]
    spin: Floats  # rate at which edges turn about themselves [rad/s], shape [V]
    twist: Floats  # of vertices, counting whole turns [rad], shape [V]
    contact_key: Ints  # contacts that pressed at the end of the last step, ascending, shape [C]
    contact_force: Floats  # theirs on the first side [N], shape [C, 3]
    vertex_contact_force: Floats  # sum of the sizes of contact forces on a vertex [N], shape [V]
    turn: Floats  # by which edges turned about themselves in the last step [rad], shape [V]
    last_step: Floats  # of strands [s], 0 where what was before it does not count: only BDF2 keeps that, shape [S]
    earlier_x: Floats  # x before the last step, like those that follow, shape [V, 3]
    earlier_velocity: Floats  # shape [V, 3]
    earlier_m1: Floats  # shape [V, 3]
    earlier_spin: Floats  # shape [V]
    earlier_twist: Floats  # shape [V]

    def copy(self) -> "StrandState":
        """Return a state that shares no array with this one."""
        return StrandState(**{name: value.copy() for name, value in vars(self).items()})
