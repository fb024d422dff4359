"""When two line segments that move come as near as a distance: conservative advancement.

Ends move linearly. Over a share of the motion the distance falls by no more than what the ends of both segments move in it,
so that time may go on by the distance that is left over the speed and nothing is passed over.
"""

import numpy as np
from numba import njit

from engine.geometry.segment_distance import nearest_on_segments

CLOSE = 0.01  # of the distance looked for, within which it is reached
MOST = 500  # advances, after which segments that graze each other count as near


@njit(cache=True)
def first_near(x, motion, first, second, distance, ends):
    """Return the first share of the `motion` [V, 3] from x [V, 3] at which two segments are as near as `distance` [m], else inf.

    They begin at vertices `first` and `second` and end at the next ones. Where they are so near at the start, it is 0. Their
    ends then are left in `ends` [4, 3].
    """
    vertex = (first, first + 1, second, second + 1)
    squares = [0.0, 0.0]
    for e in range(4):
        square = 0.0
        for k in range(3):
            mean = 0.25 * (motion[first, k] + motion[first + 1, k] + motion[second, k] + motion[second + 1, k])
            square += (motion[vertex[e], k] - mean) ** 2
        squares[e // 2] = max(squares[e // 2], square)
    speed = np.sqrt(squares[0]) + np.sqrt(squares[1])
    time = 0.0
    for _ in range(MOST):
        for e in range(4):
            for k in range(3):
                ends[e, k] = x[vertex[e], k] + time * motion[vertex[e], k]
        left = np.sqrt(nearest_on_segments(ends[0], ends[1], ends[2], ends[3])[2]) - distance
        if left <= CLOSE * distance:
            return time
        if left >= (1.0 - time) * speed:
            return np.inf
        time += left / speed
    return time
