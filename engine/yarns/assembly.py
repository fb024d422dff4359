"""Put yarns together: a builder that collects yarns and points and packs them into a model and a state."""

from dataclasses import dataclass, field

import numpy as np

from engine.yarns.model import Floats, PointKind, YarnModel, YarnState


@dataclass(frozen=True)
class YarnMaterial:
    """Constants of one kind of yarn."""

    radius: float  # R [m]
    density: float  # rho [kg/m]
    stretch_stiffness: float  # k_s [N]
    bending_stiffness: float = 0.0  # k_b [N m^2]
    mass_damping: float = 0.0  # alpha [1/s]
    stretch_damping: float = 0.0  # beta [s]


@dataclass
class YarnAssembly:
    """Yarns and points in the making; `build` packs them."""

    yarns: list[dict] = field(default_factory=list)
    points: list[dict] = field(default_factory=list)
    nodes: list[dict] = field(default_factory=list)

    def yarn(
        self,
        material: YarnMaterial,
        length: float,
        rest_segment: float,
        fabric: int = -1,
        kinematic: bool = False,
        obstacle_distance: float | None = None,
    ) -> int:
        """Add a yarn of undeformed `length` [m]; returns its index."""
        distance = material.radius if obstacle_distance is None else obstacle_distance
        self.yarns.append(
            dict(vars(material), length=length, rest_segment=rest_segment, fabric=fabric, kinematic=kinematic,
                 obstacle_distance=distance)
        )
        return len(self.yarns) - 1

    def lagrangian(self, yarn: int, u: float, x: Floats, pinned: bool = False, handle: int = -1) -> int:
        """Add an end or a fixed discretisation point, pinned in space or free; returns its point."""
        return self._point(PointKind.LAGRANGIAN, x, [(yarn, u, True)], pinned=pinned, handle=handle)

    def crossing(
        self, below: int, u: float, above: int, v: float, x: Floats, up: Floats, friction: float = 0.0,
        kind: PointKind = PointKind.CROSSING, pinned: bool = False, handle: int = -1,
    ) -> int:
        """Add a place where yarn `below` (at u) and yarn `above` (at v) touch.

        `up` [3] is any vector that points from the lower to the upper yarn. `kind` is CROSSING within a fabric,
        CONTACT between fabrics, STITCH where both are sewn together. Returns the point.
        """
        sewn = kind == PointKind.STITCH
        return self._point(kind, x, [(below, u, sewn), (above, v, sewn)], up=up, friction=friction, pinned=pinned,
                           handle=handle)

    def eyelet(self, yarn: int, u: float, x: Floats, friction: float = 0.0, handle: int = -1) -> int:
        """Add a fixed place that the yarn slides through; returns its point."""
        return self._point(PointKind.EYELET, x, [(yarn, u, False)], friction=friction, pinned=True, handle=handle)

    def edge(self, yarn: int, u: float, x: Floats, direction: Floats, friction: float = 0.0) -> int:
        """Add a place where the yarn slides over a sharp edge of unit `direction` [3]; returns its point."""
        projector = np.outer(direction, direction)
        return self._point(PointKind.EDGE, x, [(yarn, u, False)], friction=friction, projector=projector)

    def _point(self, kind, x, nodes, up=(0.0, 0.0, 1.0), friction=0.0, pinned=False, projector=None, handle=-1):
        if projector is None:
            projector = np.zeros((3, 3)) if pinned else np.eye(3)
        point = len(self.points)
        self.points.append(dict(kind=int(kind), x=np.asarray(x, float), up=np.asarray(up, float), friction=friction,
                                projector=projector, handle=handle))
        for slot, (yarn, u, fixed) in enumerate(nodes):
            self.nodes.append(dict(yarn=yarn, u=float(u), fixed=fixed, point=point, slot=slot))
        return point

    def build(self) -> tuple[YarnModel, YarnState]:
        """Pack everything; nodes are stored yarn after yarn, by u at the start, all at rest."""
        keys = np.array([(n["yarn"], n["u"]) for n in self.nodes]).reshape(-1, 2)
        stored = [self.nodes[i] for i in np.lexsort((keys[:, 1], keys[:, 0]))]
        node_yarn = np.array([n["yarn"] for n in stored], np.int64)
        node_point = np.array([n["point"] for n in stored], np.int64)
        node_slot = np.array([n["slot"] for n in stored], np.int64)
        u = np.array([n["u"] for n in stored])
        point_nodes = np.full((len(self.points), 2), -1, np.int64)
        point_nodes[node_point, node_slot] = np.arange(len(stored))
        x = np.array([p["x"] for p in self.points]).reshape(-1, 3)

        def yarn_values(name, dtype=np.float64):
            return np.array([y[name] for y in self.yarns], dtype)

        model = YarnModel(
            node_start=np.searchsorted(node_yarn, np.arange(len(self.yarns) + 1)).astype(np.int64),
            fabric=yarn_values("fabric", np.int64),
            **{name: yarn_values(name) for name in (
                "length", "rest_segment", "density", "radius", "stretch_stiffness", "bending_stiffness",
                "mass_damping", "stretch_damping", "obstacle_distance")},
            kinematic=yarn_values("kinematic", np.bool_),
            node_yarn=node_yarn, node_point=node_point, node_slot=node_slot,
            u_fixed=np.array([n["fixed"] for n in stored], np.bool_),
            point_kind=np.array([p["kind"] for p in self.points], np.int64),
            point_nodes=point_nodes,
            side=self._sides(x, u, node_yarn, node_point, point_nodes),
            friction=np.array([p["friction"] for p in self.points]),
            free_directions=np.array([p["projector"] for p in self.points]).reshape(-1, 3, 3),
            handle=np.array([p["handle"] for p in self.points], np.int64),
        )
        points, nodes = model.point_count, model.node_count
        state = YarnState(
            x=x, u=u, x_rate=np.zeros((points, 3)), u_rate=np.zeros(nodes), velocity=np.zeros((nodes, 3)),
            order=np.arange(nodes, dtype=np.int64), eil=np.zeros(nodes, np.bool_), active=np.ones(points, np.bool_),
            anchor=u.copy(), normal_force=np.zeros(points), pulling_steps=np.zeros(points, np.int64),
            obstacle_anchor=x.copy(), obstacle_force=np.zeros(points),
        )
        return model, state

    def _sides(self, x, u, node_yarn, node_point, point_nodes):
        """Orientation of each two-yarn point: the sign that turns t_0 x t_1 towards `up`."""
        tangent = np.zeros((len(u), 3))
        for y in range(len(self.yarns)):
            first, last = np.searchsorted(node_yarn, [y, y + 1])
            if last - first > 1:
                chord = x[node_point[first:last]]
                tangent[first:last] = chord[-1] - chord[0]
                # ends of a node's neighbourhood at least a tenth of a rest segment away: nodes may coincide
                reach = 0.1 * self.yarns[y]["rest_segment"]
                for i in range(first, last):
                    before = first + np.searchsorted(u[first:last], u[i] - reach, side="right") - 1
                    after = first + np.searchsorted(u[first:last], u[i] + reach, side="left")
                    span = x[node_point[min(after, last - 1)]] - x[node_point[max(before, first)]]
                    if np.linalg.norm(span) > 0:
                        tangent[i] = span
        side = np.ones(len(point_nodes))
        for p, (i, j) in enumerate(point_nodes):
            if j >= 0 and np.dot(np.cross(tangent[i], tangent[j]), self.points[p]["up"]) < 0:
                side[p] = -1.0
        return side
