"""Puts strands together: from curves and materials to `StrandModel` and `StrandState`."""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Flags, Floats, Ints
from engine.geometry.frames import across, transport
from engine.strands import bending
from engine.strands.kinematics import edges, frames
from engine.strands.model import StrandModel, StrandState
from engine.strands.twisting import twists


@dataclass(frozen=True)
class StrandMaterial:
    """An elastic material with internal friction."""

    density: float  # [kg/m^3]
    young: float  # Young's modulus E [Pa]
    shear: float  # shear modulus G [Pa]
    damping: float = 0.0  # viscous over elastic moduli [s]


class StrandAssembly:
    """Collects strands."""

    def __init__(self) -> None:
        """Begin with none."""
        self._parts: list[dict[str, Floats | Flags | Ints]] = []
        self._groups: list[int] = []
        self._frictions: list[float] = []

    def strand(
        self, points: Floats, radius: Floats | float, material: StrandMaterial, normal: Floats | None = None,
        rest: Floats | None = None, held: Flags | None = None, handle: int = -1, group: int = 0, friction: float = 0.0,
    ) -> int:
        """Add a strand through `points` [n, 3] [m], at rest there or, where given, through the points `rest`; return its number.

        `radius` is one number, semi-axes along m1 and m2 [2], or one or two numbers for each edge [n-1, 1 or 2] [m]. m1 of the
        first edge is along what of `normal` [3] is across it, and is carried along the curve without twist. `held` [n, 4]: x,
        y, z of the vertex, turn of the edge towards the next are given; script handle number `handle` carries them, none where
        that is -1. `friction` is its Coulomb coefficient, `group` says which strands belong together.
        """
        n = len(points)
        axes = np.empty((n, 2))
        axes[:-1] = radius
        axes[-1] = axes[-2]
        shape = _Shape(np.asarray(points if rest is None else rest, float), normal)
        now = shape if rest is None else _Shape(np.asarray(points, float), shape.normal_at(points))
        part = _sections(axes, shape.length, material)
        part |= {
            "radius": axes, "rest_length": np.append(shape.length[:-1], 0.0), "damping": np.full(n, material.damping),
            "rest_curvature": shape.kappa, "rest_twist": shape.twist,
            "held": np.zeros((n, 4), np.bool_) if held is None else held,
            "handle": np.full(n, handle, np.int64),
            "x": now.x, "m1": now.m1, "twist": now.twist,
        }
        self._parts.append(part)
        self._groups.append(group)
        self._frictions.append(friction)
        return len(self._parts) - 1

    def build(self) -> tuple[StrandModel, StrandState]:
        """Return the model and the state of all strands, at rest in time."""
        counts = [len(part["x"]) for part in self._parts]
        packed = {name: np.concatenate([part[name] for part in self._parts]) for name in self._parts[0]}
        vertices = sum(counts)
        state = StrandState(
            x=packed.pop("x"), velocity=np.zeros((vertices, 3)), m1=packed.pop("m1"), spin=np.zeros(vertices),
            twist=packed.pop("twist"), contact_key=np.zeros(0, np.int64), contact_force=np.zeros((0, 3)),
            vertex_contact_force=np.zeros(vertices), turn=np.zeros(vertices), last_step=np.zeros(len(counts)),
            earlier_x=np.zeros((vertices, 3)), earlier_velocity=np.zeros((vertices, 3)), earlier_m1=np.zeros((vertices, 3)),
            earlier_spin=np.zeros(vertices), earlier_twist=np.zeros(vertices),
        )
        model = StrandModel(
            start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), group=np.array(self._groups, np.int64),
            friction=np.array(self._frictions, float), **packed,
        )
        return model, state


class _Shape:
    """Geometry of a curve through `x` [n, 3] whose frames are not twisted."""

    def __init__(self, x: Floats, normal: Floats | None):
        n = len(x)
        self.x, self.length, self.twist = x.copy(), np.ones(n), np.zeros(n)
        t, m1, m2, binormal = (np.zeros((n, 3)) for _ in range(4))
        edges(self.x, t, self.length)
        if normal is None:
            normal = np.eye(3)[np.argmin(np.abs(t[0]))]
        m1[0] = across(tuple(np.asarray(normal, float)), tuple(t[0]))
        for i in range(1, n - 1):
            m1[i] = transport(tuple(m1[i - 1]), tuple(t[i - 1]), tuple(t[i]))
        frames(t, m1, t, np.zeros(n), m1, m2)
        self.t, self.m1, self.kappa = t, m1, np.zeros((n, 2, 2))
        bending.curvatures(t, m1, m2, binormal, self.kappa)
        twists(t, m1, self.twist, np.zeros(n), self.twist)

    def normal_at(self, points: Floats) -> Floats:
        """Return m1 of the first edge as it is carried without twist to a curve through other `points` [n, 3]."""
        t = points[1] - points[0]
        return np.array(transport(tuple(self.m1[0]), tuple(self.t[0]), tuple(t / np.linalg.norm(t))))


def _sections(axes: Floats, length: Floats, material: StrandMaterial) -> dict[str, Floats | Flags | Ints]:
    """Masses and stiffnesses of elliptic cross-sections with semi-axes `axes` [n, 2] on edges of rest `length` [n]."""
    a, b = axes.T
    area = np.pi * a * b
    inertia = np.column_stack([area * a * a, area * b * b]) / 4
    torsion = np.pi * (a * b) ** 3 / (a * a + b * b)  # Saint-Venant's
    edge_mass = material.density * area * length
    edge_mass[-1] = 0.0
    mass = 0.5 * (edge_mass + np.concatenate([[0.0], edge_mass[:-1]]))
    share = np.ones(len(length))  # of each vertex, between the middles of its edges
    share[1:-1] = 0.5 * (length[1:-1] + length[:-2])
    between = np.zeros_like(inertia)
    between[1:-1] = 0.5 * (inertia[1:-1] + inertia[:-2])
    twisted = np.zeros_like(torsion)
    twisted[1:-1] = 0.5 * (torsion[1:-1] + torsion[:-2])
    stretch = material.young * area / length
    stretch[-1] = 0.0
    return {
        "mass": mass,
        "spin_inertia": edge_mass * (a * a + b * b) / 4,
        "stretch_stiffness": stretch,
        "bending_stiffness": material.young * between / share[:, None],
        "twist_stiffness": material.shear * twisted / share,
    }
