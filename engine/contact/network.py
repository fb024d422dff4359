"""The network of yarns and the points that join them, and what is near in it."""

from typing import NamedTuple

import numpy as np
from numba import njit

from engine.arrays import Ints
from engine.yarns.model import YarnModel, YarnState


class Network(NamedTuple):
    """Neighbours of nodes along their yarns, among nodes at points that join: those in use or still parting."""

    before: Ints  # -1 for none, shape [N]
    after: Ints  # -1 for none, shape [N]


def network_of(model: YarnModel, state: YarnState) -> Network:
    """Return the network of a state."""
    joins = (state.active | state.parting)[model.node_point]
    node = state.order[joins[state.order]]
    together = model.node_yarn[node[:-1]] == model.node_yarn[node[1:]]
    before, after = np.full(model.node_count, -1, np.int64), np.full(model.node_count, -1, np.int64)
    after[node[:-1][together]] = node[1:][together]
    before[node[1:][together]] = node[:-1][together]
    return Network(before, after)


@njit(cache=True)
def around(network, segment, share, u):
    """Return the nodes of the network around places at `share` [S] of segments between nodes [S, 2], shape [S, 2].

    Between the EoL nodes of a segment there may be others that join, EIL nodes.
    """
    found = segment.copy()
    for s in range(len(share)):
        here = u[segment[s, 0]] + share[s] * (u[segment[s, 1]] - u[segment[s, 0]])
        n = segment[s, 0]
        while network.after[n] != segment[s, 1] and u[network.after[n]] <= here:
            n = network.after[n]
        found[s, 0], found[s, 1] = n, network.after[n]
    return found


@njit(cache=True)
def spread(first, second, reach, mark, network, u, node_point, point_nodes, joined, left, waiting, queue):
    """Write `mark` to `joined` [P] at all points within `reach` [m] of two of them, along yarns.

    `left` [P], `waiting` [P] (all false) and `queue` [P + 1] are scratch: what is left of the reach, and what is to do.
    """
    head = tail = 0
    for p in (first, second):
        if joined[p] != mark:
            joined[p], left[p], waiting[p] = mark, reach, True
            queue[tail] = p
            tail += 1
    while head != tail:
        p = queue[head]
        head = (head + 1) % len(queue)
        waiting[p] = False
        for n in point_nodes[p]:
            if n < 0:
                continue
            for m in (network.before[n], network.after[n]):
                if m >= 0:
                    q = node_point[m]
                    rest = left[p] - abs(u[m] - u[n])
                    if rest >= 0.0 and (joined[q] != mark or rest > left[q]):
                        joined[q], left[q] = mark, rest
                        if not waiting[q]:
                            waiting[q] = True
                            queue[tail] = q
                            tail = (tail + 1) % len(queue)
