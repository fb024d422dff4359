"""Nozzles that let out liquid, in whole layers of particles.

A nozzle with area A and speed v has let out a column of length v t after t seconds. The column is cut into layers of even
thickness d; layer k = 1, 2, ... is out, and its particles begin to be, as soon as v t >= k d. So what came out at any time
depends on that time alone, not on the steps taken up to it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from engine.arrays import Floats, Ints
from engine.geometry.handles import Handles

ROUND_OFF = 1e-9  # of a layer: one that is out but for this is out


@dataclass(frozen=True)
class LiquidSources:
    """E nozzles as they stand before anything moves; speeds are relative to the nozzle."""

    place: tuple[Floats, ...]  # of a layer's particles in the plane where they come out [m], each of shape [n, 3]
    volume: Floats  # of each particle [m^3], shape [E]
    jitter: Floats  # how far particles lie from the middle of their place, at most [m], shape [E]
    flow: Floats  # unit directions, shape [E, 3]
    speed: Floats  # [m/s], shape [E]
    thickness: Floats  # of a layer, d [m], shape [E]
    begin: Floats  # when they begin to flow [s], shape [E]
    layers: Floats  # that they let out in all, inf where they never cease, shape [E]
    handle: Ints  # script handle that carries each, -1 for none, shape [E]
    seed: int  # of the jitter


class Emission(NamedTuple):
    """What comes out in a step, as it is at the step's end."""

    x: Floats  # [m], shape [n, 3]
    velocity: Floats  # [m/s], shape [n, 3]
    volume: Floats  # at rest [m^3], shape [n]
    layers: Ints  # that each source has let out by then, shape [E]


def emitted(sources: LiquidSources, layers: Ints, handles: Handles, time: float, h: float) -> Emission:
    """Return the particles that come out in the step of `h` from `time` [s], in the order of sources and layers.

    `layers` [E] are those let out before. A particle is where it has flowed to since it left the nozzle, at even velocity.
    """
    out = _layers_out(sources, time + h)
    parts = [
        _layer(sources, e, k, handles, time, h)
        for e in range(len(out)) for k in range(layers[e] + 1, out[e] + 1)
    ]
    x, velocity, volume = zip(*parts, strict=True) if parts else ((), (), ())
    return Emission(
        np.concatenate([np.zeros((0, 3)), *x]), np.concatenate([np.zeros((0, 3)), *velocity]),
        np.concatenate([np.zeros(0), *volume]), np.maximum(layers, out),
    )


def _layers_out(sources: LiquidSources, time: float) -> Ints:
    """How many layers are out at `time` [s], shape [E]."""
    column = sources.speed * np.maximum(time - sources.begin, 0.0)
    return np.minimum(np.floor(column / sources.thickness + ROUND_OFF), sources.layers).astype(np.int64)


def _layer(sources: LiquidSources, e: int, k: int, handles: Handles, time: float, h: float) -> tuple[Floats, Floats, Floats]:
    """Places, velocities and volumes of layer `k` of source `e` at `time` + `h`."""
    d, speed, flow = sources.thickness[e], sources.speed[e], sources.flow[e]
    place, velocity = sources.place[e], speed * flow
    middle_out = sources.begin[e] + (k - 0.5) * d / speed  # when the middle of the layer passes the nozzle
    if sources.jitter[e] > 0.0:
        shift = np.random.default_rng((sources.seed, e, k)).uniform(-1.0, 1.0, place.shape)
        place = place + sources.jitter[e] * shift
    if sources.handle[e] >= 0:
        handle = np.full(len(place), sources.handle[e])
        velocity = speed * handles.turns(middle_out)[sources.handle[e]] @ flow
        place = handles.carry(place, handle, 0.0, middle_out)
        velocity = velocity + (handles.carry(place, handle, middle_out, h) - place) / h
    x = place + (time + h - middle_out) * velocity
    return x, np.broadcast_to(velocity, x.shape), np.full(len(x), sources.volume[e])
