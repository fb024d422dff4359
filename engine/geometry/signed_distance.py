"""Signed distances of simple solids and their gradients."""

import numpy as np
from numba import njit

PLANE, BOX, SPHERE, CYLINDER = 0, 1, 2, 3


@njit(cache=True)
def signed_distance(kind, centre, rotation, size, x, normal):
    """Return the distance of x [3] to a solid (negative inside) and write its unit gradient to `normal` [3].

    `rotation` [3, 3] holds the local axes as columns. A plane is solid below its local z = 0; a box has half extents
    `size`; a sphere has radius size[0]; a cylinder stands along local z with radius size[0] and half height size[1].
    """
    a, b, c = _local(centre, rotation, x)
    if kind == PLANE:
        distance, na, nb, nc = c, 0.0, 0.0, 1.0
    elif kind == SPHERE:
        length = np.sqrt(a * a + b * b + c * c)
        distance = length - size[0]
        if length > 0.0:
            na, nb, nc = a / length, b / length, c / length
        else:
            na, nb, nc = 0.0, 0.0, 1.0
    elif kind == CYLINDER:
        across = np.sqrt(a * a + b * b)
        distance, outward, upward = _rounded(across - size[0], abs(c) - size[1])
        na = outward * a / across if across > 0.0 else outward
        nb = outward * b / across if across > 0.0 else 0.0
        nc = np.copysign(upward, c)
    else:
        qa, qb, qc = abs(a) - size[0], abs(b) - size[1], abs(c) - size[2]
        if qa <= 0.0 and qb <= 0.0 and qc <= 0.0:
            distance = max(qa, qb, qc)
            na = 1.0 if qa == distance else 0.0
            nb = 1.0 if qb == distance and na == 0.0 else 0.0
            nc = 1.0 - na - nb
        else:
            na, nb, nc = max(qa, 0.0), max(qb, 0.0), max(qc, 0.0)
            distance = np.sqrt(na * na + nb * nb + nc * nc)
            na, nb, nc = na / distance, nb / distance, nc / distance
        na, nb, nc = np.copysign(na, a), np.copysign(nb, b), np.copysign(nc, c)
    for k in range(3):
        normal[k] = rotation[k, 0] * na + rotation[k, 1] * nb + rotation[k, 2] * nc
    return distance


@njit(cache=True)
def _local(centre, rotation, x):
    a = b = c = 0.0
    for k in range(3):
        d = x[k] - centre[k]
        a += rotation[k, 0] * d
        b += rotation[k, 1] * d
        c += rotation[k, 2] * d
    return a, b, c


@njit(cache=True)
def _rounded(p, q):
    """Distance to a corner from its two face distances, and the gradient's weights of both faces."""
    if p <= 0.0 and q <= 0.0:
        return (p, 1.0, 0.0) if p > q else (q, 0.0, 1.0)
    outward, upward = max(p, 0.0), max(q, 0.0)
    distance = np.sqrt(outward * outward + upward * upward)
    return distance, outward / distance, upward / distance
