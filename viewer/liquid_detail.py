"""Which part of a large frame of liquid is drawn, so that a browser on a small machine keeps up.

A frame within its budget is drawn whole. Of a larger one, some particles stand for all, and are so much larger that together
they have the volume of all. A hash of its number decides on each particle: it is the same from frame to frame as long as
particles keep their numbers, and follows no lattice that they may have started on; a finer level adds to a coarser one.

Instead, the region around a place, or everything, can be drawn as it is.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Flags, Floats, Ints, Singles
from engine.run.frames import LiquidFrame
from viewer.detail import AUTO, Level, budget, distances_to, reach_of


@dataclass(frozen=True)
class Part:
    """What is drawn of a frame, without the surface."""

    liquid: LiquidFrame
    said: str  # what that is, in words


def part(liquid: LiquidFrame, level: Level, focus: Floats) -> Part:
    """Return what is drawn of a frame; a region is the one around `focus` [m]."""
    if level == "full":
        return Part(liquid, _counted(liquid, liquid))
    if level == "region":
        near = region(liquid, focus, AUTO.segments)
        return Part(near, _counted(near, liquid))
    drawn = coarse(liquid, budget(level).segments)
    larger = "" if drawn is liquid else ", as large as all of them together"
    return Part(drawn, _counted(drawn, liquid) + larger)


def coarse(liquid: LiquidFrame, particles: int) -> LiquidFrame:
    """Return no more than so many particles, of the volume of all."""
    if len(liquid.positions) <= particles:
        return liquid
    drawn = _with_particles(liquid, np.sort(np.argpartition(_hash(len(liquid.positions)), particles)[:particles]))
    return replace(drawn, radius=drawn.radius * np.float32(np.cbrt(_volume(liquid.radius) / _volume(drawn.radius))))


def region(liquid: LiquidFrame, centre: Floats, particles: int) -> LiquidFrame:
    """Return the particles that are nearest to `centre` [m] as they are, up to so many."""
    distance = distances_to(liquid.positions, centre)
    return _with_particles(liquid, distance < reach_of(distance, particles))


def _hash(count: int) -> NDArray[np.uint32]:
    """Return the numbers below `count` mixed, no two the same (the last steps of MurmurHash3), shape [count]."""
    mixed = np.arange(count, dtype=np.uint32)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
        mixed = (mixed ^ (mixed >> np.uint32(shift))) * np.uint32(factor)
    return mixed ^ (mixed >> np.uint32(16))


def _volume(radius: Singles) -> float:
    """Return the volume of balls over that of one of radius 1."""
    return float(np.sum(radius.astype(np.float64) ** 3))


def _with_particles(liquid: LiquidFrame, chosen: Ints | Flags) -> LiquidFrame:
    names = ("positions", "radius", "speed", "pressure", "shear", "yielded")
    return replace(liquid, **{name: getattr(liquid, name)[chosen] for name in names})


def _counted(drawn: LiquidFrame, liquid: LiquidFrame) -> str:
    n, m = len(drawn.positions), len(liquid.positions)
    return f"shown {n:,} of {m:,} particles" if n < m else f"shown all {m:,} particles"
