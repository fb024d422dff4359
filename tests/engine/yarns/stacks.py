"""Random stacks of yarns, in units of order one, on which every kind of point and every energy occurs."""

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from engine.arrays import Floats, Ints
from engine.contact.collisions import CollisionPairs
from engine.contact.obstacles import ObstacleKind, Obstacles, motion
from engine.contact.surface import Surface, packed, sampled
from engine.geometry.handles import no_handles
from engine.linalg.block_matrix import BLOCK
from engine.steppers.incremental_potential import IncrementalPotential
from engine.yarns.assembly import YarnAssembly, YarnMaterial
from engine.yarns.model import PointKind, YarnModel, YarnState
from engine.yarns.settings import YarnSettings
from engine.yarns.topology import Chain, chain_of, standing

H = 0.1
SETTINGS = YarnSettings(
    constraint_factor=3.0, friction_factor=0.5, obstacle_factor=2.0, gauge=0.1)
MATERIAL = YarnMaterial(radius=0.1, density=1.3, stretch_stiffness=2.0, bending_stiffness=0.5, shear_stiffness=0.7,
                        mass_damping=0.2, stretch_damping=0.3)
GRAVITY = np.array([0.3, -0.2, -1.0])
NO_OBSTACLES = Obstacles(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(0))
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Stack:
    """Yarns in the middle of a motion, with what surrounds them."""

    model: YarnModel
    state: YarnState
    obstacles: Obstacles
    gravity: Floats
    colliding: CollisionPairs | None = None

    @property
    def chain(self) -> Chain:
        """The EoL nodes of the present assignment."""
        return chain_of(self.model, self.state.order, self.state.eil, self.state.active)

    def potential(self, settings: YarnSettings = SETTINGS, h: float = H) -> IncrementalPotential:
        """The incremental potential of a step from here."""
        obstacles = motion(self.obstacles, no_handles(), 0.0, h)
        return IncrementalPotential(self.model, settings, self.gravity, obstacles, self.state, self.chain, h,
                                    self.colliding)


def random_stack(seed: int, **material: float) -> Stack:
    """Two small weaves on each other, rods held in all ways, obstacles below: all perturbed and in motion.

    Every node that may be EIL is so with even chances, whatever the distances. With an odd seed, the weaves have crimp.
    """
    yarns = YarnAssembly()
    material = replace(MATERIAL, **material)
    # so thick and close that neighbours touch
    _add_weaves(yarns, replace(material, radius=2.0 * material.radius), near=0.2, spacing=0.7, crimp=seed % 2 == 1)
    _add_rods(yarns, material)
    model, state = yarns.build()
    rng = np.random.default_rng(seed)
    _stir(rng, model, state)
    state.eil = (standing(model) < 2) & (model.kinematic[model.node_yarn] | (rng.random(model.node_count) < 0.5))
    stack = Stack(model, state, some_obstacles(), GRAVITY)
    return replace(stack, colliding=some_collisions(rng, stack))


def free_weaves(seed: int, **material: float) -> Stack:
    """Two small weaves in one plane, of stiff yarns held by nothing, each thrown with a velocity of its own."""
    yarns = YarnAssembly()
    _add_weaves(yarns, replace(MATERIAL, **{"stretch_stiffness": 2e3, **material}), near=0.04, pinned=False)
    model, state = yarns.build()
    thrown = np.random.default_rng(seed).normal(scale=0.1, size=(model.yarn_count, 3))
    state.velocity[:] = thrown[model.node_yarn][:, None]
    return Stack(model, state, NO_OBSTACLES, GRAVITY)


def perturbed(stack: Stack, seed: int) -> tuple[Floats, Floats]:
    """Return a place (x, u) that a step from the stack might come to."""
    rng = np.random.default_rng(seed)
    free = ~stack.model.u_fixed
    return (stack.state.x + rng.normal(scale=0.02, size=stack.state.x.shape),
            stack.state.u + 0.01 * free * rng.uniform(-1.0, 1.0, len(free)))


def moved(stack: Stack, rotation: Rotation, shift: Floats) -> Stack:
    """Return the whole stack, with obstacles and gravity, turned about the origin and then shifted."""
    model, state, obstacles, turn = stack.model, stack.state.copy(), stack.obstacles, rotation.as_matrix()
    for name, values in vars(state).items():
        if values.ndim > 1:  # vectors of space, all of them
            setattr(state, name, values @ turn.T + (shift if name in ("x", "obstacle_anchor") else 0.0))
    return Stack(
        replace(model, free_directions=turn @ model.free_directions @ turn.T), state,
        replace(obstacles, centre=obstacles.centre @ turn.T + shift, rotation=turn @ obstacles.rotation),
        turn @ stack.gravity, stack.colliding)


def straight_yarn(
    u: Floats, kind: PointKind = PointKind.LAGRANGIAN, kinematic: bool = False, **material: float
) -> tuple[YarnModel, YarnState]:
    """Return one unloaded yarn along x with nodes at `u`: free ends and, between them, points of one `kind`."""
    yarns = YarnAssembly()
    u = np.asarray(u, float)
    yarn = yarns.yarn(replace(MATERIAL, **material), u[-1] - u[0], (u[-1] - u[0]) / (len(u) - 1), kinematic=kinematic)
    place = np.column_stack([u, 0.0 * u, 0.0 * u])
    for i, (at, x) in enumerate(zip(u, place, strict=True)):
        if kind == PointKind.EYELET and 0 < i < len(u) - 1:
            yarns.eyelet(yarn, at, x)
        else:
            yarns.lagrangian(yarn, at, x)
    return yarns.build()


def some_obstacles() -> Obstacles:
    """Return one obstacle of each kind; the plane reaches all points, each of the others a few."""
    ball = trimesh.creation.icosphere(2, 0.3)
    mesh = sampled(Surface(np.array(ball.vertices), np.array(ball.faces, np.int64)), 0.05, 0.2)
    angles = [[3, -2, 0], [2, 3, 20], [0, 0, 0], [5, 3, 0], [30, -20, 10]]
    return Obstacles(
        kind=np.array(list(ObstacleKind), np.int64),
        centre=np.array([[0.0, 0, -0.15], [1.0, 1.0, -0.35], [0.0, 0.0, -0.3], [1.1, 0.1, -0.25], [0.1, 1.0, -0.3]]),
        rotation=Rotation.from_euler("xyz", angles, degrees=True).as_matrix(),
        size=np.array([[0.0, 0, 0], [0.2, 0.25, 0.3], [0.25, 0, 0], [0.3, 0.2, 0], mesh.size]),
        friction=np.array([0.4, 0.5, 0.3, 0.2, 0.3]),
        surfaces=packed([None, None, None, None, mesh]))


def some_collisions(rng, stack: Stack) -> CollisionPairs:
    """Return pairs of spheres on EoL segments that have no point in common; half of them touch."""
    at, chain = stack.model.node_point, stack.chain
    first = chain.node[chain.after[chain.node] >= 0]
    segments = at[np.column_stack([first, chain.after[first]])]
    chosen = np.array([rng.choice(len(segments), 2, replace=False) for _ in range(60)])
    point = segments[chosen].reshape(-1, 4)
    point = point[[len(set(four)) == 4 for four in point.tolist()]]
    s, t = rng.uniform(0.0, 1.0, (2, len(point)))
    weight = np.column_stack([1.0 - s, s, t - 1.0, -t])
    distance = np.linalg.norm(np.einsum("ca,cak->ck", weight, stack.state.x[point]), axis=1)
    rest = distance * np.where(np.arange(len(point)) % 2, 1.4, 0.7)
    return CollisionPairs(point, weight, rest, rng.uniform(0.5, 2.0, len(point)))


def unknowns(model: YarnModel, x: Floats, u: Floats) -> Floats:
    """Return (x, u) as the unknowns of points, shape [P, 5]; zero where a point has one node only."""
    q = np.zeros((model.point_count, BLOCK))
    q[:, :3] = x
    q[model.node_point, 3 + model.node_slot] = u
    return q


def places(model: YarnModel, q: Floats) -> tuple[Floats, Floats]:
    """Return the (x, u) of unknowns [P, 5]."""
    return q[:, :3].copy(), q[model.node_point, 3 + model.node_slot]


def positions_of(model: YarnModel, *nodes: int) -> Ints:
    """Return where (x, u) of each of the nodes stand in the flattened unknowns, shape [4 n]."""
    return np.concatenate([
        BLOCK * model.node_point[n] + np.array([0, 1, 2, 3 + model.node_slot[n]], np.int64) for n in nodes])


def _add_weaves(yarns, material, near, spacing=1.0, pinned=True, crimp=False):
    """Add two weaves of four yarns; those of the second lie `near` and far from those of the first that they follow."""
    warp, weft = (
        [[yarns.yarn(material, 2.0, 1.0, fabric, obstacle_distance=0.25) for _ in range(2)] for fabric in range(2)]
        for _ in range(2))
    shift = np.array([[0.0, 0.0], [near, 0.35]])
    y_of, x_of = spacing * np.arange(2) - shift, spacing * np.arange(2) + shift  # places of warps and wefts
    for fabric in range(2):
        for k in range(2):
            for end in (0.0, 2.0):
                held = pinned and end == 0.0 and k == 0
                yarns.lagrangian(warp[fabric][k], end, [end - 0.5, y_of[fabric, k], 0.0], held)
                yarns.lagrangian(weft[fabric][k], end, [x_of[fabric, k], end - 0.5, 0.0], held)
    for i in range(2):
        for j in range(2):
            for a, b in ((0, 0), (1, 1), (0, 1), (1, 0)):  # fabric of the warp, of the weft
                y, x = y_of[a, i], x_of[b, j]
                below_u_above_v = (warp[a][i], x + 0.5, weft[b][j], y + 0.5)
                if a > b or (a == b and (i + j) % 2):
                    below_u_above_v = below_u_above_v[2:] + below_u_above_v[:2]
                kind = PointKind.CROSSING if a == b else PointKind.CONTACT
                yarns.crossing(*below_u_above_v, [x, y, 0.0], UP, friction=0.3, kind=kind, crimp=crimp and a == b,
                               set_as_woven=a == 0)


def _add_rods(yarns, material):
    """Add a rod through two eyelets and over two edges, one that it rests on and one that is sewn to it."""
    rod = yarns.yarn(material, 4.0, 1.0)
    given = yarns.yarn(material, 2.0, 1.0, kinematic=True)
    sewn = yarns.yarn(material, 1.0, 1.0, obstacle_distance=0.25)

    def place(u):
        return np.array([u, -2.0, 0.2 * u])

    for u, pinned in ((0.0, True), (2.0, False), (2.6, False), (4.0, False)):
        yarns.lagrangian(rod, u, place(u), pinned)
    yarns.eyelet(rod, 1.0, place(1.0), friction=0.3)
    yarns.eyelet(rod, 1.25, place(1.25), friction=0.3)
    for u in (1.6, 2.3):
        yarns.edge(rod, u, place(u), np.array([0.6, 0.8, 0.0]), friction=0.3)
    yarns.crossing(rod, 3.0, given, 1.0, place(3.0), UP, friction=0.3, kind=PointKind.CONTACT)
    yarns.crossing(rod, 3.5, sewn, 0.5, place(3.5), UP, kind=PointKind.STITCH)
    for u in (0.0, 2.0):
        yarns.lagrangian(given, u, place(3.0) + np.array([0.0, u - 1.0, 0.0]), pinned=True)
    for u in (0.0, 1.0):
        yarns.lagrangian(sewn, u, place(3.5) + np.array([0.1, u - 0.5, 0.3]))


def _stir(rng, model, state):
    """Put everything that a state holds a little out of place."""
    sliding = ~model.u_fixed
    state.x += rng.normal(scale=0.04, size=state.x.shape)
    state.u += 0.01 * sliding * rng.uniform(-1.0, 1.0, len(state.u))
    state.velocity = rng.normal(scale=0.3, size=state.velocity.shape)
    state.u_rate = 0.02 * sliding * rng.normal(size=len(state.u))
    state.anchor = state.u + rng.normal(scale=0.1, size=len(state.u))
    state.normal_force = rng.uniform(0.0, 0.6, len(state.x))
    state.gap = rng.normal(scale=0.02, size=state.x.shape)
    state.contact_force = rng.normal(scale=0.2, size=state.x.shape)
    state.obstacle_anchor = state.x + rng.normal(scale=0.08, size=state.x.shape)
    state.obstacle_force = rng.uniform(0.0, 1.0, len(state.x))
