"""Where edges of strands are near each other at the start of a step, or come to touch in it.

Where one strand slides along the other and over a vertex of it, the edge ahead would first be met at that vertex, with a normal
that leans back: a bump on a line that has none. Only the edge that is then nearer has the contact.
"""

import numpy as np
from numba import njit, prange

from engine.arrays import Floats, Ints
from engine.geometry.moving_segments import first_near
from engine.geometry.segment_distance import nearest_on_segments

DEEP = 0.9  # of the distance at the start, or at which two touch: edges in contact that come nearer pass through each other
SLACK = 0.01  # of the distance at which two touch, by which edges in contact may come nearer in a step
COINCIDENT = 1e-9  # distance, in that at which edges touch, that says nothing about which side of each other they are on
CROSSING = 0.5  # cosine between edges below which they cross, and do not lie side by side
LEVEL = 0.05  # of the distance at which edges touch, by which it changes along what lies side by side
LOOP = np.pi / 2  # least length of strand between two of its edges that touch, in the distance at which they do


def find(
    pairs: Ints, x: Floats, motion: Floats, radius: Floats, near: Floats, strand: Ints, along: Floats, known: Ints
) -> tuple[Ints, Floats, Floats, Floats]:
    """Return edges [M, 2], shares of them [M, 2], shares of the way [M] and distances at its start [M] [m] of meetings.

    `pairs` [P, 2] of edges, by their first vertices, are looked at while vertices go from x [V, 3] along `motion` [V, 3] [m].
    They are near, at the start, within the sum of `near` [V], and touch within that of `radius` [V] [m]. `strand` [V] and `along`
    [V] [m] are where vertices are. `known` are the keys (a << 32) + b of contacts that there are, ascending.
    """
    share, time, before = np.empty((len(pairs), 2, 2)), np.empty((len(pairs), 2)), np.empty(len(pairs))
    _meet(pairs, x, motion, radius, near, strand, along, known, share, time, before)
    pair, number = np.nonzero(time <= 1.0)
    return pairs[pair], share[pair, number], time[pair, number], before[pair]


@njit(cache=True, parallel=True, error_model="numpy")
def _meet(pairs, x, motion, radius, near, strand, along, known, share, time, before):
    """Write what `_meeting` returns of all pairs, to which there are `known` keys of contacts or not."""
    for p in prange(len(pairs)):
        a, b = pairs[p, 0], pairs[p, 1]
        key = (a << 32) + b
        met = np.searchsorted(known, key + 1) - np.searchsorted(known, key)
        time[p] = np.inf
        touch = radius[a] + radius[b]
        if not _is_one_piece(a, b, strand, along, LOOP * touch):
            before[p] = _meeting(a, b, x, motion, touch, near[a] + near[b], strand, along, met > 0, share[p], time[p])


@njit(cache=True, error_model="numpy")
def _meeting(a, b, x, motion, touch, near, strand, along, met, share, time):
    """Write where edges a and b are near at the start, and where they touch on the way, shares [2, 2] of them and times [2].

    These stay as they are where the edges are not or do not. Edges that have `met` have a contact. Returns the distance at the
    start.
    """
    ends, beyond = np.empty((4, 3)), np.empty((4, 3))
    s, t, square = nearest_on_segments(x[a], x[a + 1], x[b], x[b + 1])
    distance = np.sqrt(square)
    if not met and distance <= near:
        met = True
        s, t = _middle(x, a, b, s, t, distance + LEVEL * touch)
        next_has_it = _is_next(s, a, strand) or _is_next(t, b, strand)
        if not (next_has_it or _nearer_beyond(x, motion, 0.0, a, b, s, t, square, strand, along, LOOP * touch, beyond)):
            share[0, 0], share[0, 1], time[0] = s, t, 0.0
    if distance <= COINCIDENT * touch:
        return distance
    when = first_near(x, motion, a, b, DEEP * min(distance, touch) if met else touch, ends)
    if when <= 1.0 and not met:
        s, t, square = nearest_on_segments(ends[0], ends[1], ends[2], ends[3])
        if _nearer_beyond(x, motion, when, a, b, s, t, square, strand, along, LOOP * touch, beyond):
            met = True  # by the strand, on another edge
            when = first_near(x, motion, a, b, DEEP * touch, ends)
    if when > 1.0 and met:  # places and normals of contacts are those that they were made with, and edges slide and turn
        for k in range(3):
            ends[0, k], ends[1, k] = x[a, k] + motion[a, k], x[a + 1, k] + motion[a + 1, k]
            ends[2, k], ends[3, k] = x[b, k] + motion[b, k], x[b + 1, k] + motion[b + 1, k]
        least = min(distance, touch) - SLACK * touch
        s, t, square = nearest_on_segments(ends[0], ends[1], ends[2], ends[3])
        if square < least * least and not _nearer_beyond(
            x, motion, 1.0, a, b, s, t, square, strand, along, LOOP * touch, beyond
        ):
            when = 1.0
    if when <= 1.0:
        s, t, _ = nearest_on_segments(ends[0], ends[1], ends[2], ends[3])
        share[1, 0], share[1, 1], time[1] = s, t, when
    return distance


@njit(cache=True)
def _is_next(share, edge, strand):
    """Whether a place on an edge is the start of the next edge, which then has the contact."""
    return share == 1.0 and edge + 2 < len(strand) and strand[edge + 2] == strand[edge]


@njit(cache=True)
def _is_one_piece(a, b, strand, along, loop):
    """Whether edges are of one strand, with less than `loop` [m] of it between them."""
    return strand[a] == strand[b] and along[max(a, b)] - along[min(a, b) + 1] < loop


@njit(cache=True)
def _nearer_beyond(x, motion, time, a, b, s, t, square, strand, along, loop, ends):
    """Whether edges nearest at a vertex, at a share `time` of the way, have a neighbour there that comes nearer to the other.

    `s` and `t` are where edges a and b are nearest, and `square` how near [m^2]; `ends` [4, 3] is scratch.
    """
    for side in range(2):
        edge, share = (a, s) if side == 0 else (b, t)
        neighbour = edge - int(share == 0.0) + int(share == 1.0)
        if neighbour == edge or neighbour < 0 or neighbour + 1 == len(strand):
            continue
        first, second = (neighbour, b) if side == 0 else (a, neighbour)
        outside = strand[neighbour] != strand[edge] or strand[neighbour + 1] != strand[edge]
        if outside or _is_one_piece(first, second, strand, along, loop):
            continue
        for k in range(3):
            for e in range(2):
                ends[e, k] = x[first + e, k] + time * motion[first + e, k]
                ends[2 + e, k] = x[second + e, k] + time * motion[second + e, k]
        there_first, there_second, there = nearest_on_segments(ends[0], ends[1], ends[2], ends[3])
        at = there_first if side == 0 else there_second
        if there < square and at != 1.0 - share:  # not at the vertex that they have in common
            return True
    return False


@njit(cache=True)
def _middle(x, a, b, s, t, most):
    """Return the middle of what of edge a lies beside edge b, where its ends are no further than `most` [m], else s and t.

    Edges that cross have one place at which they are nearest: only there is the normal across both.
    """
    if _cosine(x, a, b) < CROSSING:
        return s, t
    first, second = beside(x, a, b)
    places = np.empty((2, 3))
    for k in range(3):
        places[0, k] = (1.0 - first) * x[a, k] + first * x[a + 1, k]
        places[1, k] = (1.0 - second) * x[a, k] + second * x[a + 1, k]
    other = np.empty(2)
    for e in range(2):
        _, other[e], square = nearest_on_segments(places[e], places[e], x[b], x[b + 1])
        if square > most * most:
            return s, t
    return 0.5 * (first + second), 0.5 * (other[0] + other[1])


@njit(cache=True)
def _cosine(x, a, b):
    """Return the absolute cosine between the directions of edges a and b."""
    first = second = mixed = 0.0
    for k in range(3):
        p, q = x[a + 1, k] - x[a, k], x[b + 1, k] - x[b, k]
        first += p * p
        second += q * q
        mixed += p * q
    return abs(mixed) / np.sqrt(first * second)


@njit(cache=True)
def beside(x, a, b):
    """Return the shares of edge a, ascending, between which it lies beside edge b: where the ends of b are nearest to a."""
    shares = np.empty(2)
    for e in range(2):
        along = square = 0.0
        for k in range(3):
            edge = x[a + 1, k] - x[a, k]
            along += edge * (x[b + e, k] - x[a, k])
            square += edge * edge
        shares[e] = min(max(along / square, 0.0), 1.0)
    return min(shares[0], shares[1]), max(shares[0], shares[1])


@njit(cache=True)
def length_beside(x, edge):
    """Return the length of the first edges that lies beside the second ones of pairs [C, 2], shape [C] [m]."""
    length = np.empty(len(edge))
    for c in range(len(edge)):
        a = edge[c, 0]
        first, second = beside(x, a, edge[c, 1])
        whole = 0.0
        for k in range(3):
            whole += (x[a + 1, k] - x[a, k]) ** 2
        length[c] = (second - first) * np.sqrt(whole)
    return length
