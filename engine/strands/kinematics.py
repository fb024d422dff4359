"""Edges of a strand and the material frames on them, as unknowns move them (Bergou 2010, sec. 4.2).

The unknowns of a strand are the places x of its vertices and the turns g of its edges' frames about their tangents. A frame
is carried through time without twist with its edge, then turned by g.
"""

import numpy as np
from numba import njit

from engine.geometry.frames import across, cross, row, transport


@njit(cache=True, error_model="numpy")
def edges(x, t, length):
    """Write unit tangents [V, 3] and lengths [V] of the edges between the vertices x [V, 3] [m]."""
    for i in range(len(x) - 1):
        square = 0.0
        for k in range(3):
            t[i, k] = x[i + 1, k] - x[i, k]
            square += t[i, k] * t[i, k]
        length[i] = np.sqrt(square)
        for k in range(3):
            t[i, k] /= length[i]


@njit(cache=True, error_model="numpy")
def frames(t_before, m1_before, t, turn, m1, m2):
    """Write the material directions of edges [V, 3] that went from tangent t_before to t and turned by `turn` [V] [rad]."""
    for i in range(len(t) - 1):
        tangent = row(t, i)
        first = across(transport(row(m1_before, i), row(t_before, i), tangent), tangent)
        second = cross(tangent, first)
        cosine, sine = np.cos(turn[i]), np.sin(turn[i])
        for k in range(3):
            m1[i, k] = cosine * first[k] + sine * second[k]
            m2[i, k] = cosine * second[k] - sine * first[k]
