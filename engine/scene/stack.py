"""Stacked fabrics: which lies on which, and where their yarns touch at the start."""

from collections.abc import Iterator, Sequence
from math import radians, sin

import numpy as np

from engine.scene.plan import PlanCrossings, cross_in_plan, sine_of_angle
from engine.scene.schema import Contact, Fabric
from engine.scene.weave import Weave
from engine.yarns.assembly import YarnAssembly
from engine.yarns.model import PointKind


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


def touching_families(contact: Contact, lower: Weave, upper: Weave) -> Iterator[tuple[int, int, PlanCrossings]]:
    """Yield the families (0 warps, 1 wefts) of two patches that cross steeply enough, and where they do."""
    least = sin(radians(contact.min_angle)) - 1e-9
    for a, below in enumerate(lower.families):
        for b, above in enumerate(upper.families):
            if abs(sine_of_angle(below, above, lower.normal)) >= least:
                yield a, b, cross_in_plan(below, above, lower.normal)


def add_contacts(
    assembly: YarnAssembly, contact: Contact, lower: Weave, upper: Weave, first_lower: int, first_upper: int
) -> None:
    """Add a point wherever yarns of two coplanar patches touch; their yarns are numbered from the given first ones."""
    for a, b, crossings in touching_families(contact, lower, upper):
        below, above = lower.families[a], upper.families[b]
        i, j = crossings.lines()
        u, v = crossings.distances(i, j)
        u, v = np.clip(u, 0.0, below.length), np.clip(v, 0.0, above.length)
        assembly.crossings(
            first_lower + a * lower.warps.count + i, u, first_upper + b * upper.warps.count + j, v,
            below.at(i, u), lower.normal, contact.friction, PointKind.CONTACT,
        )
