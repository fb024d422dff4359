"""Weave patterns: which yarn lies on top where a warp crosses a weft."""

from typing import Literal

import numpy as np

from engine.arrays import Flags, Ints

PatternName = Literal["plain", "twill-2/1", "twill-3/1", "denim", "twill-2/2", "satin-5", "satin-8", "basket-2/2"]


def twill(over: int, under: int) -> Flags:
    """Return one repeat of a right-hand twill: each warp goes over `over` wefts, then under `under`.

    Its line of floats rises from left to right, seen from above. With one and one it is the plain weave.
    """
    repeat = np.arange(over + under)
    return (repeat[:, None] - repeat) % (over + under) >= under


def satin(repeat: int, move: int) -> Flags:
    """Return one repeat of a warp-faced satin: each warp goes under one of `repeat` wefts.

    From one weft to the next, the place moves on by `move` warps, which has no common factor with `repeat`.
    """
    return np.arange(repeat) != (move * np.arange(repeat) % repeat)[:, None]


# one repeat each: rows are wefts from the first one on, columns are warps, true where the warp is over the weft
PATTERNS: dict[PatternName, Flags] = {
    "plain": twill(1, 1),
    "twill-2/1": twill(2, 1),
    "twill-3/1": twill(3, 1),
    "denim": twill(3, 1),
    "twill-2/2": twill(2, 2),
    "satin-5": satin(5, 2),
    "satin-8": satin(8, 3),
    "basket-2/2": np.kron(twill(1, 1), np.ones((2, 2), np.bool_)),
}


def warp_over(repeat: Flags, warp: Ints, weft: Ints) -> Flags:
    """Return whether each `warp` [n] lies over each `weft` [n], with `repeat` [wefts, warps] laid side by side."""
    wefts, warps = repeat.shape
    return repeat[weft % wefts, warp % warps]
