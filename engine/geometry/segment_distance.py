"""How near two line segments, and two lines of them, come to each other."""

from numba import njit

from engine.arrays import Floats


@njit(cache=True)
def nearest_on_segments(a: Floats, b: Floats, c: Floats, d: Floats) -> tuple[float, float, float]:
    """Return the shares of ab and of cd, each in [0, 1], at which the segments come nearest, and the squared distance.

    a, b, c, d [3] are the ends [m]. Where segments are parallel, or have no length, it is one of the nearest pairs.
    """
    first = second = mixed = along_first = along_second = 0.0
    for k in range(3):
        p, q, r = b[k] - a[k], d[k] - c[k], a[k] - c[k]
        first += p * p
        second += q * q
        mixed += p * q
        along_first += p * r
        along_second += q * r
    determinant = first * second - mixed * mixed
    s = 0.0
    if determinant > 1e-14 * first * second:
        s = _clipped((mixed * along_second - along_first * second) / determinant)
    t = (mixed * s + along_second) / second if second > 0.0 else 0.0
    if second == 0.0 or t < 0.0 or t > 1.0:  # the end of cd is nearest: look for what is nearest to it on ab
        t = _clipped(t)
        s = _clipped((mixed * t - along_first) / first) if first > 0.0 else 0.0
    square = 0.0
    for k in range(3):
        square += (a[k] + s * (b[k] - a[k]) - c[k] - t * (d[k] - c[k])) ** 2
    return s, t, square


@njit(cache=True)
def _clipped(share):
    return min(max(share, 0.0), 1.0)


@njit(cache=True)
def walk_to_nearest(first, second, x, i, j):
    """Return where two lines come nearest, found downhill from their segments i and j.

    Lines run through the places x [P, 3] of the points `first` [m] and `second` [n]. From a pair of segments whose nearest
    places are at an end, the walk goes on to the neighbour there, as long as that is nearer. For lines that are nearer to
    each other than they are curved, it ends at the nearest places of all, in about as many turns as segments are passed.
    Returns both segments, the share of each, and the squared distance.
    """
    s, t, square = nearest_on_segments(x[first[i]], x[first[i + 1]], x[second[j]], x[second[j + 1]])
    while True:
        step_i = int(s == 1.0) - int(s == 0.0)
        step_j = int(t == 1.0) - int(t == 0.0)
        best_i, best_j = i, j
        for k in range(3):
            a = i + (step_i if k != 1 else 0)
            b = j + (step_j if k != 0 else 0)
            if (a == i and b == j) or a < 0 or b < 0 or a > len(first) - 2 or b > len(second) - 2:
                continue
            s_there, t_there, there = nearest_on_segments(x[first[a]], x[first[a + 1]], x[second[b]], x[second[b + 1]])
            if there < square:
                best_i, best_j, s, t, square = a, b, s_there, t_there, there
        if best_i == i and best_j == j:
            return i, j, s, t, square
        i, j = best_i, best_j
