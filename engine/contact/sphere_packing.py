"""Which parts of yarns may collide in a step: spheres along them, searched by cells (Sánchez-Banderas 2020, sec. 5).

The model puts yarns that touch on one point and neglects their thickness: at every crossing, and between all layers of a
stack, spheres of different yarns overlap and must not push. So pairs are left out that are near each other in the
*network* of yarns and the points that join them: a few radii and segments away along yarns, changing from yarn to yarn at
joints for nothing. That holds for neighbours along one yarn, for the yarns of a crossing and for layers at any depth of a
stack, and ends by itself where contacts end. A contact that was removed stays a joint until its yarns are clear of each
other, or layers that part would be thrown apart.

Yarns that overlap at the start without being joined keep the distance that they have there.
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints
from engine.contact.collisions import CollisionPairs
from engine.contact.network import around, network_of, spread
from engine.yarns.model import YarnModel, YarnState
from engine.yarns.topology import Chain, chain_of

NEAR_RADII, NEAR_CROSSINGS = 4.0, 2.0  # length along yarns within which the network joins, in radii plus crossing spacings
SLACK = 0.25  # pairs are watched that are this far beyond contact, in the sum of their radii, besides what they may move


@dataclass(frozen=True)
class Collisions:
    """How yarns collide that no contact point joins."""

    thickness: float  # distance at which centre lines begin to push, over the sum of the yarns' radii
    stiffness: float  # of contact, over stretch stiffness / rest segment of the softer yarn
    spacing: float  # of spheres along a yarn at most, in its radii
    overlapping: Ints  # pairs of yarns a <= b that overlap at the start, as a * yarns + b, ascending, shape [O]
    kept: Floats  # the distance that these keep [m], shape [O]


@dataclass(frozen=True)
class Spheres:
    """S spheres along EoL segments, yarn after yarn."""

    node: Ints  # EoL nodes at both ends of the segment, shape [S, 2]
    share: Floats  # of the second end, shape [S]
    centre: Floats  # [m], shape [S, 3]
    motion: Floats  # in the step, if velocities stay as they are [m], shape [S, 3]


def collisions_at_start(
    model: YarnModel, state: YarnState, thickness: float, stiffness: float, spacing: float
) -> Collisions:
    """Return how yarns collide whose state at the start is given."""
    nothing = Collisions(thickness, stiffness, spacing, np.zeros(0, np.int64), np.zeros(0))
    chain = chain_of(model, state.order, state.eil, state.active)
    spheres = spheres_of(nothing, model, state, chain, 0.0)
    first, second = touching(nothing, model, state, spheres, slack=0.0).T
    distance = np.linalg.norm(spheres.centre[first] - spheres.centre[second], axis=1)
    deep = distance < (1.0 - 1e-9) * thickness * (_radius(model, spheres, first) + _radius(model, spheres, second))
    pair = _pair(model, spheres, first[deep], second[deep])
    overlapping, number = np.unique(pair, return_inverse=True)
    kept = np.full(len(overlapping), np.inf)
    np.minimum.at(kept, number, distance[deep])
    return replace(nothing, overlapping=overlapping, kept=kept)


def collision_pairs(
    collisions: Collisions, model: YarnModel, state: YarnState, chain: Chain, h: float
) -> CollisionPairs:
    """Return the pairs that may collide in a step of `h` [s]; contacts that are clear stop being joints in `state`."""
    release(collisions, model, state, chain)
    spheres = spheres_of(collisions, model, state, chain, h)
    first, second = touching(collisions, model, state, spheres, SLACK).T
    rest = collisions.thickness * (_radius(model, spheres, first) + _radius(model, spheres, second))
    if len(collisions.overlapping):
        pair = _pair(model, spheres, first, second)
        at = np.minimum(np.searchsorted(collisions.overlapping, pair), len(collisions.overlapping) - 1)
        rest = np.where(collisions.overlapping[at] == pair, collisions.kept[at], rest)
    scale = np.where(model.kinematic, np.inf, model.stretch_stiffness / model.rest_segment)
    share = spheres.share[first], spheres.share[second]
    return CollisionPairs(
        point=model.node_point[np.column_stack([spheres.node[first], spheres.node[second]])],
        weight=np.column_stack([1.0 - share[0], share[0], share[1] - 1.0, -share[1]]),
        rest=rest,
        stiffness=collisions.stiffness * np.minimum(*(scale[_yarn(model, spheres, s)] for s in (first, second))),
    )


def spheres_of(collisions: Collisions, model: YarnModel, state: YarnState, chain: Chain, h: float) -> Spheres:
    """Return spheres at every EoL node and so many between that they are no further apart than their spacing."""
    inner = chain.node[chain.after[chain.node] >= 0]
    last = chain.node[(chain.after[chain.node] < 0) & (chain.before[chain.node] >= 0)]
    spacing = collisions.spacing * model.radius[model.node_yarn[inner]]
    pieces = np.maximum(np.ceil((state.u[chain.after[inner]] - state.u[inner]) / spacing - 1e-9), 1.0).astype(np.int64)
    piece = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    begin = np.concatenate([np.repeat(inner, pieces), chain.before[last]])
    share = np.concatenate([piece / np.repeat(pieces, pieces), np.ones(len(last))])
    stored = np.lexsort((share, state.u[begin], model.node_yarn[begin]))
    node = np.column_stack([begin, chain.after[begin]])[stored]
    share = share[stored]
    ends = model.node_point[node]
    weight = np.column_stack([1.0 - share, share])
    material = np.stack([state.velocity[node[:, 0], 1], state.velocity[node[:, 1], 0]], axis=1)
    rate = np.where(model.kinematic[model.node_yarn[node]][:, :, None], state.x_rate[ends], material)
    return Spheres(node, share, np.einsum("se,sek->sk", weight, state.x[ends]), h * np.einsum("se,sek->sk", weight, rate))


def touching(collisions: Collisions, model: YarnModel, state: YarnState, spheres: Spheres, slack: float) -> Ints:
    """Return the pairs of spheres that are, or may come, nearer than contact and that no network joins, shape [C, 2]."""
    if not len(spheres.share):
        return np.zeros((0, 2), np.int64)
    motion = spheres.motion - spheres.motion.mean(axis=0)
    radius = collisions.thickness * _radius(model, spheres, slice(None))
    widest = 2.0 * ((1.0 + slack) * radius.max() + np.linalg.norm(motion, axis=1).max())
    cell = np.floor((spheres.centre - spheres.centre.min(axis=0)) / widest).astype(np.int64) + 1
    along = cell.max(axis=0) + 2
    key = (cell[:, 0] * along[1] + cell[:, 1]) * along[2] + cell[:, 2]
    stored = np.argsort(key, kind="stable")
    reach = NEAR_RADII * model.radius + NEAR_CROSSINGS * model.crossing_spacing
    network = network_of(model, state)
    beside = model.node_point[around(network, spheres.node, spheres.share, state.u)]
    yarn = _yarn(model, spheres, slice(None))
    return _search(beside, spheres.centre, motion, radius, 1.0 + slack, model.kinematic[yarn], reach[yarn], state.u,
                   model.node_point, model.point_nodes, network, key, key[stored], stored, along[1], along[2])


def release(collisions: Collisions, model: YarnModel, state: YarnState, chain: Chain) -> None:
    """Forget removed contacts whose yarns are clear of each other where they touched."""
    points = np.flatnonzero(state.parting)
    if len(points):
        first, second = model.point_nodes[points].T
        apart = np.linalg.norm(place(model, state, chain, first) - place(model, state, chain, second), axis=1)
        clear = collisions.thickness * (model.radius[model.node_yarn[first]] + model.radius[model.node_yarn[second]])
        state.parting[points[apart >= clear]] = False


def place(model: YarnModel, state: YarnState, chain: Chain, node: Ints) -> Floats:
    """Return where yarns are at the u of `node` [n], which may have been removed; beyond an end, at the end, [n, 3]."""
    found = np.empty((len(node), 3))
    for i, n in enumerate(node):
        y = model.node_yarn[n]
        own = chain.node[chain.start[y] : chain.start[y + 1]]
        found[i] = [np.interp(state.u[n], state.u[own], state.x[model.node_point[own], k]) for k in range(3)]
    return found


def _yarn(model, spheres, which):
    return model.node_yarn[spheres.node[which, 0]]


def _radius(model, spheres, which):
    return model.radius[_yarn(model, spheres, which)]


def _pair(model, spheres, first, second):
    a, b = _yarn(model, spheres, first), _yarn(model, spheres, second)
    return np.minimum(a, b) * model.yarn_count + np.maximum(a, b)


@njit(cache=True)
def _search(beside, centre, motion, radius, widened, given, reach, u, node_point, point_nodes, network, key, sorted_key,
            stored, along_y, along_z):
    """Pairs in ascending order of their first sphere, and then cell by cell: the same on every run.

    `beside` [S, 2] are the points of the network around each sphere, `given` [S] says whose yarn has a given shape.
    """
    pairs = np.empty((max(len(centre), 64), 2), np.int64)
    count = interval = 0
    spread_from = -1
    joined = np.full(len(point_nodes), -1, np.int64)  # the interval from which a point was reached last
    left, waiting = np.zeros(len(point_nodes)), np.zeros(len(point_nodes), np.bool_)
    queue = np.empty(len(point_nodes) + 1, np.int64)
    for a in range(len(centre)):
        if a > 0 and (beside[a, 0] != beside[a - 1, 0] or beside[a, 1] != beside[a - 1, 1]):
            interval = a
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                row = key[a] + (dx * along_y + dy) * along_z
                at = np.searchsorted(sorted_key, row - 1)
                while at < len(stored) and sorted_key[at] <= row + 1:
                    b = stored[at]
                    at += 1
                    if b <= a or (given[a] and given[b]):
                        continue
                    square = closing = 0.0
                    for k in range(3):
                        square += (centre[a, k] - centre[b, k]) ** 2
                        closing += (motion[a, k] - motion[b, k]) ** 2
                    if square >= (widened * (radius[a] + radius[b]) + np.sqrt(closing)) ** 2:
                        continue
                    if spread_from != interval:
                        spread_from = interval
                        spread(beside[a, 0], beside[a, 1], reach[a], interval, network, u, node_point, point_nodes, joined,
                               left, waiting, queue)
                    if joined[beside[b, 0]] == interval or joined[beside[b, 1]] == interval:
                        continue
                    if count == len(pairs):
                        grown = np.empty((2 * count, 2), np.int64)
                        grown[:count] = pairs
                        pairs = grown
                    pairs[count, 0], pairs[count, 1] = a, b
                    count += 1
    return pairs[:count].copy()
