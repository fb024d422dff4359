"""Yarns with a thickness at run time: where two of them cross, their centre lines pass at their radii from each other.

Sánchez-Banderas 2020 (sec. 4.2) lets both yarns run through the point x and only draws their thickness. In a fabric with
crimp, x is where their surfaces touch. The centre of the lower yarn passes at x - R_0 n, that of the upper at x + R_1 n, n
the unit normal from the one to the other, and it is the centre lines that stretch and bend. To move x along n raises one
yarn as it lowers the other, against nothing else: how the crossing's height R_0 + R_1 is shared between the crimps of the
two is part of the unknown x, and crimp interchange needs no unknown of its own.

n is that of the start of a step and follows x with the next one. Forces on x lack what turning n would do, the moment about
x of what acts on both centres: none where the cloth is loaded in its plane, as in `woven-biaxial`. Cloth that turns or hangs
freely is another matter: offsets that do not turn with it within a step strain its yarns, and a hanging patch gains energy
until steps are rejected. So no scene can ask for crimp before n is part of the unknowns.

Between crossings the offset is interpolated along the yarn, so that contacts with other fabrics slide on straight segments
of it. It is zero at ends: half a spacing behind its last crossing, a yarn is in its middle plane. Inertia, weight, shear and
contact with anything else see x.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints
from engine.yarns.model import YarnModel, YarnState
from engine.yarns.normal_force import normal

if TYPE_CHECKING:  # which needs centre lines itself
    from engine.yarns.topology import Chain


@dataclass(frozen=True)
class CentreLines:
    """Where the centre lines of yarns are while normals and the order of nodes stay as they are."""

    place: Ints  # row of `through` in which each node's centre is, shape [N]
    point: Ints  # of each node, shape [N]
    offset: Floats | None  # from the point to the centre [m], shape [N, 3]; None where no yarn has crimp

    def through(self, x: Floats) -> Floats:
        """Return the centres for points at `x` [P, 3]: one for each node [N, 3], or x itself where no yarn has crimp."""
        return x if self.offset is None else x[self.point] + self.offset


def centre_lines(model: YarnModel, state: YarnState, chain: "Chain") -> CentreLines:
    """Return the centre lines with the normals of the present state, whose EoL nodes are those of `chain`."""
    if not model.height.any():
        return CentreLines(model.node_point, model.node_point, None)
    offset = np.zeros((model.node_count, 3))
    _offset_crossings(model.point_nodes, model.height, model.side, state.active, chain.before, chain.after,
                      model.node_point, state.x, state.u, offset)
    _offset_between(model.node_start, model.height, state.order, state.active, model.node_point, state.u, offset)
    return CentreLines(np.arange(model.node_count), model.node_point, offset)


def crimped_coordinates(model: YarnModel, state: YarnState, chain: "Chain") -> Floats:
    """Return u of all nodes with which centre lines are as much stretched as the yarns through x are now, shape [N] [m].

    So a weave laid out flat and free of tension becomes one of longer yarns, crimped and free of tension.
    """
    lines, u = centre_lines(model, state, chain), state.u.copy()
    centre = lines.through(state.x)[lines.place]
    flat = state.x[model.node_point]
    for first, last in zip(model.node_start[:-1], model.node_start[1:], strict=True):
        nodes = state.order[first:last]
        through_x, along = (np.linalg.norm(np.diff(p[nodes], axis=0), axis=1) for p in (flat, centre))
        longer = np.divide(along, through_x, out=np.ones(len(along)), where=through_x > 0.0)
        u[nodes[1:]] = u[nodes[:1]] + np.cumsum(longer * np.diff(state.u[nodes]))
    return u


@njit(cache=True)
def _offset_crossings(point_nodes, height, side, active, before, after, node_point, x, u, offset):
    t0, t1, n = np.empty(3), np.empty(3), np.empty(3)
    for p in range(len(point_nodes)):
        i, j = point_nodes[p]
        if not active[p] or height[i] == 0.0:
            continue
        normal(i, j, side[p], before, after, node_point, x, u, t0, t1, n)
        for k in range(3):
            offset[i, k] = height[i] * n[k]
            offset[j, k] = height[j] * n[k]


@njit(cache=True)
def _offset_between(node_start, height, order, active, node_point, u, offset):
    """Interpolate the offset of active nodes between crossings, and between these and the ends of the yarn."""
    for y in range(len(node_start) - 1):
        known = -1  # place in `order` of the last node whose offset is known
        last = node_start[y + 1] - 1
        while last > node_start[y] and not active[node_point[order[last]]]:
            last -= 1
        for e in range(node_start[y], last + 1):
            i = order[e]
            if not active[node_point[i]] or (known >= 0 and e < last and height[i] == 0.0):
                continue
            if known >= 0:
                a = order[known]
                span = u[i] - u[a]
                for f in range(known + 1, e):
                    m = order[f]
                    share = (u[m] - u[a]) / span if span > 0.0 else 0.0
                    for k in range(3):
                        offset[m, k] = (1.0 - share) * offset[a, k] + share * offset[i, k]
            known = e
