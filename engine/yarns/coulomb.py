"""Coulomb's law for a slip s in space: a spring up to the limit mu F_n, a constant force behind it, and Newton's way there.

The step sees a Huber potential in |s|: a spring k |s|^2 / 2 up to the reach mu F_n / k, beyond it mu F_n (|s| - reach / 2).

Newton takes the force over its limit, f, as a second unknown with max(|s|, reach) f = s, linearised in both (Chan, Golub and
Mulet 1999, for total variation). The Hessian behind the limit is then mu F_n / |s| (1 - (f s^T + s f^T) / (2 |s|)): that of
the potential once f is s / |s|, stiffer as long as f, which follows a force that may yet stick, is not. The potential's own
has no stiffness along s; its Newton steps run past s = 0 and back. In 30 stacks of denim, this and `friction.LEAST_REACH`
took Newton from 8.1 iterations a step to 4.7; the hardest step of five of a cloth that comes to lie on a table, from 13 to 6.
"""

import numpy as np
from numba import njit


@njit(cache=True)
def huber(slip, spring, limit):
    """Return the energy [J] at a slip of length `slip` [m], and the force over the slip [N/m]."""
    reach = limit / spring
    if slip <= reach:
        return 0.5 * spring * slip * slip, spring
    return limit * (slip - 0.5 * reach), limit / slip


@njit(cache=True)
def follow(s, ds, slip, reach, pull):
    """Solve max(|s|, reach) f = s, linearised about s [3] and f, for the `pull` f [3] at s + ds; |f| is at most 1.

    `slip` is |s| [m]. With ds = 0 it is the friction at s over its limit.
    """
    along = 0.0
    if slip >= reach:
        for k in range(3):
            along += ds[k] * s[k] / max(slip, 1e-300)
    square = 0.0
    for k in range(3):
        pull[k] = s[k] + ds[k] - along * pull[k]
        square += pull[k] ** 2
    for k in range(3):
        pull[k] /= max(np.sqrt(square), slip, reach, 1e-300)
