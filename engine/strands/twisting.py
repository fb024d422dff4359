"""Twist of discrete elastic rods (Bergou 2010, sec. 4.2.2; Fei 2019, sec. 9.1).

The twist tau of a vertex is the angle by which the frame of its second edge is ahead of that of the first, carried over
without twist. E = G J (tau - rest)^2 / (2 l), with

    dtau/de0 = kb / (2 |e0|),    dtau/de1 = kb / (2 |e1|),    dtau/dg0 = -1,    dtau/dg1 = 1.
"""

import numpy as np
from numba import njit

from engine.geometry.frames import angle_about, dot, row, transport
from engine.strands.bending import FOLD


@njit(cache=True, error_model="numpy")
def twists(t, m1, before, turn, twist):
    """Write tau of the inner vertices to `twist` [V] [rad].

    Of all that differ by whole turns it is the nearest to that `before` [V], changed by the turns of the edges since, `turn` [V].
    """
    for i in range(1, len(t) - 1):
        carried = transport(row(m1, i - 1), row(t, i - 1), row(t, i))
        angle = angle_about(row(t, i), carried, row(m1, i))
        expected = before[i] + turn[i] - turn[i - 1]
        twist[i] = angle + 2.0 * np.pi * np.round((expected - angle) / (2.0 * np.pi))


@njit(cache=True, error_model="numpy")
def energy(twist, rest, stiffness):
    """Energy of a strand [J]; `rest` [V] is tau at rest, `stiffness` [V] is G J / l [N m]."""
    total = 0.0
    for i in range(1, len(twist) - 1):
        total += 0.5 * stiffness[i] * (twist[i] - rest[i]) ** 2
    return total


@njit(cache=True, error_model="numpy")
def add_gradient(i, length, binormal, twist, rest, stiffness, gradient):
    """Add the derivatives of the energy at vertex i to `gradient` [8]: by e0 and e1 [N], then by g0 and g1 [N m]."""
    moment = stiffness[i] * (twist[i] - rest[i])
    for k in range(3):
        gradient[k] += 0.5 * moment * binormal[i, k] / length[i - 1]
        gradient[3 + k] += 0.5 * moment * binormal[i, k] / length[i]
    gradient[6] -= moment
    gradient[7] += moment


@njit(cache=True, error_model="numpy")
def add_hessian(i, t, length, binormal, twist, rest, stiffness, positive, hessian):
    """Add the second derivatives of the energy at vertex i to the lower half of `hessian` [8, 8].

    Where `positive`, that of tau itself is left out.
    """
    kb, length0, length1 = row(binormal, i), length[i - 1], length[i]
    p, q = 0.5 / length0, 0.5 / length1
    strain = (p * kb[0], p * kb[1], p * kb[2], q * kb[0], q * kb[1], q * kb[2], -1.0, 1.0)
    for a in range(8):
        for b in range(a + 1):
            hessian[a, b] += stiffness[i] * strain[a] * strain[b]
    if positive:
        return
    moment = stiffness[i] * (twist[i] - rest[i])
    t0, t1 = row(t, i - 1), row(t, i)
    chi = 1.0 + FOLD + dot(t0, t1)
    middle = ((t0[0] + t1[0]) / chi, (t0[1] + t1[1]) / chi, (t0[2] + t1[2]) / chi)
    for a in range(3):
        for b in range(3):
            if b <= a:
                first = kb[a] * (t0[b] + middle[b]) + (t0[a] + middle[a]) * kb[b]
                second = kb[a] * (t1[b] + middle[b]) + (t1[a] + middle[a]) * kb[b]
                hessian[a, b] -= 0.25 * moment * first / (length0 * length0)
                hessian[3 + a, 3 + b] -= 0.25 * moment * second / (length1 * length1)
            hessian[3 + a, b] -= 0.5 * moment * middle[a] * kb[b] / (length0 * length1)
    scale = moment / (length0 * length1 * chi)
    for a in range(3):  # -[t0]_x
        b, c = (a + 1) % 3, (a + 2) % 3
        hessian[3 + a, b] += scale * t0[c]
        hessian[3 + b, a] -= scale * t0[c]
