"""Exponents of power laws through measured points."""

from collections.abc import Sequence

import numpy as np


def fitted_exponent(x: Sequence[float], y: Sequence[float]) -> float | None:
    """Return p of the law y ~ x^p that fits the points best, by least squares of the logarithms.

    With x a step or an element size and y an error, p is the order of convergence. Points that have no logarithm are
    left out; None where fewer than two different x remain.

    >>> round(fitted_exponent([0.1, 0.2, 0.4], [0.03, 0.12, 0.48]), 6)
    2.0
    """
    xs, ys = np.asarray(x, float), np.asarray(y, float)
    usable = (xs > 0) & (ys > 0) & np.isfinite(xs) & np.isfinite(ys)
    if len(np.unique(xs[usable])) < 2:
        return None
    slope, _ = np.polyfit(np.log(xs[usable]), np.log(ys[usable]), 1)
    return float(slope)
