"""What a set of Eulerian-on-Lagrangian rods is: its constants (`YarnModel`) and its state (`YarnState`).

A *node* is a place on one yarn: an Eulerian coordinate `u`, the undeformed arc length [m]. A *point* is a place in
space: Lagrangian coordinates `x` [m]. Every node belongs to one point, and the two yarns of a contact have one node
each on the same point, so that contact is kept by sharing `x` (Sánchez-Banderas 2020, sec. 3.1). The unknowns of a
point are therefore the five numbers (x, u of its first node, u of its second node).

Shapes below use Y yarns, N nodes, P points, H handles.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

from engine.arrays import Flags, Floats, Ints


class PointKind(IntEnum):
    """What a point is on the rods that meet there."""

    LAGRANGIAN = 0  # an end or a fixed discretisation point: u fixed
    CROSSING = 1  # two yarns of one fabric, never removed
    CONTACT = 2  # two yarns of different fabrics, removed when they part
    EYELET = 3  # one yarn through a fixed place: x fixed, u free
    STITCH = 4  # two yarns sewn together: both u fixed
    EDGE = 5  # one yarn over a sharp edge: x free along the edge, u free


class NodeState(IntEnum):
    """How a point is discretised at present, as the viewer colours it (Sánchez-Banderas 2020, Fig. 1)."""

    LAGRANGIAN = 0
    EOL = 1
    EOL_EIL = 2
    EIL_EIL = 3
    REMOVED = 4


@dataclass(frozen=True)
class YarnModel:
    """Constants of all yarns of a scene, packed."""

    # constants that a part of the yarns, nodes or points keeps as they are
    OF_YARNS: ClassVar = ("fabric", "length", "rest_segment", "crossing_spacing", "density", "radius", "stretch_stiffness",
                          "bending_stiffness", "shear_stiffness", "mass_damping", "stretch_damping", "kinematic",
                          "obstacle_distance")
    OF_NODES: ClassVar = ("node_slot", "u_fixed", "height", "set_angle", "set_rise")
    OF_POINTS: ClassVar = ("point_kind", "side", "friction", "free_directions", "handle", "edge_middle", "edge_half_length")

    # yarns
    node_start: Ints  # nodes of yarn y are node_start[y] ... node_start[y+1]-1, shape [Y+1]
    fabric: Ints  # fabric that the yarn belongs to, -1 for a single yarn, shape [Y]
    length: Floats  # undeformed length [m], shape [Y]
    rest_segment: Floats  # length of a rest-shape segment [m], shape [Y]
    crossing_spacing: Floats  # of the crossings of a fabric along the yarn; without a fabric its rest segment [m], shape [Y]
    density: Floats  # mass per undeformed length rho [kg/m], shape [Y]
    radius: Floats  # R [m], shape [Y]
    stretch_stiffness: Floats  # k_s = Y pi R^2 [N], shape [Y]
    bending_stiffness: Floats  # k_b = EI [N m^2], shape [Y]
    shear_stiffness: Floats  # k_x per pair of warp and weft segments [N], shape [Y]
    mass_damping: Floats  # alpha [1/s], shape [Y]
    stretch_damping: Floats  # beta [s], shape [Y]
    kinematic: Flags  # a yarn whose shape is given: no inertia, no elasticity, shape [Y]
    obstacle_distance: Floats  # distance at which obstacles begin to push [m], shape [Y]
    # nodes
    node_yarn: Ints  # [N]
    node_point: Ints  # [N]
    node_slot: Ints  # 0 or 1: which of its point's u this node is, shape [N]
    u_fixed: Flags  # the Eulerian coordinate is no unknown, shape [N]
    height: Floats  # of the centre line above its point, along the normal of a crossing with crimp; else 0 [m], shape [N]
    set_angle: Floats  # that the centre line has at a crossing without force, towards the normal; 0 is straight [rad], shape [N]
    set_rise: Floats  # parts along the normal of the centre line's directions before and behind, as set, shape [N, 2]
    # points
    point_kind: Ints  # PointKind, shape [P]
    point_nodes: Ints  # its nodes, -1 where there is one only, shape [P, 2]
    side: Floats  # +1 or -1: side * (t_0 x t_1) points from yarn 0 to yarn 1, shape [P]
    friction: Floats  # Coulomb coefficient mu, shape [P]
    free_directions: Floats  # projector onto the directions in which x may move: I free, 0 pinned, shape [P, 3, 3]
    handle: Ints  # script handle that carries a pinned point, -1 for none, shape [P]
    edge_middle: Floats  # of the edge that a yarn goes over, at points on one [m], shape [P, 3]
    edge_half_length: Floats  # of that edge; without end elsewhere [m], shape [P]

    @property
    def yarn_count(self) -> int:
        """Number of yarns Y."""
        return len(self.length)

    @property
    def node_count(self) -> int:
        """Number of nodes N."""
        return len(self.node_yarn)

    @property
    def point_count(self) -> int:
        """Number of points P."""
        return len(self.point_kind)


@dataclass
class YarnState:
    """All that changes in time; a checkpoint is exactly these arrays."""

    OF_NODES: ClassVar = ("u", "u_rate", "velocity", "order", "eil", "anchor")
    OF_POINTS: ClassVar = ("x", "x_rate", "active", "parting", "normal_force", "contact_force", "gap", "pulling_time",
                           "obstacle_anchor", "obstacle_force")

    x: Floats  # Lagrangian coordinates of points [m], shape [P, 3]
    u: Floats  # Eulerian coordinates of nodes [m], shape [N]
    x_rate: Floats  # rate of x in the last step [m/s], shape [P, 3]
    u_rate: Floats  # rate of u in the last step [m/s], shape [N]
    velocity: Floats  # of the material before and behind each EoL node, where it may jump [m/s], shape [N, 2, 3]
    order: Ints  # nodes of each yarn sorted by u, in the yarn's range of node_start, shape [N]
    eil: Flags  # node has interpolated Lagrangian coordinates, shape [N]
    active: Flags  # point has not been removed, shape [P]
    anchor: Floats  # friction anchor of each node [m], shape [N]
    parting: Flags  # contact was removed, but its yarns have not come clear of each other; only kept for collisions, shape [P]
    normal_force: Floats  # F_n at points, of the last step; negative where yarns pull [N], shape [P]
    contact_force: Floats  # force between the two sides of each point in the last step [N], shape [P, 3]
    gap: Floats  # between the two sides of EIL contacts [m], shape [P, 3]
    pulling_time: Floats  # for which a contact has pulled without a break [s], shape [P]
    obstacle_anchor: Floats  # friction anchor of x on an obstacle [m], shape [P, 3]
    obstacle_force: Floats  # normal force of obstacles in the last step [N], shape [P]

    def copy(self) -> "YarnState":
        """Return a state that shares no array with this one."""
        return YarnState(**{name: value.copy() for name, value in vars(self).items()})
