"""Vectors across a curve: carried along it or through time without twist, turned about it (Bergou 2010, sec. 4.2).

Kernels pass single vectors as tuples of three numbers, which stay in registers.
"""

import numpy as np
from numba import njit

OPPOSITE = 1e-12  # 1 + cos of the angle of two tangents below which no way from one to the other is the shortest


@njit(cache=True, error_model="numpy")
def row(a, i):
    """Row i of a [n, 3] as a vector."""
    return a[i, 0], a[i, 1], a[i, 2]


@njit(cache=True, error_model="numpy")
def dot(a, b):
    """Inner product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, error_model="numpy")
def cross(a, b):
    """Cross product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, error_model="numpy")
def transport(a, t0, t1):
    """Vector a, across the tangent t0, as the least rotation from t0 to t1 carries it; as it is between opposite ones."""
    chi = 1.0 + dot(t0, t1)
    share = dot(a, t1) / chi if chi > OPPOSITE else 0.0
    return a[0] - share * (t0[0] + t1[0]), a[1] - share * (t0[1] + t1[1]), a[2] - share * (t0[2] + t1[2])


@njit(cache=True, error_model="numpy")
def across(a, t):
    """Unit vector along what of a is across the tangent t; it takes away the round-off that many transports gather."""
    along = dot(a, t)
    b = (a[0] - along * t[0], a[1] - along * t[1], a[2] - along * t[2])
    scale = 1.0 / np.sqrt(dot(b, b))
    return scale * b[0], scale * b[1], scale * b[2]


@njit(cache=True, error_model="numpy")
def angle_about(t, a, b):
    """Angle from a to b, both across the tangent t, positive about it [rad]."""
    return np.arctan2(dot(t, cross(a, b)), dot(a, b))
