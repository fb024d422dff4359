"""Projection of velocities from mesh to mesh, and the motion of yarns that nothing acts on."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.yarns import inertia
from engine.yarns.model import PointKind
from engine.yarns.topology import chain_of
from tests.engine.yarns.stacks import straight_yarn

INNER = st.lists(st.integers(1, 99), min_size=1, max_size=10, unique=True)
PLACES = INNER.map(lambda inner: np.array([0, *sorted(inner), 100]) / 25.0)


@st.composite
def meshes(draw):
    """A yarn, a velocity on one choice of its nodes that jumps at each of them, and another choice."""
    model, state = straight_yarn(draw(PLACES), PointKind.EYELET)
    rng = np.random.default_rng(draw(st.integers(0, 1000)))
    first, second = (chosen(model, state, rng) for _ in range(2))
    return state.u, rng.normal(size=(model.node_count, 2, 3)), first, second


def chosen(model, state, rng, share=0.5):
    """The chain when every inner node is EIL with the probability `share`."""
    return chain_of(model, state.order, model.u_fixed < (rng.random(model.node_count) < share), state.active)


def segments(chain, u):
    i, j = chain.node[:-1], chain.node[1:]
    return i, j, (u[j] - u[i])[:, None]


def momentum(chain, u, v):
    """Integral of v."""
    i, j, du = segments(chain, u)
    return np.sum(du / 2.0 * (v[i, 1] + v[j, 0]), axis=0)


def kinetic_energy(chain, u, v):
    """Integral of v.v / 2."""
    i, j, du = segments(chain, u)
    return np.sum(du / 6.0 * (v[i, 1] ** 2 + v[i, 1] * v[j, 0] + v[j, 0] ** 2))


def speeds(chain, u, v, at):
    """v at the material points `at`, none of which is a node."""
    behind = np.searchsorted(u[chain.node], at)
    i, j = chain.node[behind - 1], chain.node[behind]
    share = ((at - u[i]) / (u[j] - u[i]))[:, None]
    return (1.0 - share) * v[i, 1] + share * v[j, 0]


def moment_defects(old, new, u, v, w):
    """Integrals of (w - v) against 1 and u over each segment of the new mesh, by Simpson's rule on common pieces."""
    defects = []
    for i, j in zip(new.node[:-1], new.node[1:], strict=True):
        inside = u[old.node][(u[old.node] > u[i]) & (u[old.node] < u[j])]
        cuts = np.array([u[i], *inside, u[j]])
        length = np.diff(cuts)[:, None]
        middle = 0.5 * (cuts[1:] + cuts[:-1])
        nodes = [middle + s * length[:, 0] * np.sqrt(0.15) for s in (-1, 0, 1)]  # of Gauss, exact for cubics
        for weight in (lambda s: np.ones_like(s), lambda s: s):
            defects.append(sum(
                share * np.sum(length * weight(s)[:, None] * (speeds(new, u, w, s) - speeds(old, u, v, s)), axis=0)
                for share, s in zip((5 / 18, 8 / 18, 5 / 18), nodes, strict=True)))
    return np.array(defects)


@settings(deadline=None)
@given(meshes())
def test_projection_keeps_momentum_and_never_adds_energy(mesh):
    u, v, old, new = mesh
    w = inertia.project(old, u, v, new, u)
    np.testing.assert_allclose(momentum(new, u, w), momentum(old, u, v), atol=1e-12)
    assert kinetic_energy(new, u, w) <= kinetic_energy(old, u, v) * (1.0 + 1e-12)


@settings(deadline=None)
@given(meshes())
def test_projection_is_the_nearest_velocity_on_the_new_mesh(mesh):
    """What it changes is orthogonal to all velocities of the new mesh: those linear on each segment."""
    u, v, old, new = mesh
    np.testing.assert_allclose(moment_defects(old, new, u, v, inertia.project(old, u, v, new, u)), 0.0, atol=1e-11)


@settings(deadline=None)
@given(meshes())
def test_projection_on_the_same_mesh_is_the_identity(mesh):
    u, v, old, _ = mesh
    w = inertia.project(old, u, v, old, u)
    np.testing.assert_allclose(w[old.node[:-1], 1], v[old.node[:-1], 1], atol=1e-12)
    np.testing.assert_allclose(w[old.node[1:], 0], v[old.node[1:], 0], atol=1e-12)


@settings(deadline=None)
@given(PLACES, st.integers(0, 1000))
def test_projection_on_a_finer_mesh_is_exact(places, seed):
    model, state = straight_yarn(places, PointKind.EYELET)
    rng = np.random.default_rng(seed)
    coarse, fine = chosen(model, state, rng), chosen(model, state, rng, 0.0)
    v = rng.normal(size=(model.node_count, 2, 3))
    w = inertia.project(coarse, state.u, v, fine, state.u)
    at = 0.5 * (state.u[1:] + state.u[:-1])
    np.testing.assert_allclose(speeds(fine, state.u, w, at), speeds(coarse, state.u, v, at), atol=1e-11)
    back = inertia.project(fine, state.u, w, coarse, state.u)
    np.testing.assert_allclose(speeds(coarse, state.u, back, at), speeds(coarse, state.u, v, at), atol=1e-11)


def test_what_is_no_node_of_the_new_mesh_has_no_velocity():
    model, state = straight_yarn([0.0, 1.0, 2.0], PointKind.EYELET)
    fine = chain_of(model, state.order, np.zeros(3, np.bool_), state.active)
    coarse = chain_of(model, state.order, np.array([False, True, False]), state.active)
    w = inertia.project(fine, state.u, np.ones((3, 2, 3)), coarse, state.u)
    assert not w[1].any() and not w[0, 0].any() and not w[2, 1].any()


@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_the_prediction_is_free_flight(damping):
    model, state = straight_yarn([0.0, 1.0, 2.0], mass_damping=damping)
    rng = np.random.default_rng(0)
    velocity, gravity, h = rng.normal(size=(3, 2, 3)), np.array([1.0, 2.0, 3.0]), 0.1
    found = inertia.predict(model, state.x, velocity, gravity, h)
    wanted = state.x[:, None] + h * np.exp(-damping * h) * velocity + h**2 * gravity
    np.testing.assert_allclose(found, wanted, rtol=1e-15)


def test_no_corner_force_without_sliding_or_without_a_jump():
    model, state = straight_yarn([0.0, 1.0, 2.0, 3.0], PointKind.EYELET)
    chain = chain_of(model, state.order, state.eil, state.active)
    rng = np.random.default_rng(1)
    jumping, sliding = rng.normal(size=(4, 2, 3)), np.array([0.0, 0.3, -0.4, 0.0])
    smooth = np.repeat(jumping[:, :1], 2, axis=1)
    assert inertia.corner_forces(model, chain, state.x, state.u, sliding, jumping).any()
    assert not inertia.corner_forces(model, chain, state.x, state.u, 0.0 * sliding, jumping).any()
    assert not inertia.corner_forces(model, chain, state.x, state.u, sliding, smooth).any()
