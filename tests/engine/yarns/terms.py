"""The registry of energies of a step: how to silence each, and what its Hessian deliberately leaves out.

What is left out makes a Hessian cheaper and steadier to have, never a step wrong: Newton still ends where the gradient
vanishes. `left_out` states it in full, so that Hessian plus `left_out` is the derivative of the gradient.
"""

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from engine.arrays import Flags, Floats
from engine.geometry.solids import distance_to
from engine.linalg.block_matrix import BLOCK
from engine.steppers.incremental_potential import IncrementalPotential
from engine.steppers.layout import Layout
from engine.yarns import turning, weave_set
from engine.yarns.constraints import gather
from engine.yarns.topology import Chain
from tests.engine.linalg.dense import dense
from tests.engine.yarns.stacks import places, positions_of, unknowns

NONE = np.zeros(0, np.int64)


@dataclass(frozen=True)
class Term:
    """One energy of the incremental potential."""

    name: str
    silence: Callable[[IncrementalPotential], None]  # takes the energy out of a potential
    left_out: Callable[[IncrementalPotential, Floats, Floats, Floats], None] | None = None  # adds to the full matrix
    internal: bool = False  # exerts no force on the yarns as a whole


def unconstrained(potential: IncrementalPotential) -> IncrementalPotential:
    """Return the potential with every unknown free, also those that are pinned, fixed or interpolated."""
    potential.projector = np.broadcast_to(np.eye(BLOCK), potential.projector.shape).copy()
    potential.constrained = np.zeros(len(potential.constrained), np.bool_)
    potential.constrained_points = NONE
    return potential


def alone(term: Term, potential: IncrementalPotential) -> IncrementalPotential:
    """Return the potential with one energy only and every unknown free."""
    for other in TERMS:
        if other is not term:
            other.silence(potential)
    return unconstrained(potential)


def full_hessian(potential: IncrementalPotential, x: Floats, u: Floats, convex: bool | Flags) -> Floats:
    """Return the Hessian as a full matrix in the unknowns of all points; removed ones have none."""
    layout = potential.lay_out(np.float64, condense=False)
    potential.update_pull(x, u, np.zeros((len(x), BLOCK)))
    potential.hessian(x, u, np.full(len(x), convex), layout)
    return of_points(layout)


def of_points(layout: Layout) -> Floats:
    """Return the matrix of a layout in full, in the order of the points, shape [5 P, 5 P]; zero for those without a row."""
    full = np.zeros((BLOCK * len(layout.row),) * 2)
    at = (BLOCK * layout.point[:, None] + np.arange(BLOCK)).ravel()
    full[np.ix_(at, at)] = dense(layout.matrix)
    return full


def left_out_of_hessian(term: Term, potential: IncrementalPotential, x: Floats, u: Floats) -> Floats:
    """Return what is missing in the Hessian of one energy, as a full matrix."""
    full = np.zeros((BLOCK * potential.model.point_count,) * 2)
    if term.left_out is not None:
        term.left_out(potential, x, u, full)
    return full


def without_mass(p):
    p.model = replace(p.model, density=0.0 * p.model.density)
    p.corner_force = 0.0 * p.corner_force


def without_stretch(p):
    p.model = replace(p.model, stretch_stiffness=0.0 * p.model.stretch_stiffness)


def without_bending(p):
    p.model = replace(p.model, bending_stiffness=0.0 * p.model.bending_stiffness)


def without_shear(p):
    p.sheared = NONE


def without_parallel_contact(p):
    p.parallel_pair = np.zeros((0, 2), np.int64)


def without_contact(p):
    p.split = NONE


def without_friction(p):
    p.sliding = NONE


def without_friction_circle(p):
    p.rubbing = NONE


def without_obstacles(p):
    p.touching = NONE


def without_collisions(p):
    p.colliding = None


def change_of_mass(p, x, u, full):
    """I = rho Du S / (6 h^2): the Hessian takes the mass rho Du of a segment as constant; S is of order h^4."""
    m = p.model
    for i, j in segments(p.chain):
        y = m.node_yarn[i]
        if m.kinematic[y]:
            continue
        ends = p.prediction[i, 1], p.prediction[j, 0]
        slope = (ends[1] - ends[0]) / (p.u0[j] - p.u0[i])
        r0, r1 = (x[m.node_point[n]] - end - (u[n] - p.u0[n]) * slope for n, end in zip((i, j), ends, strict=True))
        of_r = np.column_stack([np.eye(3), -slope])
        of_s = np.concatenate([(2.0 * r0 + r1) @ of_r, (r0 + 2.0 * r1) @ of_r])
        of_du = np.array([0.0, 0, 0, -1, 0, 0, 0, 1])
        mixed = m.density[y] / (6.0 * p.h**2) * np.outer(of_du, of_s)
        full[np.ix_(*[positions_of(m, i, j)] * 2)] += mixed + mixed.T


def left_out_of_stretch(p, x, u, full):
    """What is left out of crimp."""
    turning_of_normals(silenced(p, without_bending), x, u, full)


def silenced(potential, silence):
    """A potential without one of its energies; the one given stays as it is."""
    other = copy(potential)
    silence(other)
    return other


def turning_of_normals(p, x, u, full):
    """What forces on centre lines do in the second derivatives of the normals that these are offset by."""
    if p.offsets is not None:
        p.gradient(x, u)
        forces = p.on_centres - of_the_set(p, x, u)[0], p.on_normals - of_the_set(p, x, u)[1]
        full += derivatives(lambda x, u: couples(p, x, u, *forces), p.model, x, u)


def all_of_the_set(p, x, u, full):
    """Crimp that is set has no Hessian."""
    if p.offsets is not None:
        def gradient(x, u):
            on_centres, on_normals = of_the_set(p, x, u)
            total = couples(p, x, u, on_centres, on_normals)
            gather(p.model.node_point, p.model.node_slot, on_centres, total)
            return total
        full += derivatives(gradient, p.model, x, u)


def of_the_set(p, x, u):
    """The forces of crimp that is set on centre lines and on normals."""
    m, c = p.model, p.chain
    normals = p.offsets.normals(x)
    on_centres, on_normals = np.zeros((m.node_count, 4)), np.zeros_like(normals)
    weave_set.add_gradient(p.set_nodes, c.before, c.after, m.node_yarn, m.bending_stiffness, m.set_angle, m.set_rise,
                           p.offsets.source, normals, p.centre_lines.through(x, u), u, on_centres, on_normals)
    return on_centres, on_normals


def couples(p, x, u, on_centres, on_normals):
    """What forces on centres and normals do to points by turning normals, shape [P, 5]."""
    gradient = np.zeros((len(x), BLOCK))
    turning.add_couples(p.offsets, p.model.node_slot, x, u, on_centres, on_normals, gradient)
    return gradient


def derivatives(of, model, x, u, step=1e-5):
    """Central differences of `of(x, u)` [P, 5] in all unknowns, shape [5 P, 5 P]."""
    q = unknowns(model, x, u)
    columns = []
    for e in step * np.eye(q.size):
        e = e.reshape(q.shape)
        columns.append((of(*places(model, q + e)) - of(*places(model, q - e))).ravel() / (2.0 * step))
    return np.array(columns).T


def left_out_of_bending(p, x, u, full):
    """Buckling across the plane of a bend, and what is left out of crimp."""
    m, c = p.model, p.chain
    of_nodes = np.zeros((4 * m.node_count,) * 2)
    buckling_across(p, x, u, of_nodes)
    at = np.concatenate([4 * n + np.arange(4) for n in c.node])
    if p.offsets is None:
        unknown = np.concatenate([positions_of(m, n) for n in c.node])
        np.add.at(full, tuple(np.ix_(unknown, unknown)), of_nodes[np.ix_(at, at)])
    else:
        j = turning.jacobian(p.offsets, c, m.node_slot, x, u).toarray()
        full += j.T @ of_nodes[np.ix_(at, at)] @ j
    turning_of_normals(silenced(p, without_stretch), x, u, full)
    all_of_the_set(p, x, u, full)


def buckling_across(p, x, u, full):
    """Tilts of both segments of a bend across its plane, the same way: - F (1 - cos theta) (alpha + beta)^2 / 4; by nodes."""
    m, c = p.model, p.chain
    for i in c.node:
        a, b = c.before[i], c.after[i]
        if a < 0 or b < 0:
            continue
        xa, xi, xb = p.centre_lines.through(x, u)[p.centre_lines.place[[a, i, b]]]
        la, lb = np.linalg.norm(xi - xa), np.linalg.norm(xb - xi)
        cross = np.cross((xi - xa) / la, (xb - xi) / lb)
        cosine, sine = (xi - xa) @ (xb - xi) / (la * lb), np.linalg.norm(cross)
        f = 2.0 * m.bending_stiffness[m.node_yarn[i]] * np.arctan2(sine, cosine) / (sine * (u[b] - u[a]))
        tilt = np.kron([-1.0 / la, 1.0 / la - 1.0 / lb, 1.0 / lb], np.append(cross / sine, 0.0))  # alpha + beta
        at = np.concatenate([4 * n + np.arange(4) for n in (a, i, b)])
        full[np.ix_(at, at)] -= 0.5 * f * (1.0 - cosine) * np.outer(tilt, tilt)


def curvature_of_obstacles(p, x, u, full):
    """V = k depth^2 / 2, depth = distance - sdf: the Hessian is k (grad depth)^2, without the curvature of the sdf."""
    solids, step = p.obstacles.end, 1e-6
    before, behind = np.empty(3), np.empty(3)
    for point in p.touching:
        for o in range(len(solids.kind)):
            depth = p.obstacle_distance[point] - distance_to(solids, o, x[point], before)
            if depth > 0.0:
                curvature = np.empty((3, 3))
                for k, e in enumerate(np.eye(3)):
                    distance_to(solids, o, x[point] - step * e, before)
                    distance_to(solids, o, x[point] + step * e, behind)
                    curvature[k] = (behind - before) / (2.0 * step)
                at = BLOCK * point + np.arange(3)
                full[np.ix_(at, at)] -= p.obstacle_stiffness[point] * depth * curvature


def segments(chain: Chain) -> Iterator[tuple[int, int]]:
    """Pairs of successive EoL nodes."""
    return ((i, chain.after[i]) for i in chain.node if chain.after[i] >= 0)


TERMS = [
    Term("inertia", without_mass, left_out=change_of_mass),
    Term("stretch", without_stretch, left_out=left_out_of_stretch, internal=True),
    Term("bending", without_bending, left_out=left_out_of_bending, internal=True),
    Term("shear", without_shear, internal=True),
    Term("parallel contact", without_parallel_contact, internal=True),
    Term("contact", without_contact, internal=True),
    Term("friction", without_friction),
    Term("friction circle", without_friction_circle),
    Term("obstacles", without_obstacles, left_out=curvature_of_obstacles),
    Term("collisions", without_collisions, internal=True),
]
