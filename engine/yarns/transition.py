"""The Eulerian coordinate of a node that turns EoL or EIL (Sánchez-Banderas 2020, Appendix A).

A node b between the EoL nodes a and c changes the energy when it changes its status: as EoL node it bends the yarn
through its own place x_b, as EIL node it lies on the segment from a to c and leaves x_b behind. The contact's partner
stays where it is, and u_b moves to where the jump is least. The appendix counts u downwards from a to c; here nothing
depends on that, and the limit u_c of its eqs. 8 and 9 becomes both ends of the interval.
"""

import numpy as np
from numba import njit

from engine.arrays import Flags, Floats
from engine.yarns.model import YarnModel, YarnState
from engine.yarns.topology import Chain


def settle_switched(model: YarnModel, state: YarnState, was_eil: Flags, chain: Chain, safety_distance: float) -> None:
    """Move u of the nodes that have just changed their status, given the flags from before [N] and the new chain.

    Writes `state.u` and takes the friction anchors along, so that no friction force changes. Nodes that turn EoL stay
    the `safety_distance` (in rest segments) away from their neighbours in `chain`.
    """
    _settle_switched(
        model.node_yarn, model.node_point, model.u_fixed, state.active, was_eil, state.eil, chain.before, chain.after,
        safety_distance * model.rest_segment, state.x, state.order, state.u, state.anchor)


@njit(cache=True)
def entering_eol(x_a: Floats, x_b: Floats, x_c: Floats, u_a: float, u_c: float) -> float:
    """Return the u_b of equal stretch on both sides of x_b [3] (eq. 7)."""
    ab, bc = np.sqrt(_dot(x_a, x_b, x_a, x_b)), np.sqrt(_dot(x_b, x_c, x_b, x_c))
    return _mean(bc, u_a, ab, u_c)


@njit(cache=True)
def entering_eil(x_a: Floats, x_b: Floats, x_c: Floats, u_a: float, u_c: float) -> float:
    """Return the u_b whose place on the segment from x_a to x_c is the nearest to x_b [3] (eq. 8)."""
    return _within(_mean(_dot(x_c, x_a, x_c, x_b), u_a, _dot(x_c, x_a, x_b, x_a), u_c), u_a, u_c)


@njit(cache=True)
def entering_eil_by_angle(ab: float, bc: float, cosine: float, u_a: float, u_c: float) -> float:
    """Return the same as `entering_eil` for segments of lengths ab and bc that bend by an angle of `cosine` (eq. 9)."""
    return _within(_mean(bc * bc + ab * bc * cosine, u_a, ab * ab + ab * bc * cosine, u_c), u_a, u_c)


@njit(cache=True)
def entering_eil_by_material(u_a: float, u_b: float, u_c: float, cosine: float) -> float:
    """Return the same as `entering_eil` where both segments are equally stretched, from u alone (eq. 10)."""
    return entering_eil_by_angle(abs(u_b - u_a), abs(u_c - u_b), cosine, u_a, u_c)


@njit(cache=True)
def _settle_switched(
    node_yarn, node_point, u_fixed, active, was_eil, eil, before, after, distance, x, order, u, anchor
):
    for b in order:  # along every yarn, so that a node sees where its neighbour has moved
        a, c = before[b], after[b]
        if eil[b] == was_eil[b] or u_fixed[b] or not active[node_point[b]] or a < 0 or c < 0:
            continue
        x_a, x_b, x_c = x[node_point[a]], x[node_point[b]], x[node_point[c]]
        if eil[b]:
            target = entering_eil(x_a, x_b, x_c, u[a], u[c])
        else:
            apart = distance[node_yarn[b]]
            low, high = min(u[a] + apart, u[b]), max(u[c] - apart, u[b])  # never nearer than it already is
            target = min(max(entering_eol(x_a, x_b, x_c, u[a], u[c]), low), high)
        anchor[b] += target - u[b]
        u[b] = target


@njit(cache=True)
def _mean(w_a, u_a, w_c, u_c):
    """Weighted mean of u_a and u_c; their middle where all three places coincide."""
    weight = w_a + w_c
    return (w_a * u_a + w_c * u_c) / weight if weight > 0.0 else 0.5 * (u_a + u_c)


@njit(cache=True)
def _within(u, first, second):
    return min(max(u, min(first, second)), max(first, second))


@njit(cache=True)
def _dot(a, b, c, d):
    """(b - a) . (d - c)."""
    s = 0.0
    for k in range(3):
        s += (b[k] - a[k]) * (d[k] - c[k])
    return s
