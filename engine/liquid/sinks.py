"""What takes liquid away: boxes that swallow what enters, and the end of the world."""

from typing import NamedTuple

import numpy as np
from numba import njit

from engine.arrays import Flags, Floats
from engine.liquid.model import LiquidModel


class LiquidSinks(NamedTuple):
    """K boxes in which no particle stays."""

    low: Floats  # [m], shape [K, 3]
    high: Floats  # [m], shape [K, 3]


def leaving(sinks: LiquidSinks, model: LiquidModel, x: Floats) -> Flags:
    """Return which particles at x [P, 3] [m] are in a sink or out of the box that the liquid may be in, shape [P]."""
    gone = np.empty(len(x), np.bool_)
    _mark(sinks.low, sinks.high, model.low, model.high, x, gone)
    return gone


@njit(cache=True)
def _mark(sink_low, sink_high, low, high, x, gone):
    for p in range(len(x)):
        gone[p] = not _inside(low, high, x[p])
        for k in range(len(sink_low)):
            gone[p] |= _inside(sink_low[k], sink_high[k], x[p])


@njit(cache=True)
def _inside(low, high, x):
    for k in range(3):
        if not low[k] <= x[k] <= high[k]:
            return False
    return True
