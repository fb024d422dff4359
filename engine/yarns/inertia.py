"""Inertia of rods whose nodes slide through the material, with its convective part, exact in linear momentum.

Material in a segment between nodes 0 and 1 moves with v linear between V_i = xdot_i - w udot_i, w = (x1 - x0) / (u1 - u0).
At a node between segments of different direction V jumps: each node holds both limits. Over a step h the segment's
material, continued along the segment where the node slides over it, would go to

    Y(U) = X(U) + h v(U) + h^2 g,

and implicit Euler minimises, next to the potential, its distance from where it does go, over the new segment:

    I = sum over segments of rho / (2 h^2) * integral of |X' - Y|^2 = rho Du' / (6 h^2) (r0.r0 + r0.r1 + r1.r1),

r_i = x_i' - Y(u_i'). The second derivative is M / h^2 with M = (rho Du / 6) [[2, 1], [1, 2]] (x) B^T B, B = [I, -w], and
r contains the convection within the segment. Material that passes the node, at the rate udot, changes its velocity from
one limit to the other; the node takes the force f = rho udot (V+ - V-) on x and -(w+ + w-).f / 2 on u, which makes the
sum equal to the Euler-Lagrange equations. EIL nodes do not enter, so they are massless (Sánchez-Banderas 2020, sec. 4.3).
"""

import numpy as np
from numba import njit

from engine.arrays import Floats
from engine.yarns.model import YarnModel
from engine.yarns.topology import Chain


def predict(model: YarnModel, x: Floats, velocity: Floats, gravity: Floats, h: float) -> Floats:
    """Return Y = X + h v + h^2 g on both sides of every node, shape [N, 2, 3] [m].

    x [N, 3] are the nodes' positions; v [N, 2, 3] decays by the mass damping alpha.
    """
    decay = np.exp(-model.mass_damping * h)[model.node_yarn, None, None]
    return x[:, None, :] + h * decay * velocity + h * h * gravity


def corner_forces(model: YarnModel, chain: Chain, x: Floats, u: Floats, u_rate: Floats, velocity: Floats) -> Floats:
    """Return f (on x) and -(w+ + w-).f / 2 (on u) of every node, shape [N, 4] [N].

    x [N, 3] and u [N] are those of the nodes, u_rate [N] their sliding [m/s], velocity [N, 2, 3] both limits of v.
    """
    force = np.zeros((model.node_count, 4))
    inner = chain.node[(chain.before[chain.node] >= 0) & (chain.after[chain.node] >= 0)]
    before, after = chain.before[inner], chain.after[inner]
    slopes = (x[after] - x[inner]) / (u[after] - u[inner])[:, None]
    slopes += (x[inner] - x[before]) / (u[inner] - u[before])[:, None]
    flow = model.density[model.node_yarn[inner]] * u_rate[inner]
    force[inner, :3] = flow[:, None] * (velocity[inner, 1] - velocity[inner, 0])
    force[inner, 3] = -0.5 * np.sum(slopes * force[inner, :3], axis=1)
    return force


@njit(cache=True, error_model="numpy")
def add_gradient(chain, node_point, density, h, u0, prediction, corner_force, x, u, gradient):
    """Add the gradient of I and the corner forces of one yarn to `gradient` [N, 4] and return their energy [J].

    `chain` are the yarn's EoL nodes in order, `density` is its rho [kg/m].
    """
    energy = 0.0
    share = density / (6.0 * h * h)
    for e in range(len(chain)):
        i = chain[e]
        for k in range(3):
            energy -= corner_force[i, k] * (x[node_point[i], k] - prediction[i, 0, k])
            gradient[i, k] -= corner_force[i, k]
        energy -= corner_force[i, 3] * (u[i] - u0[i])
        gradient[i, 3] -= corner_force[i, 3]
        if e + 1 == len(chain):
            break
        j = chain[e + 1]
        p, q = node_point[i], node_point[j]
        du = u[j] - u[i]
        square = 0.0
        for k in range(3):
            slope = (prediction[j, 0, k] - prediction[i, 1, k]) / (u0[j] - u0[i])
            r0 = x[p, k] - prediction[i, 1, k] - (u[i] - u0[i]) * slope
            r1 = x[q, k] - prediction[j, 0, k] - (u[j] - u0[j]) * slope
            square += r0 * r0 + r0 * r1 + r1 * r1
            m0 = share * du * (2.0 * r0 + r1)
            m1 = share * du * (r0 + 2.0 * r1)
            gradient[i, k] += m0
            gradient[j, k] += m1
            gradient[i, 3] -= slope * m0
            gradient[j, 3] -= slope * m1
        energy += share * du * square
        gradient[i, 3] -= share * square
        gradient[j, 3] += share * square
    return energy


@njit(cache=True, error_model="numpy")
def add_hessian(chain, density, h, u0, prediction, u, band):
    """Add M / h^2 of one yarn to its `band` [E, 3, 4, 4]: the blocks of each node with itself and the next two."""
    slope = np.empty(3)
    for e in range(len(chain) - 1):
        i, j = chain[e], chain[e + 1]
        square = 0.0
        for k in range(3):
            slope[k] = (prediction[j, 0, k] - prediction[i, 1, k]) / (u0[j] - u0[i])
            square += slope[k] * slope[k]
        scale = density * (u[j] - u[i]) / (6.0 * h * h)
        for a in range(2):
            for b in range(a, 2):
                mass = scale * (2.0 if a == b else 1.0)
                block = band[e + a, b - a]
                for r in range(3):
                    block[r, r] += mass
                    block[r, 3] -= mass * slope[r]
                    block[3, r] -= mass * slope[r]
                block[3, 3] += mass * square


@njit(cache=True, error_model="numpy")
def new_velocity(chain, before, after, node_yarn, density, h, corner_force, velocity0, x0, u0, x, u):
    """Return V = xdot - w udot of the step on both sides of every EoL node, shape [N, 2, 3] [m/s].

    x0, x [N, 3] and u0, u [N] are those of the nodes at the start and the end. Corner forces were taken at the rate of
    the last step; what the true rate would have passed on besides is given to the node's neighbourhood, so that linear
    momentum is exact.
    """
    velocity = np.zeros_like(velocity0)
    for i in chain:
        for side in range(2):
            a = before[i] if side == 0 else i
            b = i if side == 0 else after[i]
            if a < 0 or b < 0:
                continue
            for k in range(3):
                w = (x0[b, k] - x0[a, k]) / (u0[b] - u0[a])
                velocity[i, side, k] = (x[i, k] - x0[i, k] - w * (u[i] - u0[i])) / h
    for i in chain:
        a, b = before[i], after[i]
        passed = u[i] - u0[i]
        if a < 0 or b < 0 or passed == 0.0:
            continue
        rho = density[node_yarn[i]]
        for k in range(3):
            v_before = velocity0[i, 0, k]
            v_after = velocity0[i, 1, k]
            bend_before = (v_before - velocity0[a, 1, k]) / (u0[i] - u0[a])
            bend_after = (velocity0[b, 0, k] - v_after) / (u0[b] - u0[i])
            turned = rho * passed * (v_after - v_before + 0.5 * passed * (bend_after - bend_before))
            missing = 2.0 * (turned - h * corner_force[i, k]) / (rho * (u[b] - u[a]))
            velocity[i, 0, k] += missing
            velocity[i, 1, k] += missing
    return velocity


def project(old: Chain, u0: Floats, velocity: Floats, new: Chain, u: Floats) -> Floats:
    """Return the L2 projection of v from one mesh onto the segments of another, shape [N, 2, 3] [m/s].

    `velocity` [N, 2, 3] belongs to the nodes of `old`, whose Eulerian coordinates are u0; the result belongs to the nodes
    of `new` at u and is zero elsewhere. Linear momentum stays, kinetic energy never rises.
    """
    return _project(old.node, old.start, u0, velocity, new.node, new.start, u)


@njit(cache=True, error_model="numpy")
def _project(old_chain, old_start, u0, old, chain, chain_start, u):
    value = np.zeros_like(old)
    moment = np.empty((2, 3))
    for y in range(len(chain_start) - 1):
        first, last = old_start[y], old_start[y + 1] - 1
        at = first
        for e in range(chain_start[y], chain_start[y + 1] - 1):
            i, j = chain[e], chain[e + 1]
            low, du = u[i], u[j] - u[i]
            moment[:] = 0.0
            while at > first and u0[old_chain[at]] > low:
                at -= 1
            while at < last - 1 and u0[old_chain[at + 1]] <= low:
                at += 1
            while True:
                a, b = old_chain[at], old_chain[at + 1]
                high = u[j] if at == last - 1 else min(u[j], u0[b])
                s0, s1 = (low - u[i]) / du, (high - u[i]) / du
                o0, o1 = (low - u0[a]) / (u0[b] - u0[a]), (high - u0[a]) / (u0[b] - u0[a])
                for k in range(3):
                    v0 = old[a, 1, k] + o0 * (old[b, 0, k] - old[a, 1, k])
                    v1 = old[a, 1, k] + o1 * (old[b, 0, k] - old[a, 1, k])
                    whole = 0.5 * (high - low) * (v0 + v1)
                    behind = (high - low) / 6.0 * (v0 * (2.0 * s0 + s1) + v1 * (s0 + 2.0 * s1))
                    moment[0, k] += whole - behind
                    moment[1, k] += behind
                if high >= u[j] or at == last - 1:
                    break
                low = high
                at += 1
            for k in range(3):
                value[i, 1, k] = (4.0 * moment[0, k] - 2.0 * moment[1, k]) / du
                value[j, 0, k] = (4.0 * moment[1, k] - 2.0 * moment[0, k]) / du
    return value
