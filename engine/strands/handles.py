"""Where script handles take what is held of strands in a step: places of vertices, and turns of edges about themselves."""

import numpy as np
from scipy.spatial.transform import Rotation

from engine.arrays import Floats, Ints
from engine.geometry.handles import Handles
from engine.strands.model import StrandModel, StrandState


def given(model: StrandModel, state: StrandState, handles: Handles, time: float, h: float) -> tuple[Floats, Floats]:
    """Return where held vertices end a step of `h` from `time` [s], shape [V, 3] [m], and the turns of held edges [V] [rad].

    What a handle carries moves with it as with a rigid body. What no handle carries stays where it is.
    """
    x, turn = state.x.copy(), np.zeros(len(state.x))
    carried = np.flatnonzero((model.handle >= 0) & model.held.any(axis=1))
    if not len(carried):
        return x, turn
    handle = model.handle[carried]
    there = handles.carry(state.x[carried], handle, time, h)
    x[carried] = np.where(model.held[carried, :3], there, state.x[carried])
    changes = handles.turns(time + h) @ handles.turns(time).transpose(0, 2, 1)
    turned = carried[model.held[carried, 3]]
    turn[turned] = turns_of_edges(state.x, turned, changes[model.handle[turned]])
    return x, turn


def turns_of_edges(x: Floats, edge: Ints, change: Floats) -> Floats:
    """Return the turns [E] [rad] of edges [E] between vertices x [V, 3] about themselves as bodies turn by `change` [E, 3, 3].

    A turn is what the body turns the edge about itself beyond what the edge's frame does that is carried along without twist.
    """
    before = x[edge + 1] - x[edge]
    before /= np.linalg.norm(before, axis=1)[:, None]
    after = np.einsum("eij,ej->ei", change, before)
    # the change as the least rotation from before to after, followed by a turn about after
    rest = np.einsum("eij,ekj->eik", change, _least_rotations(before, after))
    return np.einsum("ei,ei->e", Rotation.from_matrix(rest).as_rotvec(), after)


def _least_rotations(before: Floats, after: Floats) -> Floats:
    """Rotations that take unit vectors `before` [n, 3] to `after` the shortest way, shape [n, 3, 3]; none to opposite ones."""
    axis = np.cross(before, after)
    sine, cosine = np.linalg.norm(axis, axis=1), np.einsum("ei,ei->e", before, after)
    scale = np.divide(np.arctan2(sine, cosine), sine, out=np.zeros_like(sine), where=sine > 0.0)
    return Rotation.from_rotvec(scale[:, None] * axis).as_matrix()
