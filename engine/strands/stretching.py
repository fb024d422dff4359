"""Stretch of discrete elastic rods (Bergou 2010, sec. 4.2.1): E = E A (|e| - l)^2 / (2 l) of every edge of rest length l."""

from numba import njit


@njit(cache=True, error_model="numpy")
def energy(length, rest, stiffness):
    """Energy of a strand [J]; `length` and `rest` [V] are those of edges [m], `stiffness` [V] is E A / l [N/m]."""
    total = 0.0
    for i in range(len(length) - 1):
        total += 0.5 * stiffness[i] * (length[i] - rest[i]) ** 2
    return total


@njit(cache=True, error_model="numpy")
def add_gradient(i, t, length, rest, stiffness, gradient):
    """Add the derivative of the energy of edge i by the edge to `gradient` [3] [N]."""
    tension = stiffness[i] * (length[i] - rest[i])
    for k in range(3):
        gradient[k] += tension * t[i, k]


@njit(cache=True, error_model="numpy")
def add_hessian(i, t, length, rest, stiffness, positive, hessian):
    """Add the second derivative of the energy of edge i by the edge to the lower half of `hessian` [3, 3].

    Where `positive`, what makes a pressed edge give way sideways is left out.
    """
    across = stiffness[i] * (length[i] - rest[i]) / length[i]
    if positive:
        across = max(across, 0.0)
    for a in range(3):
        for b in range(a + 1):
            hessian[a, b] += (stiffness[i] - across) * t[i, a] * t[i, b]
        hessian[a, a] += across
