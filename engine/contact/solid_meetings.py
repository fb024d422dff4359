"""Where strands are near a solid at the start of a step, or come to touch it in it: at vertices, and within edges over a bulge.

Positions and motions are relative to the solid. A distance falls by no more than what a place moves, or a little faster where it
is sampled, so that time may go on by the distance that is left over the speed and nothing is passed over.
"""

import numpy as np
from numba import njit

from engine.contact.edge_meetings import SLACK
from engine.geometry.solids import SAMPLED, distance_to

DEEP = 0.5  # of the radius, by which a place in contact that comes nearer than it was passes through
CLOSE = 0.01  # of the radius, within which a distance is reached
ADVANCES = 200  # after which what grazes a solid counts as near
BULGE = 0.01  # of the radius, by which a place within an edge is nearer than its ends if it is in contact of its own
STEEP = np.sqrt(2.0)  # slope of a sampled distance at most, beyond its grid
GOLDEN = 0.6180339887498949
NARROWINGS = 24  # of the part of an edge that holds the place nearest to a solid, to 1e-5 of it


@njit(cache=True, error_model="numpy")
def at_vertices(solids, o, x, motion, radius, near, known):
    """Return vertices [M], shares of the way [M], normals [M, 3], distances there and at the start [M] [m] of meetings.

    Vertices go from x [V, 3] along `motion` [V, 3] [m] by solid o of `solids`. They are near, at the start, within `near` [V] of
    it, and touch within `radius` [V] [m]. `known` [V] is how many contacts there are.
    """
    vertex, time, normal = np.empty(2 * len(x), np.int64), np.empty(2 * len(x)), np.empty((2 * len(x), 3))
    there, before, count = np.empty(2 * len(x)), np.empty(2 * len(x)), 0
    outward, place = np.empty(3), np.empty(3)
    slope = STEEP if solids.kind[o] == SAMPLED else 1.0
    for v in range(len(x)):
        distance = distance_to(solids, o, x[v], outward)
        met = known[v]
        if met == 0 and distance <= near[v]:
            met = 1
            vertex[count], time[count], there[count], before[count] = v, 0.0, distance, distance
            _unit(outward, normal[count])
            count += 1
        limit = radius[v] if met == 0 else min(distance, radius[v]) - DEEP * radius[v]
        speed, when, now = slope * np.sqrt(motion[v, 0] ** 2 + motion[v, 1] ** 2 + motion[v, 2] ** 2), 0.0, distance
        for _ in range(ADVANCES):
            if now - limit <= CLOSE * radius[v] or now - limit >= (1.0 - when) * speed:
                break
            when += (now - limit) / speed
            for k in range(3):
                place[k] = x[v, k] + when * motion[v, k]
            now = distance_to(solids, o, place, outward)
        reached = now - limit < (1.0 - when) * speed or now - limit <= CLOSE * radius[v]
        if not reached and met > 0:  # the normal is that of where the contact was made, and the place slides over what is round
            when = 1.0
            for k in range(3):
                place[k] = x[v, k] + motion[v, k]
            now = distance_to(solids, o, place, outward)
            reached = now < min(distance, radius[v]) - SLACK * radius[v]
        if reached:
            vertex[count], time[count], there[count], before[count] = v, when, now, distance
            _unit(outward, normal[count])
            count += 1
    return vertex[:count], time[:count], normal[:count], there[:count], before[:count]


@njit(cache=True, error_model="numpy")
def within_edges(solids, o, x, motion, radius, near, edges, known):
    """Return edges [M], shares of them [M], and the rest as `at_vertices` does, of meetings within `edges` [E] over a bulge."""
    edge, share = np.empty(2 * len(edges), np.int64), np.empty(2 * len(edges))
    time, normal = np.empty(2 * len(edges)), np.empty((2 * len(edges), 3))
    there, before, count = np.empty(2 * len(edges)), np.empty(2 * len(edges)), 0
    outward, ends = np.empty(3), np.empty((2, 3))
    slope = STEEP if solids.kind[o] == SAMPLED else 1.0
    for v in edges:
        speed, length = 0.0, 0.0
        for k in range(3):
            length += (x[v + 1, k] - x[v, k]) ** 2
        for e in range(2):
            speed = max(speed, motion[v + e, 0] ** 2 + motion[v + e, 1] ** 2 + motion[v + e, 2] ** 2)
        speed = slope * np.sqrt(speed)
        ends[:] = x[v : v + 2]
        if distance_to(solids, o, 0.5 * (ends[0] + ends[1]), outward) > near[v] + speed + 0.5 * slope * np.sqrt(length):
            continue
        s, distance, bulge = _nearest(solids, o, ends, outward)
        met = known[v]
        if met == 0 and distance <= near[v]:
            met = 1
            if bulge > BULGE * radius[v]:
                edge[count], share[count], time[count], there[count], before[count] = v, s, 0.0, distance, distance
                _unit(outward, normal[count])
                count += 1
        limit = radius[v] if met == 0 else min(distance, radius[v]) - DEEP * radius[v]
        when, now = 0.0, distance
        for _ in range(ADVANCES):
            if now - limit <= CLOSE * radius[v] or now - limit >= (1.0 - when) * speed:
                break
            when += (now - limit) / speed
            for e in range(2):
                for k in range(3):
                    ends[e, k] = x[v + e, k] + when * motion[v + e, k]
            s, now, bulge = _nearest(solids, o, ends, outward)
        reached = now - limit < (1.0 - when) * speed or now - limit <= CLOSE * radius[v]
        if reached and bulge <= BULGE * radius[v]:  # at a vertex, which has the contact; what is between may follow
            reached, met = False, 1
        if not reached and met > 0:
            when = 1.0
            for e in range(2):
                for k in range(3):
                    ends[e, k] = x[v + e, k] + motion[v + e, k]
            s, now, bulge = _nearest(solids, o, ends, outward)
            reached = now < min(distance, radius[v]) - SLACK * radius[v]
        if reached and bulge > BULGE * radius[v]:
            edge[count], share[count], time[count], there[count], before[count] = v, s, when, now, distance
            _unit(outward, normal[count])
            count += 1
    return edge[:count], share[:count], time[:count], normal[:count], there[:count], before[:count]


@njit(cache=True, error_model="numpy")
def _nearest(solids, o, ends, outward):
    """Share of the edge between `ends` [2, 3] that is nearest to solid o, its distance, and by how much that is nearer than both.

    The gradient there is left in `outward`. Of a solid that is not convex it may be one of several places nearer than what is
    around them.
    """
    low, high = 0.0, 1.0
    place = np.empty(3)
    border = min(distance_to(solids, o, ends[0], outward), distance_to(solids, o, ends[1], outward))
    s, t = 1.0 - GOLDEN, GOLDEN
    at_s, at_t = _distance(solids, o, ends, s, place, outward), _distance(solids, o, ends, t, place, outward)
    for _ in range(NARROWINGS):
        if at_s <= at_t:
            high, t, at_t = t, s, at_s
            s = high - GOLDEN * (high - low)
            at_s = _distance(solids, o, ends, s, place, outward)
        else:
            low, s, at_s = s, t, at_t
            t = low + GOLDEN * (high - low)
            at_t = _distance(solids, o, ends, t, place, outward)
    s = 0.5 * (low + high)
    distance = _distance(solids, o, ends, s, place, outward)
    return s, distance, border - distance


@njit(cache=True, error_model="numpy")
def _distance(solids, o, ends, share, place, outward):
    for k in range(3):
        place[k] = (1.0 - share) * ends[0, k] + share * ends[1, k]
    return distance_to(solids, o, place, outward)


@njit(cache=True, error_model="numpy")
def _unit(outward, normal):
    length = np.sqrt(outward[0] ** 2 + outward[1] ** 2 + outward[2] ** 2)
    for k in range(3):
        normal[k] = outward[k] / length
