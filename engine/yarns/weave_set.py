"""Crimp that is set: yarns that were heated or wetted as woven, and are bent at crossings without any force.

Where the angle of a centre line at a crossing was theta_0 as woven, what bending stores (`engine.yarns.bending`) becomes

    k_b (theta - theta_0)^2 / D, to first order: k_b (theta^2 - 2 (phi_s s.n - phi_t t.n) + theta_1^2) / D,

with t and s the directions of the centre line before and behind, n the crossing's normal, and theta_0 of the sign of a bend
towards n. With phi_s = theta_0 / cos(beta_s), beta_s the angle of s to the plane across n as woven, and phi_t alike, and the
constant theta_1 that goes with them, it and its gradient vanish in the cloth as woven and wherever that has turned as a
whole. The part that this adds has no Hessian here: it takes away from that of bending.
"""

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints
from engine.yarns.crimp import CentreLines
from engine.yarns.model import YarnModel, YarnState
from engine.yarns.topology import Chain


def bends(model: YarnModel, state: YarnState, chain: Chain, lines: CentreLines) -> tuple[Floats, Floats]:
    """Return the angle of the centre lines at all crossings with crimp, towards n, shape [N] [rad]; 0 elsewhere.

    And t.n and s.n there, shape [N, 2].
    """
    angle, rise = np.zeros(model.node_count), np.zeros((model.node_count, 2))
    if lines.offsets is not None:
        nodes = _bent(model, chain, model.height != 0.0)
        a, b = chain.before[nodes], chain.after[nodes]
        centre = lines.through(state.x, state.u)
        t, s = centre[nodes] - centre[a], centre[b] - centre[nodes]
        t, s = (edge / np.linalg.norm(edge, axis=1)[:, None] for edge in (t, s))
        n = lines.offsets.normals(state.x)[lines.offsets.source[nodes, 0]]
        rise[nodes] = np.column_stack([np.einsum("nk,nk->n", edge, n) for edge in (t, s)])
        angle[nodes] = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(s - t, axis=1), 1.0))
        angle[nodes] *= np.sign(rise[nodes, 1] - rise[nodes, 0])
    return angle, rise


def set_nodes(model: YarnModel, chain: Chain) -> Ints:
    """Return the EoL nodes between others at which yarns are set."""
    return _bent(model, chain, model.set_angle != 0.0)


def _bent(model, chain, flags):
    return chain.node[flags[chain.node] & (chain.before[chain.node] >= 0) & (chain.after[chain.node] >= 0)]


@njit(cache=True, error_model="numpy")
def add_gradient(
    nodes, before, after, node_yarn, stiffness, set_angle, set_rise, source, normals, centre, u, on_centres, on_normals,
):
    """Add the gradient to `on_centres` [N, 4] and `on_normals` [C, 3]; returns the energy [J].

    `nodes` are those of `set_nodes`; `stiffness` [Y] is k_b [N m^2], `set_angle` [N] is theta_0 [rad], `set_rise` [N, 2]
    are t.n and s.n as woven; the normal of a node is `normals` [C, 3] of its `source` [N, 2], `centre` [N, 3] its place [m].
    """
    energy = 0.0
    t, s = np.empty(3), np.empty(3)
    for i in nodes:
        a, b = before[i], after[i]
        n = normals[source[i, 0]]
        lt = ls = 0.0
        for k in range(3):
            t[k], s[k] = centre[i, k] - centre[a, k], centre[b, k] - centre[i, k]
            lt += t[k] * t[k]
            ls += s[k] * s[k]
        lt, ls = np.sqrt(lt), np.sqrt(ls)
        t_n = s_n = 0.0
        for k in range(3):
            t[k] /= lt
            s[k] /= ls
            t_n += t[k] * n[k]
            s_n += s[k] * n[k]
        span = u[b] - u[a]
        along = 2.0 * stiffness[node_yarn[i]] / span
        phi_t, phi_s = set_angle[i] / np.sqrt(1.0 - set_rise[i, 0] ** 2), set_angle[i] / np.sqrt(1.0 - set_rise[i, 1] ** 2)
        less = phi_s * (s_n - set_rise[i, 1]) - phi_t * (t_n - set_rise[i, 0])
        stored = -along * (less + 0.5 * set_angle[i] ** 2)
        energy += stored
        on_centres[a, 3] += stored / span
        on_centres[b, 3] -= stored / span
        for k in range(3):
            on_s, on_t = -along * phi_s * (n[k] - s_n * s[k]) / ls, along * phi_t * (n[k] - t_n * t[k]) / lt
            on_centres[b, k] += on_s
            on_centres[i, k] += on_t - on_s
            on_centres[a, k] -= on_t
            on_normals[source[i, 0], k] -= along * (phi_s * s[k] - phi_t * t[k])
    return energy
