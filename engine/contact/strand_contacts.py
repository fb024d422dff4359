"""Where strands touch each other and solids within a step, found without passing anything over (Fei 2019, sec. 13.6).

Pairs that are near at the start of a step are in contact with the shape they have there. All others, and those that come much
nearer than they were, are in contact where they first touch on the way that the step would take. A contact has the places on the
strands and the normal that it was made with. Where sides slide and turn so far that they would end nearer than they began, they
meet anew where they end; that takes the place of the contact close by, or is one more.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from engine.arrays import Flags, Floats, Ints
from engine.contact import edge_meetings, solid_meetings
from engine.contact.obstacles import ObstacleMotion
from engine.geometry.near_segments import NearSegments
from engine.geometry.segment_distance import nearest_on_segments
from engine.geometry.solids import moved_along
from engine.strands.model import StrandModel

ASTRAY = 0.5  # of the least radius, that vertices may stray from where they are expected before near edges are searched again
NEAR = 0.05  # of the distance at which two touch, within which they are in contact from the start
MENDING = 5e-3  # time in which an overlap is taken back [s]
MOST = 0.1  # of the distance at which two touch, that is taken back of an overlap in that time
YIELDS = 0.1  # sum of the squared shares of a contact that vertices have which can move, from which on overlaps are taken back
CLOSE_BY = 0.1  # of an edge, within which a new contact of the same edges takes the place of another
SOLID = -1  # second edge of a contact with solid number 0; that with number o is SOLID - o


class Contacts(NamedTuple):
    """C contacts; with w the displacement in the step of the first side relative to the second, apart + n.w is to be >= kept."""

    edge: Ints  # first vertices of the edges that touch, the second one SOLID - o where it is solid o, shape [C, 2]
    share: Floats  # of the edges, from their first vertices, shape [C, 2]
    normal: Floats  # n, towards the first side, shape [C, 3]
    apart: Floats  # distance of centre lines along n, or of a centre line to a solid, at the start [m], shape [C]
    touch: Floats  # that at which the two touch [m], shape [C]
    kept: Floats  # that which they keep [m], shape [C]
    mended: Floats  # of this, what takes back an overlap at the start [m], shape [C]
    carried: Floats  # what the second side moves in the step where it is a solid [m], shape [C, 3]
    friction: Floats  # Coulomb coefficient, shape [C]
    force: Floats  # on the first side [N], shape [C, 3]

    @property
    def key(self) -> Ints:
        """Numbers that name the edges of contacts, or the vertex or edge that touches a solid, shape [C]."""
        share = self.share[:, 0]
        place = np.where(self.edge[:, 1] >= 0, 0, (share > 0.0) + (share == 1.0).astype(np.int64))
        return ((4 * self.edge[:, 0] + place) << 32) + self.edge[:, 1]

    def displaced(self, moved: Floats) -> Floats:
        """Return w where vertices move by `moved` [V, 3] [m], shape [C, 3]."""
        return _on(self.edge[:, :1], self.share[:, :1], moved)[:, 0] - self._second(moved) - self.carried

    def on_vertices(self, values: Floats, vertices: int, second: float = -1.0) -> Floats:
        """Return what `values` [C, n] of the first sides, times `second` of the second ones, add up to, shape [vertices, n]."""
        total = np.zeros((vertices, values.shape[1]))
        strands = self.edge[:, 1] >= 0
        for side, sign, which in ((0, 1.0, slice(None)), (1, second, strands)):
            edge, share, own = self.edge[which, side], self.share[which, side, None], sign * values[which]
            np.add.at(total, edge, (1.0 - share) * own)
            np.add.at(total, edge + 1, share * own)
        return total

    def overlap(self, x: Floats, moved: Floats) -> float:
        """Return how deep sides are in each other at most where vertices are at x and moved by `moved` [V, 3] [m].

        It is over the distance of touch; solids count as flat within the step.
        """
        solid = self.edge[:, 1] < 0
        left = 1.0 - (self.apart + np.einsum("ck,ck->c", self.normal, self.displaced(moved))) / self.touch
        return max(_deepest(self.edge, self.touch, x), float(left[solid].max(initial=0.0)))

    def pressing(self) -> tuple[Ints, Floats]:
        """Return the keys of contacts with a force, ascending, and the sum of forces [., 3] of each key [N]."""
        acts = np.any(self.force != 0.0, axis=1)
        key, number = np.unique(self.key[acts], return_inverse=True)
        force = np.zeros((len(key), 3))
        np.add.at(force, number, self.force[acts])
        return key, force

    def with_forces(self, key: Ints, force: Floats) -> "Contacts":
        """Return these contacts with the forces [n, 3] that their keys, among `key` [n], had before."""
        if not len(key):
            return self
        at = np.minimum(np.searchsorted(key, self.key), len(key) - 1)
        return self._replace(force=np.where((key[at] == self.key)[:, None], force[at], 0.0))

    def _second(self, values: Floats) -> Floats:
        strands = self.edge[:, 1] >= 0
        there = np.zeros((len(strands), 3))
        there[strands] = _on(self.edge[strands, 1:], self.share[strands, 1:], values)[:, 0]
        return there

    def renewed(self, met: "Contacts") -> "Contacts":
        """Return these contacts and those `met`, which take the place and the forces of those of the same edges close by.

        Constraints that say the same of places next to each other would leave it open which of them has the force.
        """
        if not len(met.edge):
            return self
        key, other = self.key, met.key
        order = np.argsort(other, kind="stable")
        at = order[np.minimum(np.searchsorted(other[order], key), len(other) - 1)]
        close = (other[at] == key) & (np.abs(self.share - met.share[at]).max(axis=1) < CLOSE_BY)
        np.add.at(met.force, at[close], self.force[close])
        return self.those(~close).and_also(met)

    def unmended(self, which: Flags) -> "Contacts":
        """Return these contacts, of which those `which` [C] take back none of their overlap, and begin without force."""
        return self._replace(
            kept=np.where(which, self.kept - self.mended, self.kept), mended=np.where(which, 0.0, self.mended),
            force=np.where(which[:, None], 0.0, self.force))

    def gap(self, moved: Floats) -> Floats:
        """Return how far sides are from the distance that they keep where vertices move by `moved` [V, 3], shape [C] [m]."""
        return self.apart + np.einsum("ck,ck->c", self.normal, self.displaced(moved)) - self.kept

    def may_press(self, tolerance: float, *ways: Floats) -> Flags:
        """Return which contacts press, or come to on one of the `ways` [V, 3] [m] that vertices may move, shape [C].

        They do where sides are within `tolerance` distances of touch of the distance that they keep.
        """
        acts = np.any(self.force != 0.0, axis=1)
        for way in ways:
            acts |= self.gap(way) <= tolerance * self.touch
        return acts

    def those(self, which: Flags) -> "Contacts":
        """Return the contacts `which` [C]."""
        return Contacts._make(values[which] for values in self)

    def with_those(self, which: Flags, those: "Contacts") -> "Contacts":
        """Return these contacts, of which those `which` [C] have become `those`, and keep only what these have of force."""
        kept, mended, force = self.kept.copy(), self.mended.copy(), np.zeros_like(self.force)
        kept[which], mended[which], force[which] = those.kept, those.mended, those.force
        return self._replace(kept=kept, mended=mended, force=force)

    def and_also(self, more: "Contacts") -> "Contacts":
        """Return these and more contacts, in the order of their edges."""
        both = [np.concatenate(arrays) for arrays in zip(self, more, strict=True)]
        order = np.lexsort((both[0][:, 1], both[0][:, 0]))
        return Contacts(*(array[order] for array in both))


def no_contacts() -> Contacts:
    """Return an empty set."""
    none, vectors = np.zeros(0), np.zeros((0, 3))
    return Contacts(np.zeros((0, 2), np.int64), np.zeros((0, 2)), vectors, none, none, none, none, vectors, none, vectors)


class Touching:
    """Finds the contacts of strands."""

    def __init__(self, model: StrandModel, reach: float):
        """Keep what does not change; strands whose surfaces are nearer than `reach` [m] are in contact at the start, too."""
        self.friction = model.friction
        self.last = np.zeros(len(model.mass), np.bool_)  # vertices of strands
        self.last[model.start[1:] - 1] = True
        self.segment = np.flatnonzero(~self.last)
        self.strand = np.repeat(np.arange(len(model.start) - 1), np.diff(model.start))
        self.radius = np.sqrt(model.radius[:, 0] * model.radius[:, 1])
        self.fixed: Flags = np.logical_and.reduce(model.held[:, :3], axis=1)
        self.along = np.concatenate([[0.0], np.cumsum(model.rest_length)[:-1]])
        self.around = (1.0 + NEAR) * self.radius + 0.5 * reach
        own = self.segment
        self.near = NearSegments(own, self.around[own], ASTRAY * self.radius[own].min(initial=np.inf))

    def strands_of(self, contacts: Contacts) -> Flags:
        """Return which strands have one of the contacts, shape [S]."""
        which = np.zeros(len(self.friction), np.bool_)
        which[self.strand[contacts.edge[:, 0]]] = True
        which[self.strand[contacts.edge[contacts.edge[:, 1] >= 0, 1]]] = True
        return which

    def between_strands(self, x: Floats, motion: Floats, h: float, known: Contacts) -> Contacts:
        """Return contacts of edges, beside those `known`, on the way along `motion` [V, 3] from x [V, 3] [m] in h [s].

        Two edges whose motion is given have none.
        """
        pairs = self.segment[self.near.along(x, motion)]
        given = self.fixed[pairs] & self.fixed[pairs + 1]
        edge, share, time, before = edge_meetings.find(
            pairs[~given.all(axis=1)], x, motion, self.radius, self.around, self.strand, self.along, np.sort(_keys(known.edge)))
        place = _on(edge, share, x)
        apart = place[:, 0] - place[:, 1]
        way = _on(edge, share, motion)
        moved = time[:, None] * (way[:, 0] - way[:, 1])
        distance = np.linalg.norm(apart + moved, axis=1)
        touch = self.radius[edge].sum(axis=1)
        one = distance <= edge_meetings.COINCIDENT * touch
        normal = np.where(one[:, None], _across(x, edge), (apart + moved) / np.where(one, 1.0, distance)[:, None])
        friction = np.sqrt(self.friction[self.strand[edge]].prod(axis=1))
        kept, mended = self._kept(before, touch, h, edge, share)
        return Contacts(edge, share, normal, distance - np.einsum("ck,ck->c", normal, moved), touch, kept, mended,
                        carried=np.zeros_like(normal), friction=friction, force=np.zeros_like(normal))

    def with_solids(self, x: Floats, motion: Floats, h: float, obstacles: ObstacleMotion, known: Contacts) -> Contacts:
        """Return contacts with solids, beside those `known`, on the way along `motion` [V, 3] from x [V, 3] [m] in h [s].

        Places whose motion is given have none.
        """
        inner = self.segment[~(self.fixed[self.segment] & self.fixed[self.segment + 1])]
        found = no_contacts()
        near = (1.0 + NEAR) * self.radius
        for o in range(len(obstacles.friction)):
            there = moved_along(obstacles.begin, obstacles.end, o, x)
            way = x + motion - there
            edge, share = known.edge[known.edge[:, 1] == SOLID - o, 0], known.share[known.edge[:, 1] == SOLID - o, 0]
            inside = (share > 0.0) & (share < 1.0)
            met = np.bincount(edge[~inside] + (share[~inside] == 1.0), minlength=len(x))
            vertex, *at_vertices = solid_meetings.at_vertices(obstacles.end, o, there, way, self.radius, near, met)
            met = np.bincount(edge[inside], minlength=len(x))
            edge, share, *within = solid_meetings.within_edges(obstacles.end, o, there, way, self.radius, near, inner, met)
            free = ~self.fixed[vertex]
            vertex, at_vertices = vertex[free], [values[free] for values in at_vertices]
            edge = np.concatenate([vertex - self.last[vertex], edge])
            share = np.concatenate([self.last[vertex].astype(float), share])
            time, normal, distance, before = (np.concatenate(both) for both in zip(at_vertices, within, strict=True))
            moved = time[:, None] * _on(edge[:, None], share[:, None], way)[:, 0]
            touch = self.radius[edge]
            kept, mended = self._kept(before, touch, h, edge[:, None], share[:, None])
            found = found.and_also(Contacts(
                edge=np.column_stack([edge, np.full(len(edge), SOLID - o)]),
                share=np.column_stack([share, np.zeros(len(edge))]),
                normal=normal,
                apart=distance - np.einsum("ck,ck->c", normal, moved),
                touch=touch,
                kept=kept,
                mended=mended,
                carried=_on(edge[:, None], share[:, None], there - x)[:, 0],
                friction=np.full(len(edge), obstacles.friction[o]),
                force=np.zeros_like(normal),
            ))
        return found

    def _kept(self, distance: Floats, touch: Floats, h: float, edge: Ints, share: Floats) -> tuple[Floats, Floats]:
        """The distance that contacts are to keep whose sides are so far apart at the start of the step, and what that mends.

        Overlaps are taken back in time, but not close to what is held, which may not yield.
        """
        overlap = touch - distance
        yields = ((1.0 - share) ** 2 * ~self.fixed[edge] + share**2 * ~self.fixed[edge + 1]).sum(axis=1) > YIELDS
        mended = np.minimum(overlap, MOST * touch) * min(h / MENDING, 1.0) * yields
        return np.where(overlap <= 0.0, touch, distance + mended), np.where(overlap <= 0.0, 0.0, mended)


def _keys(edge: Ints) -> Ints:
    """Numbers that name the edges of contacts between strands."""
    return (edge[:, 0] << 32) + edge[:, 1]


def _on(edge: Ints, share: Floats, values: Floats) -> Floats:
    """What `values` [V, 3] are at places on edges [C, n], shape [C, n, 3]."""
    return (1.0 - share[:, :, None]) * values[edge] + share[:, :, None] * values[edge + 1]


def _across(x: Floats, edge: Ints) -> Floats:
    """Unit vectors across the first edges, and across the second ones too where these are not parallel, shape [C, 3]."""
    along = (x[edge + 1] - x[edge]) / np.linalg.norm(x[edge + 1] - x[edge], axis=2)[:, :, None]
    both = np.cross(along[:, 0], along[:, 1])
    any_way = np.cross(along[:, 0], np.eye(3)[np.argmin(np.abs(along[:, 0]), axis=1)])
    normal = np.where((np.linalg.norm(both, axis=1) < 1e-3)[:, None], any_way, both)
    return normal / np.linalg.norm(normal, axis=1)[:, None]


@njit(cache=True)
def _deepest(edge, touch, x):
    """Return how deep edges at x [V, 3] [m] are in each other at most, over the distance of touch; solids are left out."""
    most = 0.0
    for c in range(len(touch)):
        a, b = edge[c, 0], edge[c, 1]
        if b >= 0:
            square = nearest_on_segments(x[a], x[a + 1], x[b], x[b + 1])[2]
            most = max(most, 1.0 - np.sqrt(square) / touch[c])
    return most
