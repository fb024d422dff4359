"""Stacked fabrics: which lies on which, and where their yarns touch at the start."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import radians, sin

import numpy as np

from engine.arrays import Flags, Floats, Ints
from engine.scene.plan import PlanCrossings, cross_in_plan, sine_of_angle
from engine.scene.schema import Contact, Fabric, Seam
from engine.scene.weave import Weave
from engine.yarns.assembly import YarnAssembly
from engine.yarns.model import PointKind

COUNTED = 8_000_000  # crossings of two grids that are looked at one by one
ROUND_OFF = 1e-9  # spacings: yarns that lack so little to touch do
_EDGES = {"left": (0, -1.0), "right": (0, 1.0), "bottom": (1, -1.0), "top": (1, 1.0)}  # axis across it, and its side


def levels(fabrics: Sequence[Fabric], contacts: Sequence[Contact]) -> dict[str, int]:
    """Return the number of fabrics below each fabric, by name; for a cycle, no less than the number of fabrics."""
    level = dict.fromkeys((fabric.name for fabric in fabrics), 0)
    for _ in fabrics:
        before = dict(level)
        for contact in contacts:
            level[contact.upper] = max(level[contact.upper], level[contact.lower] + 1)
        if level == before:
            break
    return level


def contact_count(contact: Contact, lower: Weave, upper: Weave) -> int:
    """Return the number of places where two patches touch; found without them where neither has an outline.

    Where there are more than `COUNTED` crossings of the grids, it is theirs: no outline makes that a scene of use.
    """
    of_grids = sum(crossings.count for _, _, crossings in _touching_families(contact, lower, upper))
    if (lower.kept is None and upper.kept is None) or of_grids > COUNTED:
        return of_grids
    return sum(len(touch.below) for touch in touches(contact, lower, upper))


@dataclass(frozen=True)
class Touches:
    """Where the yarns of one family of the lower patch touch those of one family of the upper patch."""

    families: tuple[int, int]  # of the lower and of the upper patch, 0 warps, 1 wefts
    below: Ints  # yarn of the family, shape [n]
    u: Floats  # place on it [m], shape [n]
    above: Ints
    v: Floats
    apart: Flags  # they would do so if they were longer; u and v are at their ends, shape [n]


def touches(contact: Contact, lower: Weave, upper: Weave) -> Iterator[Touches]:
    """Yield where yarns of two patches touch, or may come to, one pair of families after the other."""
    for a, b, crossings in _touching_families(contact, lower, upper):
        i, j = crossings.lines()
        u, v = crossings.distances(i, j)
        round_off = ROUND_OFF * lower.families[a].spacing
        below, u, far_below = lower.families[a].find_near(i, u - contact.reach, contact.reach + round_off)
        above, v, far_above = upper.families[b].find_near(j, v - contact.reach, contact.reach + round_off)
        both = (below >= 0) & (above >= 0)
        apart = np.maximum(far_below, far_above) > round_off
        yield Touches((a, b), below[both], u[both], above[both], v[both], apart[both])


def add_contacts(
    assembly: YarnAssembly, contact: Contact, lower: Weave, upper: Weave, first_lower: int, first_upper: int
) -> None:
    """Add a point wherever yarns of two coplanar patches touch; their yarns are numbered from the given first ones."""
    for touch in touches(contact, lower, upper):
        a, b = touch.families
        x = lower.families[a].at(touch.below, touch.u)
        below = first_lower + a * lower.warps.count + touch.below
        above = first_upper + b * upper.warps.count + touch.above
        sewn = _sewn(contact.seams, upper, x) & ~touch.apart
        for at, kind in ((~sewn, PointKind.CONTACT), (sewn, PointKind.STITCH)):
            assembly.crossings(below[at], touch.u[at], above[at], touch.v[at], x[at], lower.normal, contact.friction, kind,
                               active=~touch.apart[at])


def _touching_families(contact: Contact, lower: Weave, upper: Weave) -> Iterator[tuple[int, int, PlanCrossings]]:
    """Families (0 warps, 1 wefts) of two patches that cross steeply enough, and where the lines of their grids do."""
    least = sin(radians(contact.min_angle)) - 1e-9
    for a, below in enumerate(lower.families):
        for b, above in enumerate(upper.families):
            if abs(sine_of_angle(below.lines, above.lines, lower.normal)) >= least:
                lines = below.lines.longer(contact.reach), above.lines.longer(contact.reach)
                yield a, b, cross_in_plan(*lines, lower.normal)


def _sewn(seams: Sequence[Seam], upper: Weave, x: Floats) -> Flags:
    """Which of the places `x` [n, 3] lie in a seam."""
    place, sewn = upper.local(x), np.zeros(len(x), np.bool_)
    for seam in seams:
        axis, side = _EDGES[seam.edge]
        family = upper.families[axis]
        half = family.lines.count * family.lines.pitch / 2
        sewn |= side * place[:, axis] >= half - (seam.width or 2 * family.lines.pitch)
    return sewn
