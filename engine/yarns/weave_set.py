"""Crimp that is set: yarns that were heated or wetted as woven, and are bent at crossings without any force.

Where the angle of a centre line at a crossing was theta_0 as woven, what bending stores (`engine.yarns.bending`) becomes

    k_b (theta - theta_0)^2 / D, to first order: k_b (theta^2 - 2 phi (s - t).n + theta_set^2) / D,

with t and s the directions of the centre line before and behind, n the crossing's normal, so that only a bend towards n
counts, and phi = theta_0 / cos(theta_0 / 2) of the sign that it has. It and its gradient vanish in the cloth as woven and
wherever that has turned as a whole. The part that this adds has no Hessian here: it takes away from that of bending.
"""

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints
from engine.yarns.crimp import CentreLines
from engine.yarns.model import YarnModel, YarnState
from engine.yarns.topology import Chain


def bends(model: YarnModel, state: YarnState, chain: Chain, lines: CentreLines) -> Floats:
    """Return the angle of the centre lines at all crossings with crimp, towards n, shape [N] [rad]; 0 elsewhere."""
    angle = np.zeros(model.node_count)
    if lines.offsets is not None:
        nodes = _bent(model, chain, model.height != 0.0)
        a, b = chain.before[nodes], chain.after[nodes]
        centre = lines.through(state.x, state.u)
        t, s = centre[nodes] - centre[a], centre[b] - centre[nodes]
        t, s = (edge / np.linalg.norm(edge, axis=1)[:, None] for edge in (t, s))
        towards = np.einsum("nk,nk->n", s - t, lines.offsets.normals(state.x)[lines.offsets.source[nodes, 0]])
        angle[nodes] = 2.0 * np.sign(towards) * np.arcsin(np.minimum(0.5 * np.linalg.norm(s - t, axis=1), 1.0))
    return angle


def set_nodes(model: YarnModel, chain: Chain) -> Ints:
    """Return the EoL nodes between others at which yarns are set."""
    return _bent(model, chain, model.set_angle != 0.0)


def _bent(model, chain, flags):
    return chain.node[flags[chain.node] & (chain.before[chain.node] >= 0) & (chain.after[chain.node] >= 0)]


@njit(cache=True, error_model="numpy")
def add_gradient(nodes, before, after, node_yarn, stiffness, set_angle, source, normals, centre, u, on_centres, on_normals):
    """Add the gradient to `on_centres` [N, 4] and `on_normals` [C, 3]; returns the energy [J].

    `nodes` are those of `set_nodes`; `stiffness` [Y] is k_b [N m^2], `set_angle` [N] is theta_0 [rad]; the normal of a node is
    `normals` [C, 3] of its `source` [N, 2], `centre` [N, 3] its place [m].
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
        bend = t_n = s_n = 0.0
        for k in range(3):
            t[k] /= lt
            s[k] /= ls
            t_n += t[k] * n[k]
            s_n += s[k] * n[k]
        bend = s_n - t_n
        span = u[b] - u[a]
        phi = set_angle[i] / np.cos(0.5 * set_angle[i])
        stored = stiffness[node_yarn[i]] / span * (4.0 * phi * np.sin(0.5 * set_angle[i]) - set_angle[i] ** 2 - 2.0 * phi * bend)
        moment = -2.0 * phi * stiffness[node_yarn[i]] / span
        energy += stored
        on_centres[a, 3] += stored / span
        on_centres[b, 3] -= stored / span
        for k in range(3):
            on_s, on_t = moment * (n[k] - s_n * s[k]) / ls, -moment * (n[k] - t_n * t[k]) / lt
            on_centres[b, k] += on_s
            on_centres[i, k] += on_t - on_s
            on_centres[a, k] -= on_t
            on_normals[source[i, 0], k] += moment * (s[k] - t[k])
    return energy
