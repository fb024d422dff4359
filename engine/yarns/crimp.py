"""Yarns with a thickness at run time: where two of them cross, their centre lines pass at their radii from each other.

Sánchez-Banderas 2020 (sec. 4.2) lets both yarns run through the point x and only draws their thickness. In a fabric with
crimp, x is where their surfaces touch. The centre of the lower yarn passes at x - R_0 n, that of the upper at x + R_1 n, n
the unit normal from the one to the other, and it is the centre lines that stretch and bend. To move x along n raises one
yarn as it lowers the other, against nothing else: how the crossing's height R_0 + R_1 is shared between the crimps of the
two is part of the unknown x, and crimp interchange needs no unknown of its own.

n turns with the cloth: it is a function of x, of the directions in which both yarns pass. Forces on centres so act on the
points around too (`engine.yarns.turning`), and a piece of cloth that turns as a whole stores nothing.

Between crossings the offset is interpolated along the yarn by u, so that contacts with other fabrics slide on straight
segments of it. It is zero at ends, in the middle plane of the fabric. Inertia, weight,
shear and contact with anything else see x.
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
class Offsets:
    """How far the centres of nodes are from their points while the order of nodes stays as it is."""

    crossings: Ints  # points with a normal, shape [C]
    point_nodes: Ints  # of all points, shape [P, 2]
    side: Floats  # [P]
    before: Ints  # of all nodes, shape [N]
    after: Ints  # [N]
    node_point: Ints  # [N]
    height: Floats  # of the centre above the point at crossings, 0 elsewhere [m], shape [N]
    ends: Ints  # nodes of known offset, crossings and ends of yarns, between which each node stands, or itself, shape [N, 2]
    source: Ints  # number of the crossings at `ends`, 0 where there is none, shape [N, 2]

    def weights(self, u: Floats) -> Floats:
        """Return the weights of the normals at `ends` in the offsets of nodes at u [N], shape [N, 2] [m]."""
        share = self.shares(u)
        return np.column_stack([1.0 - share, share]) * self.height[self.ends]

    def shares(self, u: Floats) -> Floats:
        """Return where nodes stand between their `ends`, from 0 to 1, shape [N]."""
        low, high = self.ends.T
        span = u[high] - u[low]
        return np.divide(u - u[low], span, out=np.zeros(len(u)), where=span > 0.0)

    def normals(self, x: Floats) -> Floats:
        """Return n of the crossings for points at `x` [P, 3], shape [C, 3]."""
        n = np.zeros((len(self.crossings), 3))
        _normals(self.crossings, self.point_nodes, self.side, self.before, self.after, self.node_point, x, n)
        return n


@dataclass(frozen=True)
class CentreLines:
    """Where the centre lines of yarns are while the order of nodes stays as it is."""

    place: Ints  # row of `through` in which each node's centre is, shape [N]
    point: Ints  # of each node, shape [N]
    offsets: Offsets | None  # from the points to the centres; None where no yarn has crimp

    def through(self, x: Floats, u: Floats) -> Floats:
        """Return the centres for x [P, 3] and u [N]: one for each node [N, 3], or x itself where no yarn has crimp."""
        if (o := self.offsets) is None:
            return x
        return x[self.point] + np.einsum("ns,nsk->nk", o.weights(u), o.normals(x)[o.source])


def centre_lines(model: YarnModel, state: YarnState, chain: "Chain") -> CentreLines:
    """Return the centre lines for the state's order of nodes, whose EoL nodes are those of `chain`."""
    crossings = np.flatnonzero(state.active & (model.height[model.point_nodes[:, 0]] != 0.0))
    if len(crossings) == 0:
        return CentreLines(model.node_point, model.node_point, None)
    number = np.zeros(model.point_count, np.int64)
    number[crossings] = np.arange(len(crossings))
    ends = np.column_stack([np.arange(model.node_count)] * 2)
    _stand_between(model.node_start, model.height, state.order, state.active, model.node_point, ends)
    offsets = Offsets(crossings, model.point_nodes, model.side, chain.before, chain.after, model.node_point, model.height, ends,
                      number[model.node_point[ends]])
    return CentreLines(np.arange(model.node_count), model.node_point, offsets)


def crimped_coordinates(model: YarnModel, state: YarnState, chain: "Chain") -> Floats:
    """Return u of all nodes with which centre lines are as much stretched as the yarns through x are now, shape [N] [m].

    So a weave laid out flat and free of tension becomes one of longer yarns, crimped and free of tension.
    """
    lines, u = centre_lines(model, state, chain), state.u.copy()
    centre = lines.through(state.x, state.u)[lines.place]
    flat = state.x[model.node_point]
    for first, last in zip(model.node_start[:-1], model.node_start[1:], strict=True):
        nodes = state.order[first:last]
        through_x, along = (np.linalg.norm(np.diff(p[nodes], axis=0), axis=1) for p in (flat, centre))
        longer = np.divide(along, through_x, out=np.ones(len(along)), where=through_x > 0.0)
        u[nodes[1:]] = u[nodes[:1]] + np.cumsum(longer * np.diff(state.u[nodes]))
    return u


@njit(cache=True)
def _normals(crossings, point_nodes, side, before, after, node_point, x, normals):
    t0, t1 = np.empty(3), np.empty(3)
    for c in range(len(crossings)):
        i, j = point_nodes[crossings[c]]
        normal(i, j, side[crossings[c]], before, after, node_point, x, x[:, 0], t0, t1, normals[c])


@njit(cache=True)
def _stand_between(node_start, height, order, active, node_point, ends):
    """Say of active nodes between crossings, and between these and the ends of the yarn, which two of them they are between."""
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
                for f in range(known + 1, e):
                    ends[order[f], 0], ends[order[f], 1] = order[known], i
            known = e
