"""Coulomb's law at a contact as a projection: the second-order cone, regular and shifted (Fei 2019, sec. 13.6).

The force r at a contact opposes its relative displacement w in a step, which a stiffness k would answer by r - k w were there no
law. Of that trial force t the law leaves, for sides that are `gap` apart along the normal and held together by a pull,
    t_N - k_N gap  where they press on each other,
    0              where they come nearer without touching,
    t_N            where the pull keeps them from parting, and -pull where it does not suffice,
and of its part across the normal what is within the friction, nearest in the energy of k. At w where r = r(t) for a t = r - k w,
r keeps the law exactly, whatever k is. Each case is the slope of a convex potential: strands and contacts have one in common.
"""

import numpy as np
from numba import njit

CLOSE = 1e-14  # of the friction, to which the force across the normal is found
NOTHING = 1e-100  # friction whose square a computer does not know [N]
MOST = 60  # Newton steps that find it


@njit(cache=True, error_model="numpy")
def normal_force(t, k, gap, pull):
    """Return the normal force [N] for the trial force t [N], its slope by t, and its potential in t times k."""
    if gap <= 0.0 or t >= k * gap:
        r = t - k * gap
        if r > -pull:
            return r, 1.0, 0.5 * r * r
        return -pull, 0.0, -pull * r - 0.5 * pull * pull
    if t >= 0.0:
        return 0.0, 0.0, 0.0
    if t > -pull:
        return t, 1.0, 0.5 * t * t
    return -pull, 0.0, -pull * t - 0.5 * pull * pull


@njit(cache=True, error_model="numpy")
def friction_limit(r, t, k, gap, mu, pull):
    """Return the largest friction [N] of sides with normal force r for the trial force t [N]: mu times what presses them.

    That is the force and the pull (Fei 2019, eq. 13.88), but for sides that are free to come nearer, where it is nothing.
    """
    free = gap > 0.0 and 0.0 <= t < k * gap
    return 0.0 if free else mu * (r + pull)


@njit(cache=True, error_model="numpy")
def friction(t1, t2, k1, k2, limit):
    """Return the friction (r1, r2) [N] of trial forces across the normal, and the Lagrangian factor a of the limit [m/N].

    It is nearest to the trial force in the energy of (k1, k2) within the circle of the limit: r = t / (1 + a k), a = 0 inside.
    """
    if t1 * t1 + t2 * t2 <= limit * limit:
        return t1, t2, 0.0
    if limit <= NOTHING:
        return 0.0, 0.0, np.inf
    # 1 / |r| is concave in a and nearly straight: Newton on it comes from below and does not pass the root
    a = 0.0
    for _ in range(MOST):
        r1, r2 = t1 / (1.0 + a * k1), t2 / (1.0 + a * k2)
        square = r1 * r1 + r2 * r2
        length = np.sqrt(square)
        if length - limit <= CLOSE * limit:
            break
        slope = (r1 * r1 * k1 / (1.0 + a * k1) + r2 * r2 * k2 / (1.0 + a * k2)) / (square * length)
        a += (1.0 / limit - 1.0 / length) / slope
    scale = limit / length
    return scale * r1, scale * r2, a


@njit(cache=True, error_model="numpy")
def friction_slope(r1, r2, k1, k2, a, tangent):
    """Return the slopes (11, 12, 22) of the friction by the trial force, times k: symmetric, and no less than zero.

    Where they are not to be `tangent`, they are those of a parabola that touches the potential of friction and is nowhere below
    it: what is least for that never lies too far.
    """
    if a == 0.0:
        return k1, 0.0, k2
    if a == np.inf:
        return 0.0, 0.0, 0.0
    m1, m2 = k1 / (1.0 + a * k1), k2 / (1.0 + a * k2)
    if not tangent:
        return m1, 0.0, m2
    g1, g2 = m1 * r1, m2 * r2
    along = r1 * g1 + r2 * g2
    return m1 - g1 * g1 / along, -g1 * g2 / along, m2 - g2 * g2 / along


@njit(cache=True, error_model="numpy")
def friction_potential(t1, t2, r1, r2, k1, k2):
    """Return the potential of the friction in the trial force [J], whose slope by w is -r."""
    d1, d2 = t1 - r1, t2 - r2
    return 0.5 * ((t1 * t1 - d1 * d1) / k1 + (t2 * t2 - d2 * d2) / k2)
