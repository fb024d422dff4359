"""Put yarns together: a builder that collects yarns and points and packs them into a model and a state."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from engine.arrays import Floats, Ints
from engine.yarns.model import PointKind, YarnModel, YarnState
from engine.yarns.settings import YarnSettings


@dataclass(frozen=True)
class YarnMaterial:
    """Constants of one kind of yarn."""

    radius: float  # R [m]
    density: float  # rho [kg/m]
    stretch_stiffness: float  # k_s [N]
    bending_stiffness: float = 0.0  # k_b [N m^2]
    shear_stiffness: float = 0.0  # k_x [N], of crossings within a fabric
    mass_damping: float = 0.0  # alpha [1/s]
    stretch_damping: float = 0.0  # beta [s]


@dataclass
class YarnAssembly:
    """Yarns and points in the making; `build` packs them.

    Points come one by one (`lagrangian`, `crossing`, `eyelet`, `edge`) or many at once (`lagrangians`, `crossings`,
    `edges`), where every argument may have a leading axis over the new points.
    """

    yarns: list[dict] = field(default_factory=list)
    points: list[dict[str, np.ndarray]] = field(default_factory=list)  # one entry for each call, arrays over its points
    nodes: list[dict[str, np.ndarray]] = field(default_factory=list)  # likewise, arrays over its nodes
    point_count: int = 0

    def yarn(
        self,
        material: YarnMaterial,
        length: float,
        rest_segment: float,
        fabric: int = -1,
        kinematic: bool = False,
        obstacle_distance: float | None = None,
        crossing_spacing: float | None = None,
    ) -> int:
        """Add a yarn of undeformed `length` [m]; returns its index. Crossings are a rest segment apart where not given."""
        distance = material.radius if obstacle_distance is None else obstacle_distance
        spacing = rest_segment if crossing_spacing is None else crossing_spacing
        self.yarns.append(
            dict(vars(material), length=length, rest_segment=rest_segment, fabric=fabric, kinematic=kinematic,
                 obstacle_distance=distance, crossing_spacing=spacing)
        )
        return len(self.yarns) - 1

    def lagrangian(self, yarn: int, u: float, x: Floats, pinned: bool = False, handle: int = -1) -> int:
        """Add an end or a fixed discretisation point, pinned in space or free; returns its point."""
        return int(self.lagrangians(yarn, u, x, pinned, handle)[0])

    def lagrangians(
        self, yarn: ArrayLike, u: ArrayLike, x: Floats, pinned: ArrayLike = False, handle: ArrayLike = -1,
    ) -> Ints:
        """Add ends or fixed discretisation points at `x` [n, 3]; returns their points [n]."""
        return self._add(PointKind.LAGRANGIAN, x, [(yarn, u, True)], pinned=pinned, handle=handle)

    def crossing(
        self, below: int, u: float, above: int, v: float, x: Floats, up: Floats, friction: float = 0.0,
        kind: PointKind = PointKind.CROSSING, pinned: bool = False, handle: int = -1, crimp: bool = False,
        set_as_woven: bool = False,
    ) -> int:
        """Add a place where yarn `below` (at u) and yarn `above` (at v) touch.

        `up` [3] is any vector that points from the lower to the upper yarn. `kind` is CROSSING within a fabric,
        CONTACT between fabrics, STITCH where both are sewn together. With `crimp`, their centre lines pass at their
        radii from it, and u, v become lengths along centre lines (`engine.yarns.crimp`); if they are `set_as_woven`, that bends
        them without force. Returns the point.
        """
        return int(self.crossings(below, u, above, v, x, up, friction, kind, pinned, handle, crimp, set_as_woven)[0])

    def crossings(
        self, below: ArrayLike, u: ArrayLike, above: ArrayLike, v: ArrayLike, x: Floats, up: ArrayLike,
        friction: float = 0.0, kind: PointKind = PointKind.CROSSING, pinned: ArrayLike = False,
        handle: ArrayLike = -1, crimp: bool = False, set_as_woven: bool = False, active: ArrayLike = True,
    ) -> Ints:
        """Add places at `x` [n, 3] where yarns touch, or may come to do so if not `active`, all of one `kind`.

        Returns their points [n].
        """
        sewn = kind == PointKind.STITCH
        return self._add(kind, x, [(below, u, sewn), (above, v, sewn)], up=up, friction=friction, pinned=pinned,
                         handle=handle, crimp=crimp, set_as_woven=set_as_woven, active=active)

    def eyelet(self, yarn: int, u: float, x: Floats, friction: float = 0.0, handle: int = -1) -> int:
        """Add a fixed place that the yarn slides through; returns its point."""
        return int(self._add(PointKind.EYELET, x, [(yarn, u, False)], friction=friction, pinned=True,
                             handle=handle)[0])

    def edge(self, yarn: int, u: float, x: Floats, direction: Floats, friction: float = 0.0) -> int:
        """Add a place where the yarn slides over a sharp edge of unit `direction` [3]; returns its point."""
        return int(self.edges(yarn, u, x, direction, friction)[0])

    def edges(
        self, yarn: ArrayLike, u: ArrayLike, x: Floats, direction: Floats, friction: float = 0.0,
        middle: ArrayLike = (0.0, 0.0, 0.0), half_length: float = np.inf,
    ) -> Ints:
        """Add places at `x` [n, 3] where yarns slide over an edge of unit `direction` [3]; returns their points [n].

        The edge goes `half_length` [m] to both sides of its `middle` [3] or [n, 3], by default without end.
        """
        return self._add(PointKind.EDGE, x, [(yarn, u, False)], friction=friction,
                         free_directions=np.outer(direction, direction), edge_middle=middle, edge_half_length=half_length)

    def _add(
        self, kind, x, nodes, up=(0.0, 0.0, 1.0), friction=0.0, pinned=False, free_directions=None, handle=-1, crimp=False,
        set_as_woven=False, active=True, edge_middle=(0.0, 0.0, 0.0), edge_half_length=np.inf,
    ):
        """Add points at `x`, each with one or two nodes (yarn, u, u is fixed); everything else broadcasts."""
        x = np.asarray(x, float).reshape(-1, 3)
        point = self.point_count + np.arange(len(x))
        if free_directions is None:
            free_directions = np.where(np.asarray(pinned)[..., None, None], np.zeros((3, 3)), np.eye(3))
        constants = dict(kind=int(kind), friction=float(friction), handle=handle, crimp=crimp,
                         set_as_woven=set_as_woven, active=active, edge_half_length=float(edge_half_length))
        self.points.append(dict(
            x=x, up=np.broadcast_to(up, x.shape), edge_middle=np.broadcast_to(edge_middle, x.shape),
            free_directions=np.broadcast_to(free_directions, (len(x), 3, 3)),
            **{name: np.broadcast_to(value, len(x)) for name, value in constants.items()},
        ))
        for slot, (yarn, u, fixed) in enumerate(nodes):
            values = dict(yarn=yarn, u=u, fixed=fixed, point=point, slot=slot)
            self.nodes.append({name: np.broadcast_to(value, len(x)) for name, value in values.items()})
        self.point_count += len(x)
        return point

    def build(self) -> tuple[YarnModel, YarnState]:
        """Pack everything, at least one point; nodes are stored yarn after yarn, by u at the start, all at rest."""
        node = {name: np.concatenate([block[name] for block in self.nodes]) for name in self.nodes[0]}
        # at the very ends of a yarn its end node comes first or last, whatever else is there
        outermost = np.where(node["fixed"], np.sign(node["u"] - 1e-12), 0.0)
        stored = np.lexsort((node["slot"], node["point"], outermost, node["u"], node["yarn"]))
        node_yarn, node_point, node_slot = (node[name][stored].astype(np.int64) for name in ("yarn", "point", "slot"))
        u = node["u"][stored].astype(float)
        point = {name: np.concatenate([block[name] for block in self.points]) for name in self.points[0]}
        x = point["x"]
        point_nodes = np.full((len(x), 2), -1, np.int64)
        point_nodes[node_point, node_slot] = np.arange(len(stored))
        node_start = np.searchsorted(node_yarn, np.arange(len(self.yarns) + 1)).astype(np.int64)

        def yarn_values(name, dtype=np.float64):
            return np.array([y[name] for y in self.yarns], dtype)

        model = YarnModel(
            node_start=node_start,
            fabric=yarn_values("fabric", np.int64),
            **{name: yarn_values(name) for name in (
                "length", "rest_segment", "crossing_spacing", "density", "radius", "stretch_stiffness", "bending_stiffness",
                "shear_stiffness", "mass_damping", "stretch_damping", "obstacle_distance")},
            kinematic=yarn_values("kinematic", np.bool_),
            node_yarn=node_yarn, node_point=node_point, node_slot=node_slot,
            u_fixed=node["fixed"][stored],
            height=np.where(point["crimp"][node_point], (2 * node_slot - 1) * yarn_values("radius")[node_yarn], 0.0),
            point_kind=point["kind"].astype(np.int64),
            point_nodes=point_nodes,
            set_angle=np.zeros(len(u)),
            set_rise=np.zeros((len(u), 2)),
            side=_sides(point["up"], point_nodes, self._tangents(x[node_point], u, point["active"][node_point], node_start)),
            friction=point["friction"],
            free_directions=point["free_directions"],
            handle=point["handle"].astype(np.int64),
            edge_middle=point["edge_middle"].astype(float),
            edge_half_length=point["edge_half_length"],
        )
        points, nodes = model.point_count, model.node_count
        state = YarnState(
            x=x, u=u, x_rate=np.zeros((points, 3)), u_rate=np.zeros(nodes), velocity=np.zeros((nodes, 2, 3)),
            order=np.arange(nodes, dtype=np.int64), eil=np.zeros(nodes, np.bool_), active=point["active"].copy(),
            parting=np.zeros(points, np.bool_),
            anchor=u.copy(), normal_force=np.zeros(points), contact_force=np.zeros((points, 3)), gap=np.zeros((points, 3)),
            pulling_time=np.zeros(points),
            obstacle_anchor=x.copy(), obstacle_force=np.zeros(points),
        )
        # imported here, because reading and checking a scene needs no compiled kernels
        from engine.yarns import normal_force
        from engine.yarns.crimp import centre_lines, crimped_coordinates
        from engine.yarns.topology import assign, chain_of
        from engine.yarns.weave_set import bends

        if model.height.any():
            chain = chain_of(model, state.order, state.eil, state.active)
            state.u = crimped_coordinates(model, state, chain)
            last = node_start[1:] - 1
            angle, rise = bends(model, state, chain, centre_lines(model, state, chain))
            model = replace(model, length=model.length + state.u[last] - u[last], set_rise=rise,
                            set_angle=angle * point["set_as_woven"][node_point])
            state.anchor = state.u.copy()
        assign(model, state, YarnSettings.safety_distance, 0.0, state.u_rate)
        state.normal_force = normal_force.at_rest(model, state, chain_of(model, state.order, state.eil, state.active))
        return model, state

    def _tangents(self, x, u, active, node_start):
        """Direction of the yarn at every node, of any length, shape [N, 3]; only nodes in use tell it."""
        tangent = np.zeros((len(u), 3))
        for yarn, first, last in zip(self.yarns, node_start[:-1], node_start[1:], strict=True):
            own = first + np.flatnonzero(active[first:last])
            if len(own) > 1:
                # ends of a node's neighbourhood at least a tenth of a rest segment away: nodes may coincide
                here, reach = u[first:last], 0.1 * yarn["rest_segment"]
                before = np.maximum(np.searchsorted(u[own], here - reach, side="right") - 1, 0)
                after = np.minimum(np.searchsorted(u[own], here + reach, side="left"), len(own) - 1)
                span = x[own[after]] - x[own[before]]
                chord = x[last - 1] - x[first]
                tangent[first:last] = np.where(span.any(axis=1, keepdims=True), span, chord)
        return tangent


def _sides(up, point_nodes, tangent):
    """Orientation of each two-yarn point: the sign that turns t_0 x t_1 towards `up`."""
    first, second = tangent[point_nodes[:, 0]], tangent[point_nodes[:, 1]]
    against = np.einsum("ij,ij->i", np.cross(first, second), up) < 0
    return np.where(against & (point_nodes[:, 1] >= 0), -1.0, 1.0)
