"""Energies of strands: derivatives, invariance, what folds and what turns by whole turns."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine.strands import bending
from engine.validate.der_gradients import Chart, H, errors, moved_chart, random_strand

TERMS = {
    "inertia": ("mass", "spin_inertia"), "stretch": ("stretch_stiffness",), "bending": ("bending_stiffness",),
    "twist": ("twist_stiffness",),
}
STIFF = [name for names in TERMS.values() for name in names]


def alone(term: str, model):
    """The model with only the stiffnesses of one term."""
    return model._replace(**{name: 0 * getattr(model, name) for name in STIFF if name not in TERMS[term]})


@pytest.mark.parametrize("term", TERMS)
@pytest.mark.parametrize("seed", range(2))
def test_derivatives_are_those_of_the_energy(term, seed):
    model, state = random_strand(seed)
    of_gradient, of_hessian = errors(Chart(alone(term, model), state, H), 1e-3)
    assert of_gradient < 1e-8 and of_hessian < 1e-6


@pytest.mark.parametrize("seed", range(2))
def test_derivatives_of_all_with_friction_are_those_of_the_energy_too(seed):
    of_gradient, of_hessian = errors(moved_chart(seed), 1e-3)
    assert of_gradient < 1e-8 and of_hessian < 1e-6


def test_what_is_held_has_no_force_and_rows_of_the_identity():
    model, state = random_strand(0)
    model.held[[0, 3], :2] = model.held[1, 3] = True
    chart = Chart(model, state, H)
    rows = np.flatnonzero(model.held.reshape(-1))
    assert not chart.gradient()[rows].any()
    np.testing.assert_array_equal(chart.hessian()[rows], np.eye(chart.unknowns)[rows])


@pytest.mark.parametrize("seed", range(2))
def test_friction_is_measured_from_the_shape_at_the_start(seed):
    """Its force vanishes there, whatever the elastic ones; its Hessian is that of as much more stiffness without a strain."""
    model, state = random_strand(seed)
    model = model._replace(mass=0 * model.mass, spin_inertia=0 * model.spin_inertia)
    elastic = Chart(model._replace(damping=0 * model.damping), state, H)
    damped = Chart(model._replace(damping=np.full_like(model.damping, 3.0 * H)), state, H)
    np.testing.assert_allclose(damped.gradient(), elastic.gradient(), atol=1e-12 * np.abs(elastic.gradient()).max())
    positive = elastic.hessian(positive=True)
    assert np.linalg.eigvalsh(positive).min() > -1e-12 * np.abs(positive).max()
    turns = np.s_[3:-4:4, 3:-4:4]  # of edges: stretch, whose positive form has a limit, takes no part in them
    np.testing.assert_allclose(damped.hessian(positive=True)[turns], 4 * positive[turns], rtol=1e-9, atol=1e-12)


@settings(deadline=None)  # the first example compiles
@given(angles=st.tuples(*[st.floats(-3, 3)] * 3), seed=st.integers(0, 20))
def test_rigid_motion_turns_forces_and_keeps_the_energy(angles, seed):
    model, state = random_strand(seed)
    model = model._replace(mass=0 * model.mass)
    rotation = Rotation.from_rotvec(angles)
    turned = replace(state, x=rotation.apply(state.x) + np.array([1.0, -2.0, 3.0]), m1=rotation.apply(state.m1))
    here, there = Chart(model, state, H), Chart(model, turned, H)
    origin = np.zeros(here.unknowns)
    assert there.energy(origin) == pytest.approx(here.energy(origin), rel=1e-10)
    g, g_there = here.gradient().reshape(-1, 4), there.gradient().reshape(-1, 4)
    np.testing.assert_allclose(g_there[:, :3], rotation.apply(g[:, :3]), atol=1e-9 * np.abs(g).max())
    np.testing.assert_allclose(g_there[:, 3], g[:, 3], atol=1e-9 * np.abs(g).max())


@pytest.mark.parametrize("seed", range(3))
def test_internal_forces_and_moments_balance(seed):
    model, state = random_strand(seed)
    g = Chart(model._replace(mass=0 * model.mass, spin_inertia=0 * model.spin_inertia), state, H).gradient().reshape(-1, 4)
    t = np.diff(state.x, axis=0)
    t /= np.linalg.norm(t, axis=1)[:, None]
    moment = np.cross(state.x, g[:, :3]).sum(axis=0) + (g[:-1, 3:] * t).sum(axis=0)
    np.testing.assert_allclose(g[:, :3].sum(axis=0), 0.0, atol=1e-12 * np.abs(g).max())
    np.testing.assert_allclose(moment, 0.0, atol=1e-11 * np.abs(g).max())


def test_folded_edges_have_finite_derivatives():
    model, state = random_strand(0)
    state.x[3] = state.x[1] + 1e-12  # edge 2 lies on edge 1
    chart = Chart(model, state, H)
    assert np.isfinite(chart.energy(np.zeros(chart.unknowns)))
    assert np.isfinite(chart.gradient()).all() and np.isfinite(chart.hessian()).all()


def test_curvature_is_twice_the_tangent_of_half_the_angle():
    angle = 0.7
    t = np.array([[1.0, 0, 0], [np.cos(angle), np.sin(angle), 0], [0, 0, 0]])
    m1, m2 = np.tile([0.0, 0.0, 1.0], (3, 1)), np.cross(t, [0.0, 0.0, 1.0])
    binormal, kappa = np.zeros((3, 3)), np.zeros((3, 2, 2))
    bending.curvatures(t, m1, m2, binormal, kappa)
    np.testing.assert_allclose(binormal[1], [0, 0, 2 * np.tan(angle / 2)], rtol=1e-7)
    np.testing.assert_allclose(kappa[1, :, 1], -2 * np.tan(angle / 2), rtol=1e-7)
    np.testing.assert_allclose(kappa[1, :, 0], 0.0, atol=1e-12)


@pytest.mark.parametrize("turn", [np.pi / 2, 4.0, -10.0])
def test_twist_counts_whole_turns(turn):
    """However far an edge is turned at once, or in twelve goes."""
    model, state = random_strand(1)
    chart, q = Chart(model, state, H), np.zeros(4 * len(state.x))
    q[4 * 2 + 3] = turn
    for times in range(1, 13):
        chart.move(q)
        assert chart.now.twist[2] - state.twist[2] == pytest.approx(times * turn, abs=1e-9)
        assert chart.now.twist[3] - state.twist[3] == pytest.approx(-times * turn, abs=1e-9)
