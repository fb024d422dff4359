"""A signed distance given by samples on a grid, smoothly interpolated.

Interpolation is by quadratic B-splines: the value and its gradient are continuous. Linear interpolation would have kinks
on the faces of cells, in which Newton's iterations cannot come to rest. Its error is of second order in the spacing.
"""

import numpy as np
from numba import njit


@njit(cache=True)
def sampled_distance(lattice, samples, centre, rotation, size, x, normal):
    """Return the interpolated distance of x [3] and write its gradient, of length about 1, to `normal` [3].

    The grid is centred in the solid's own frame and reaches to +/- `size` [3]; its samples are those of
    `samples` [S] from lattice[0] on, lattice[1:] along each axis, the last axis fastest, at least four along each.
    Outside of the grid the distance to the grid is added.
    """
    weight, slope = np.empty((3, 3)), np.empty((3, 3))
    first, outside = np.empty(3, np.int64), np.zeros(3)
    beyond = 0.0
    for k in range(3):
        local = 0.0
        for m in range(3):
            local += rotation[m, k] * (x[m] - centre[m])
        spacing = 2.0 * size[k] / (lattice[1 + k] - 1)
        limit = size[k] - 0.5 * spacing  # further out a spline would need samples beyond the border
        inside = min(max(local, -limit), limit)
        outside[k] = local - inside
        beyond += outside[k] ** 2
        t = (inside + size[k]) / spacing
        nearest = min(max(int(np.floor(t + 0.5)), 1), lattice[1 + k] - 2)
        f = t - nearest  # in -1/2 to 1/2
        first[k] = nearest - 1
        weight[k, 0], weight[k, 1], weight[k, 2] = 0.5 * (0.5 - f) ** 2, 0.75 - f * f, 0.5 * (0.5 + f) ** 2
        slope[k, 0], slope[k, 1], slope[k, 2] = (f - 0.5) / spacing, -2.0 * f / spacing, (f + 0.5) / spacing
    distance = na = nb = nc = 0.0
    for a in range(3):
        for b in range(3):
            row = lattice[0] + ((first[0] + a) * lattice[2] + first[1] + b) * lattice[3] + first[2]
            for c in range(3):
                value = samples[row + c]
                distance += weight[0, a] * weight[1, b] * weight[2, c] * value
                na += slope[0, a] * weight[1, b] * weight[2, c] * value
                nb += weight[0, a] * slope[1, b] * weight[2, c] * value
                nc += weight[0, a] * weight[1, b] * slope[2, c] * value
    if beyond > 0.0:
        beyond = np.sqrt(beyond)
        distance += beyond
        na = outside[0] / beyond if outside[0] != 0.0 else na
        nb = outside[1] / beyond if outside[1] != 0.0 else nb
        nc = outside[2] / beyond if outside[2] != 0.0 else nc
    for k in range(3):
        normal[k] = rotation[k, 0] * na + rotation[k, 1] * nb + rotation[k, 2] * nc
    return distance
