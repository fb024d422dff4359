"""What one reads off a state of strands: curves with strain, curvature and contact forces for pictures, energies, momentum."""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from engine.arrays import Flags, Floats, Singles
from engine.geometry.frames import cross, row
from engine.strands import bending, potential, stretching, twisting
from engine.strands.kinematics import edges
from engine.strands.model import StrandModel, StrandState


def strand_frame_arrays(model: StrandModel, state: StrandState) -> dict:
    """Return the arrays of a frame: all vertices with the radius of their edges, strain, curvature and contact force.

    They are rounded to float32, which moves hair within a metre of the origin by less than a thousandth of its radius.
    """
    return dict(
        positions=_single(state.x), offsets=model.start, radius=_single(np.sqrt(model.radius[:, 0] * model.radius[:, 1])),
        group=model.group, strain=_single(strain(model, state)), curvature=_single(curvature(model, state)),
        contact_force=_single(state.vertex_contact_force),
    )


def strain(model: StrandModel, state: StrandState) -> Floats:
    """Return the stretch |e| / l - 1, at inner vertices the mean of both edges, shape [V]."""
    edge = _with_edge(model)
    length = np.linalg.norm(_edges(state.x), axis=1)
    stretch = np.divide(length, model.rest_length, out=np.ones_like(length), where=edge) - 1.0
    total, count = stretch * edge, edge.astype(float)
    total[1:] += (stretch * edge)[:-1]
    count[1:] += edge[:-1]
    return total / count


def curvature(model: StrandModel, state: StrandState) -> Floats:
    """Return the angle between the edges of a vertex over the length between their middles [1/m], shape [V].

    Ends have that of the vertex next to them, where it is an inner one.
    """
    edge = _with_edge(model)
    e = _edges(state.x)
    before, after = e[:-1], e[1:]
    angle = np.arctan2(np.linalg.norm(np.cross(before, after), axis=1), np.einsum("ij,ij->i", before, after))
    length = np.linalg.norm(e, axis=1)
    bend = np.zeros(len(e))
    inner = edge[:-1] & edge[1:]
    bend[1:][inner] = 2.0 * angle[inner] / (length[:-1] + length[1:])[inner]
    first, last = model.start[:-1], model.start[1:] - 1
    bend[first], bend[last] = bend[first + 1], bend[last - 1]
    return bend


def energies(model: StrandModel, state: StrandState, gravity: ArrayLike) -> dict[str, float]:
    """Return kinetic energy, with that of spin, and potential energy (elastic, weight) [J]; the weight's zero is at the origin.

    What contacts hold by penalties or cohesion is not in it.
    """
    speed = np.einsum("ij,ij->i", state.velocity, state.velocity)
    kinetic = 0.5 * (model.mass @ speed + model.spin_inertia @ state.spin**2)
    weight = -(model.mass @ state.x) @ np.asarray(gravity)
    return dict(kinetic=float(kinetic), potential=float(elastic_energy(model, state.x, state.m1, state.twist) + weight))


def momentum(model: StrandModel, state: StrandState) -> Floats:
    """Return the linear momentum of all strands, shape [3] [kg m/s]."""
    return model.mass @ state.velocity


@njit(cache=True, error_model="numpy")
def elastic_energy(model, x, m1, twist):
    """Energy [J] of stretch, bending and twist of all strands, with vertices x [V, 3], m1 of edges [V, 3] and twist [V]."""
    start = model.start
    memory = potential.geometry((start[1:] - start[:-1]).max())
    total = 0.0
    for s in range(len(start) - 1):
        a, b = start[s], start[s + 1]
        shape = potential.first_of_geometry(memory, b - a)
        edges(x[a:b], shape.t, shape.length)
        for i in range(b - a - 1):
            m2 = cross(row(shape.t, i), row(m1, a + i))
            for k in range(3):
                shape.m2[i, k] = m2[k]
        bending.curvatures(shape.t, m1[a:b], shape.m2, shape.binormal, shape.kappa)
        total += stretching.energy(shape.length, model.rest_length[a:b], model.stretch_stiffness[a:b])
        total += bending.energy(shape.kappa, model.rest_curvature[a:b], model.bending_stiffness[a:b])
        total += twisting.energy(twist[a:b], model.rest_twist[a:b], model.twist_stiffness[a:b])
    return total


def _with_edge(model: StrandModel) -> Flags:
    """Return which vertices have an edge towards the next: all but the last of every strand, shape [V]."""
    edge = np.ones(len(model.mass), np.bool_)
    edge[model.start[1:] - 1] = False
    return edge


def _edges(x: Floats) -> Floats:
    """Differences to the next vertex, shape [V, 3]; from the last of a strand they lead to another strand."""
    return np.diff(x, axis=0, append=x[-1:])


def _single(values: Floats) -> Singles:
    return values.astype(np.float32)
