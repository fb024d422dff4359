"""Every energy of the registry: derivatives, convexity, invariance, balance; and the bending of rings."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine.contact.obstacles import ObstacleKind
from engine.linalg.block_matrix import BLOCK
from engine.yarns import observe
from engine.yarns.assembly import YarnAssembly
from engine.yarns.constraints import projectors
from engine.yarns.model import PointKind
from tests.engine.yarns.stacks import MATERIAL, moved, perturbed, places, random_stack, unknowns
from tests.engine.yarns.terms import TERMS, alone, full_hessian, left_out_of_hessian, unconstrained

EVERY_TERM = pytest.mark.parametrize("term", TERMS, ids=[term.name for term in TERMS])
INTERNAL = [term for term in TERMS if term.internal]
EVERY_INTERNAL_TERM = pytest.mark.parametrize("term", INTERNAL, ids=[term.name for term in INTERNAL])
DAMPING = pytest.mark.parametrize("damping", [0.0, 0.3], ids=["undamped", "damped"])
SEEDS = pytest.mark.parametrize("seed", range(3))
TURNS = st.tuples(*[st.floats(-np.pi, np.pi)] * 3).map(Rotation.from_rotvec)
SHIFTS = st.tuples(*[st.floats(-2.0, 2.0)] * 3).map(np.array)


def differences(of, model, x, u, step=1e-5):
    """Central differences of `of(x, u)` in all unknowns, shape [5 P, ...]."""
    q = unknowns(model, x, u)
    rows = []
    for k in range(q.size):
        ahead, back = q.copy(), q.copy()
        ahead.flat[k] += step
        back.flat[k] -= step
        rows.append((of(*places(model, ahead)) - of(*places(model, back))) / (2.0 * step))
    return np.array(rows)


def assert_close(found, wanted, relative):
    assert np.abs(wanted).max() > 1e-2, "nothing to compare"
    assert np.abs(found - wanted).max() <= relative * np.abs(wanted).max()


def test_the_stacks_have_everything():
    """Otherwise the tests below would hold for want of trying."""
    stacks = [random_stack(seed) for seed in range(3)]
    model = stacks[0].model
    first, second = model.point_nodes.T
    assert set(model.point_kind) == set(PointKind)
    assert [bool(stack.model.height.any()) for stack in stacks] == [False, True, False]
    assert model.kinematic.any() and (model.free_directions == 0.0).all(axis=(1, 2)).any()
    eil = np.stack([stack.state.eil[first].astype(int) + (stack.state.eil[second] & (second >= 0)) for stack in stacks])
    for kind, found in ((PointKind.CONTACT, {0, 1, 2}), (PointKind.CROSSING, {0, 1, 2}), (PointKind.EYELET, {0, 1}),
                        (PointKind.EDGE, {0, 1}), (PointKind.LAGRANGIAN, {0, 1}), (PointKind.STITCH, {0})):
        assert set(eil[:, model.point_kind == kind].ravel()) == found  # how many of its nodes are EIL
    for seed, stack in enumerate(stacks):
        p, u = stack.potential(), perturbed(stack, seed)[1]
        off = np.abs(u - stack.state.anchor)
        slips = off[p.sliding_alone] > (p.friction_limit / p.friction_stiffness)[p.sliding_alone]
        both_slip = off[model.point_nodes[p.rubbing]].min(axis=1) > 2.0 * (p.rubbing_limit / p.rubbing_stiffness)[p.rubbing]
        assert slips.any() and not slips.all() and both_slip.any() and not both_slip.all()
        assert len(p.touching) > 10
        assert set(stack.obstacles.kind) == set(ObstacleKind)


def test_every_energy_is_in_the_registry():
    """With all of them silenced, nothing of the potential is left."""
    stack = random_stack(0)
    p, (x, u) = stack.potential(), perturbed(stack, 0)
    for term in TERMS:
        assert p.gradient(x, u)[1].any()
        term.silence(p)
    energy, gradient = unconstrained(p).gradient(x, u)
    assert energy == 0.0 and not gradient.any()
    assert not full_hessian(p, x, u, convex=False).any()


@SEEDS
def test_the_potential_is_the_sum_of_its_energies(seed):
    stack = random_stack(seed)
    x, u = perturbed(stack, seed)
    energies, gradients = zip(*(alone(term, stack.potential()).gradient(x, u) for term in TERMS), strict=True)
    energy, gradient = unconstrained(stack.potential()).gradient(x, u)
    assert energy == pytest.approx(sum(energies), rel=1e-12)
    np.testing.assert_allclose(gradient, sum(gradients), atol=1e-11)
    for convex in (False, True):
        each = [full_hessian(alone(term, stack.potential()), x, u, convex) for term in TERMS]
        np.testing.assert_allclose(full_hessian(unconstrained(stack.potential()), x, u, convex), sum(each), atol=1e-11)


@EVERY_TERM
@DAMPING
@SEEDS
def test_the_gradient_is_the_derivative_of_the_energy(term, damping, seed):
    stack = random_stack(seed, stretch_damping=damping)
    p, (x, u) = alone(term, stack.potential()), perturbed(stack, seed)
    assert_close(p.gradient(x, u)[1].ravel(), differences(lambda x, u: p.gradient(x, u)[0], stack.model, x, u), 1e-6)


@EVERY_TERM
@DAMPING
@SEEDS
def test_the_hessian_and_what_it_leaves_out_are_the_derivative_of_the_gradient(term, damping, seed):
    stack = random_stack(seed, stretch_damping=damping)
    p, (x, u) = alone(term, stack.potential()), perturbed(stack, seed)
    found = full_hessian(p, x, u, convex=False) + left_out_of_hessian(term, p, x, u)
    assert_close(found, differences(lambda x, u: p.gradient(x, u)[1].ravel(), stack.model, x, u), 1e-5)


@EVERY_TERM
@SEEDS
def test_the_convex_hessian_is_positive(term, seed):
    stack = random_stack(seed)
    x, u = perturbed(stack, seed)
    hessian = full_hessian(alone(term, stack.potential()), x, u, convex=True)
    scale = np.abs(hessian).max()
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-13 * scale)
    assert np.linalg.eigvalsh(hessian).min() >= -1e-12 * scale


@EVERY_TERM
@settings(deadline=None, max_examples=10)
@given(rotation=TURNS, shift=SHIFTS)
def test_nothing_changes_where_the_world_is_turned_and_shifted(term, rotation, shift):
    stack = random_stack(1)
    turned = moved(stack, rotation, shift)
    x, u = perturbed(stack, 1)
    energy, gradient = alone(term, stack.potential()).gradient(x, u)
    energy_there, gradient_there = alone(term, turned.potential()).gradient(rotation.apply(x) + shift, u)
    scale = np.abs(gradient).max()
    assert energy_there == pytest.approx(energy, rel=1e-9)
    np.testing.assert_allclose(gradient_there[:, :3], rotation.apply(gradient[:, :3]), atol=1e-9 * scale)
    np.testing.assert_allclose(gradient_there[:, 3:], gradient[:, 3:], atol=1e-9 * scale)


@EVERY_INTERNAL_TERM
@SEEDS
def test_internal_forces_balance(term, seed):
    """No force and no moment on the whole, and none along a yarn's material, which may count from anywhere."""
    stack = random_stack(seed)
    stack.state.contact_force[:] = 0.0  # their moment vanishes with the gaps only
    model, (x, u) = stack.model, perturbed(stack, seed)
    p = alone(term, stack.potential())
    p.constraint_shape[:] = np.eye(3)  # nor is the force of a contact along the gap beside what is held
    gradient = p.gradient(x, u)[1]
    moment = np.cross(x, gradient[:, :3]).sum(axis=0)
    scale = np.abs(gradient).sum()
    np.testing.assert_allclose(gradient[:, :3].sum(axis=0), 0.0, atol=1e-13 * scale)
    np.testing.assert_allclose(moment, 0.0, atol=1e-12 * scale)
    along = np.bincount(model.node_yarn, gradient[model.node_point, 3 + model.node_slot])
    np.testing.assert_allclose(along, 0.0, atol=1e-13 * scale)


@SEEDS
@pytest.mark.parametrize("convex", [False, True], ids=["true", "convex"])
def test_constrained_unknowns_take_no_part(seed, convex):
    """The gradient is S g and the Hessian S H S, with something positive for what S cancels."""
    stack = random_stack(seed)
    x, u = perturbed(stack, seed)
    s = projectors(stack.model, stack.state)
    free = unconstrained(stack.potential()).gradient(x, u)[1]
    np.testing.assert_allclose(stack.potential().gradient(x, u)[1], np.einsum("pij,pj->pi", s, free), atol=1e-13)

    full = np.zeros((len(s), BLOCK, len(s), BLOCK))
    full[np.arange(len(s)), :, np.arange(len(s))] = s
    full = full.reshape(len(s) * BLOCK, -1)
    kept, cancelled = full, np.eye(len(full)) - full
    found = full_hessian(stack.potential(), x, u, convex)
    wanted = kept @ full_hessian(unconstrained(stack.potential()), x, u, convex) @ kept
    np.testing.assert_allclose(found, found.T, atol=1e-12)
    np.testing.assert_allclose(kept @ found @ kept, wanted, atol=1e-11)
    np.testing.assert_allclose(kept @ found @ cancelled, 0.0, atol=1e-11)
    assert np.linalg.eigvalsh(cancelled @ found @ cancelled + kept).min() > 0.0


@settings(deadline=None, max_examples=20)
@given(corners=st.integers(3, 200), radius=st.floats(0.01, 10.0), stiffness=st.floats(1e-6, 1.0), turn=TURNS)
def test_a_ring_stores_pi_k_b_over_r_for_every_polygon(corners, radius, stiffness, turn):
    angle = 2.0 * np.pi * np.arange(corners + 2) / corners  # the first side once more, so that every corner bends
    yarns = YarnAssembly()
    u, x = radius * angle, radius * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    yarn = yarns.yarn(replace(MATERIAL, stretch_stiffness=0.0, bending_stiffness=stiffness), u[-1], u[1])
    yarns.lagrangians(yarn, u, turn.apply(x))
    potential = observe.energies(*yarns.build(), np.zeros(3))["potential"]
    assert potential == pytest.approx(np.pi * stiffness / radius, rel=1e-9)


def test_a_straight_yarn_resists_every_bend_alike():
    """Where the plane of bending is arbitrary, the Hessian is still the derivative of the gradient."""
    yarns = YarnAssembly()
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    yarns.lagrangians(yarns.yarn(MATERIAL, 2.0, 1.0), np.arange(3.0), np.arange(3.0)[:, None] * axis)
    stack = replace(random_stack(0), **dict(zip(("model", "state"), yarns.build(), strict=True)))
    p = alone(next(term for term in TERMS if term.name == "bending"), stack.potential())
    x, u = stack.state.x, stack.state.u
    energy, gradient = p.gradient(x, u)
    assert energy == 0.0 and not gradient.any()
    for convex in (False, True):
        found = full_hessian(p, x, u, convex)
        assert_close(found, differences(lambda x, u: p.gradient(x, u)[1].ravel(), stack.model, x, u), 1e-5)
