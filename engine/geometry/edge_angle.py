"""The angle between two edges."""

import numpy as np
from numba import njit

SHORTEST = 1e-100  # length of an edge whose ends coincide: its square is no zero yet [m]


@njit(cache=True, error_model="numpy")
def edge_angle(x, a, b, c, d, t, s):
    """Return the lengths of the edges from x[a] to x[b] and from x[c] to x[d], and cosine and sine of the angle between them.

    Places x [V, 3] and lengths are in m. Writes their unit directions t [3] and s [3].
    """
    la = lc = 0.0
    for k in range(3):
        t[k] = x[b, k] - x[a, k]
        s[k] = x[d, k] - x[c, k]
        la += t[k] * t[k]
        lc += s[k] * s[k]
    la, lc = max(np.sqrt(la), SHORTEST), max(np.sqrt(lc), SHORTEST)
    cosine = sine = 0.0
    for k in range(3):
        t[k] /= la
        s[k] /= lc
        cosine += t[k] * s[k]
    for k in range(3):
        across = t[(k + 1) % 3] * s[(k + 2) % 3] - t[(k + 2) % 3] * s[(k + 1) % 3]
        sine += across * across
    return la, lc, cosine, np.sqrt(sine)
