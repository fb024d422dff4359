"""Contacts beside held points: which way and how much stiffer they are, derivatives, and what Newton gains by it."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine.geometry.handles import no_handles
from engine.steppers import incremental_potential
from engine.steppers.incremental_potential import IncrementalPotential
from engine.steppers.yarns import YarnStepper
from engine.yarns.assembly import YarnAssembly
from engine.yarns.leverage import ENOUGH, LEAST
from engine.yarns.model import PointKind
from engine.yarns.settings import YarnSettings
from tests.engine.yarns.stacks import MATERIAL, NO_OBSTACLES, UP, Stack, free_weaves, perturbed, random_stack
from tests.engine.yarns.terms import TERMS, alone, full_hessian, left_out_of_hessian, unconstrained
from tests.engine.yarns.test_energies import TURNS, assert_close, differences

SEEDS = pytest.mark.parametrize("seed", range(3))
CONTACT = next(term for term in TERMS if term.name == "contact")
SHARES = st.floats(0.001, 0.999)
EDGE = np.array([0.0, 0.8, 0.6])  # of the edge in `beside_a_pin`, before turning


def beside_a_pin(share, kind=PointKind.EYELET, turn=None, mirrored=False, stretch=1.05, held=True):
    """A straight yarn along x whose first point, or its last if `mirrored`, is held; beside it an EIL node at `share`."""
    turn = turn or Rotation.identity()
    yarns, sign = YarnAssembly(), -1.0 if mirrored else 1.0

    def at(s):
        return (2.0 - s if mirrored else s), stretch * sign * turn.apply([s, 0.0, 0.0])

    yarn = yarns.yarn(MATERIAL, 2.0, 1.0)
    for s in (0.0, 1.0, 2.0):
        yarns.lagrangian(yarn, *at(s), pinned=held and s == 0.0)
    if kind == PointKind.EYELET:
        point = yarns.eyelet(yarn, *at(share))
    elif kind == PointKind.EDGE:
        point = yarns.edge(yarn, *at(share), turn.apply(EDGE))
    else:
        other, (u, x) = yarns.yarn(MATERIAL, 2.0, 1.0), at(share)
        for end in (0.0, 2.0):
            yarns.lagrangian(other, end, x + turn.apply([0.0, end - 1.0, 0.0]))
        point = yarns.crossing(yarn, u, other, 1.0, x, UP, kind=kind)
    model, state = yarns.build()
    state.eil[:] = False
    state.eil[model.point_nodes[point, 0]] = True
    return Stack(model, state, NO_OBSTACLES, -UP), point


def stiffness_at(share):
    """Across the yarn, where the constraint at `share` finds nothing else that moves than the point beyond it."""
    return 1.0 / np.clip(share**2 / ENOUGH, LEAST, 1.0)


@settings(deadline=None, max_examples=50)
@given(share=SHARES, turn=TURNS, mirrored=st.booleans())
@example(share=0.1, turn=Rotation.identity(), mirrored=False)
@example(share=0.99 * np.sqrt(ENOUGH * LEAST), turn=Rotation.identity(), mirrored=False)
@example(share=1.01 * np.sqrt(ENOUGH), turn=Rotation.identity(), mirrored=False)
def test_an_eyelet_is_stiffer_across_the_yarn_by_the_share_of_the_free_point(share, turn, mirrored):
    stack, point = beside_a_pin(share, PointKind.EYELET, turn, mirrored)
    x = turn.apply([1.0, 0.0, 0.0])
    wanted = stiffness_at(share) * (np.eye(3) - np.outer(x, x)) + np.outer(x, x)
    np.testing.assert_allclose(shape_of(stack.potential())[point], wanted, rtol=1e-7, atol=1e-9 * stiffness_at(share))


@settings(deadline=None, max_examples=50)
@given(share=SHARES, turn=TURNS, mirrored=st.booleans())
def test_at_an_edge_it_is_stiffer_across_both_yarn_and_edge(share, turn, mirrored):
    stack, point = beside_a_pin(share, PointKind.EDGE, turn, mirrored)
    across = turn.apply(np.cross([1.0, 0.0, 0.0], EDGE))
    across /= np.linalg.norm(across)
    wanted = np.eye(3) + (stiffness_at(share) - 1.0) * np.outer(across, across)
    np.testing.assert_allclose(shape_of(stack.potential())[point], wanted, rtol=1e-7, atol=1e-9 * stiffness_at(share))


def shape_of(potential):
    """W of all points, the identity where there is no constraint."""
    shape = np.broadcast_to(np.eye(3), (potential.model.point_count, 3, 3)).copy()
    shape[potential.split] = potential.constraint_shape[potential.split]
    return shape


@settings(deadline=None, max_examples=20)
@given(share=SHARES, stretch=st.floats(0.5, 1.5))
def test_what_moves_on_its_own_needs_no_help(share, stretch):
    """A contact beside a pin whose partner is free, and an eyelet whose yarn is."""
    for kind, held in ((PointKind.CONTACT, True), (PointKind.CROSSING, True), (PointKind.EYELET, False)):
        stack, point = beside_a_pin(share, kind, stretch=stretch, held=held)
        potential = stack.potential()
        assert point in potential.split
        np.testing.assert_allclose(shape_of(potential) - np.eye(3), 0.0, atol=1e-12)


def test_contacts_away_from_what_is_held_are_as_they_were():
    near, far = 0, 0
    for stack in [random_stack(seed) for seed in range(6)] + [free_weaves(seed) for seed in range(3)]:
        potential, chain, model = stack.potential(), stack.chain, stack.model
        held = (model.free_directions != np.eye(3)).any(axis=(1, 2))
        nodes = model.point_nodes[potential.split]
        eil = (nodes >= 0) & stack.state.eil[nodes]
        ends = model.node_point[np.stack([chain.before[nodes], chain.after[nodes]])]
        beside = (eil & held[ends].any(axis=0)).any(axis=1)
        differs = (potential.constraint_shape[potential.split] != np.eye(3)).any(axis=(1, 2))
        assert not differs[~beside].any()
        near += np.count_nonzero(differs[beside])
        far += np.count_nonzero(~beside)
    assert near > 3 and far > 10


def stiffened(seed):
    """A random stack, its potential with contacts that are ten times as stiff in random directions, and a place."""
    stack = random_stack(seed)
    potential = stack.potential()
    n = np.random.default_rng(seed).normal(size=(len(potential.split), 3))
    n *= 3.0 / np.linalg.norm(n, axis=1, keepdims=True)
    potential.constraint_shape[potential.split] = np.eye(3) + n[:, :, None] * n[:, None, :]
    return stack, potential, perturbed(stack, seed)


@SEEDS
def test_the_energy_grows_by_the_square_of_the_gap_in_stiffer_directions(seed):
    """And the force of contacts is its derivative with respect to the gap."""
    stack, potential, (x, u) = stiffened(seed)
    plain = alone(CONTACT, stack.potential())
    plain.constraint_shape[:] = np.eye(3)
    split = potential.split
    more = alone(CONTACT, potential).gradient(x, u)[0] - plain.gradient(x, u)[0]
    g, k = potential.gap[split], potential.constraint_stiffness[split, None]
    resisted = np.einsum("pij,pj->pi", potential.constraint_shape[split], g)
    assert more == pytest.approx(0.5 * np.sum(k * g * (resisted - g)), rel=1e-9)
    wanted = potential.multiplier[split] + k * resisted
    np.testing.assert_allclose(potential.contact_force()[split], wanted, rtol=1e-12)


@SEEDS
@pytest.mark.parametrize("terms", [[CONTACT], TERMS], ids=["contact", "all"])
def test_gradient_and_hessian_with_stiffer_directions_are_derivatives(terms, seed):
    stack, p, (x, u) = stiffened(seed)
    p = alone(CONTACT, p) if terms == [CONTACT] else unconstrained(p)
    gradient = p.gradient(x, u)[1].ravel()
    assert_close(gradient, differences(lambda x, u: p.gradient(x, u)[0], stack.model, x, u), 1e-6)
    found = full_hessian(p, x, u, convex=False) + sum(left_out_of_hessian(term, p, x, u) for term in terms)
    assert_close(found, differences(lambda x, u: p.gradient(x, u)[1].ravel(), stack.model, x, u), 1e-6)


@SEEDS
def test_the_convex_hessian_with_stiffer_directions_is_positive(seed):
    _, potential, (x, u) = stiffened(seed)
    hessian = full_hessian(alone(CONTACT, potential), x, u, convex=True)
    scale = np.abs(hessian).max()
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-13 * scale)
    assert np.linalg.eigvalsh(hessian).min() >= -1e-12 * scale


@pytest.mark.parametrize("share", [0.01, 0.03, 0.08])
def test_a_yarn_over_an_edge_beside_its_clamp_takes_fewer_iterations(share, monkeypatch):
    """It comes to the same place, as far as the gap that is left tells."""
    tolerance, updates, update = 1e-4, [], IncrementalPotential.update_multipliers
    monkeypatch.setattr(IncrementalPotential, "update_multipliers", lambda *args: updates.append(args) or update(*args))

    def step():
        stack, point = beside_a_pin(share, PointKind.EDGE, stretch=1.0)
        stepper = YarnStepper(stack.model, YarnSettings(gap_tolerance=tolerance), -UP, NO_OBSTACLES, no_handles())
        updates.clear()
        report = stepper.step(stack.state, 0.0, 0.1)
        assert report.accepted and stack.state.eil[stack.model.point_nodes[point, 0]]
        return stack.state.x, report.newton_iterations, len(updates)

    x, iterations, taken = step()
    monkeypatch.setattr(incremental_potential, "stiffness_by_leverage",
                        lambda m, s, c, points, *_: np.broadcast_to(np.eye(3), (len(points), 3, 3)))
    x_without, iterations_without, taken_without = step()
    np.testing.assert_allclose(x, x_without, atol=2.0 * tolerance * MATERIAL.radius / share)
    assert iterations < iterations_without and 2 * taken <= taken_without
