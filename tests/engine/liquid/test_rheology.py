"""One point of liquid: kernels against matrices, both returns against what defines them, the tangent against the derivative."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from engine.liquid.rheology import (
    analytic_return,
    deviator,
    elastic_trial,
    flow_step,
    implicit_return,
    newtonian_stress,
    plastic_strain,
    product,
    relaxed_strain,
    shear,
    strain_rate,
    tangent_stress,
    trial_stress,
    volume_preserving,
)

RETURNS = {"closed form": analytic_return, "backward Euler": implicit_return}
REST = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
INDICES = st.floats(0.2, 1.5) | st.sampled_from([0.2, 1.0 - 1e-12, 1.0, 1.0 + 1e-12, 1.5])
LOGS = st.floats(-8.0, 8.0)
SEEDS = st.integers(0, 2**32 - 1)


def matrix(a):
    return np.array([[a[0], a[5], a[4]], [a[5], a[1], a[3]], [a[4], a[3], a[2]]])


def six(m):
    return np.array([m[0, 0], m[1, 1], m[2, 2], m[1, 2], m[0, 2], m[0, 1]])


def dev(m):
    return m - np.trace(m) / 3.0 * np.eye(3)


def random_strain(rng, size=0.3):
    f = np.eye(3) + size * rng.uniform(-1.0, 1.0, (3, 3))
    b = f @ f.T
    return b / np.linalg.det(b) ** (1.0 / 3.0)


def trial_matrix(b, gradient, h):
    f = np.eye(3) + h * gradient
    return f @ b @ f.T / np.cbrt(np.linalg.det(f)) ** 2


def stress(b, gradient, h, mu, sigma, eta, n, back):
    """Shear stress [3, 3] at the end of a step."""
    trial = trial_matrix(b, gradient, h)
    pull = mu * np.linalg.norm(dev(trial))
    s, _ = back(pull, mu * np.trace(trial) / 3.0, h, sigma, eta, n)
    return s / pull * mu * dev(trial)


def stress_change(b, gradient, change, h, mu, sigma, eta, n, back):
    """Exact derivative of `stress` by the gradient, along `change`."""
    f = np.eye(3) + h * gradient
    trial, moved = trial_matrix(b, gradient, h), h * change @ np.linalg.inv(f)
    d_trial = moved @ trial + trial @ moved.T - 2.0 / 3.0 * np.trace(moved) * trial
    pull, mu_hat = mu * np.linalg.norm(dev(trial)), mu * np.trace(trial) / 3.0
    s, slope = back(pull, mu_hat, h, sigma, eta, n)
    d_pull = mu * mu * np.sum(dev(trial) * d_trial) / pull
    d_s = slope * d_pull
    if s > sigma:
        flow = -2.0 * h * ((s - sigma) / eta) ** (1.0 / n)
        d_s += (flow if back is analytic_return else flow * slope) * mu / 3.0 * np.trace(d_trial)
    return mu * (s / pull * dev(d_trial) + (d_s - s / pull * d_pull) / pull * dev(trial))


@settings(deadline=None)
@given(SEEDS)
def test_a_step_strains_as_matrices_do_and_keeps_volume(seed):
    rng = np.random.default_rng(seed)
    b, gradient, h = random_strain(rng), rng.uniform(-10.0, 10.0, (3, 3)), 0.02
    trial = elastic_trial(six(b), gradient, h)
    assert np.allclose(matrix(trial), trial_matrix(b, gradient, h), rtol=1e-12, atol=1e-12)
    assert np.linalg.det(matrix(trial)) == pytest.approx(1.0, rel=1e-11)


@settings(deadline=None)
@given(SEEDS)
def test_parts_of_tensors_are_those_of_matrices(seed):
    rng = np.random.default_rng(seed)
    a, b, gradient = random_strain(rng), random_strain(rng), rng.uniform(-1.0, 1.0, (3, 3))
    assert np.allclose(matrix(deviator(six(a))), dev(a), atol=1e-14)
    assert product(six(a), six(b)) == pytest.approx(np.sum(a * b))
    unit, size, mu_hat = trial_stress(six(a), 5.0)
    assert size == pytest.approx(np.linalg.norm(dev(a))) and mu_hat == pytest.approx(5.0 * np.trace(a) / 3.0)
    assert np.allclose(size * matrix(unit), dev(a), atol=1e-14)
    assert np.allclose(matrix(strain_rate(gradient)), dev(0.5 * (gradient + gradient.T)), atol=1e-15)
    assert np.allclose(matrix(newtonian_stress(gradient, 3.0)), 1.5 * dev(gradient + gradient.T), atol=1e-15)


def test_a_point_at_rest_has_no_direction():
    assert trial_stress(REST, 2.0) == ((0.0,) * 6, 0.0, 2.0)
    assert flow_step(REST, np.zeros((3, 3)), 0.1, 2.0, 1.0, 1.0, 0.5, True) == REST


@settings(deadline=None, max_examples=300)
@given(n=INDICES, size=LOGS, loss=st.floats(-10.0, 12.0), sigma=st.sampled_from([0.0, 1.0]))
def test_backward_euler_solves_its_equation(n, size, loss, sigma):
    excess, y = 10.0**size, 10.0**loss
    h = 0.5 * y * excess / (excess / 3.0) ** (1.0 / n)  # so that y is what is lost at the first rate, for mu_hat = 1
    s, _ = implicit_return(excess, 1.0, h, 0.0, 3.0, n)
    assert 0.0 < s <= excess
    assert s + 2.0 * h * (s / 3.0) ** (1.0 / n) == pytest.approx(excess, rel=2e-14)
    shifted, _ = implicit_return(excess + sigma, 1.0, h, sigma, 3.0, n)
    assert shifted == pytest.approx(s + sigma, rel=1e-6)


@settings(deadline=None, max_examples=200)
@given(n=INDICES, loss=st.floats(-6.0, 6.0), trial=st.floats(2.1, 50.0))
@pytest.mark.parametrize("back", RETURNS.values(), ids=RETURNS)
def test_a_return_is_between_yield_and_trial_and_has_its_slope(back, n, loss, trial):
    h = 10.0**loss
    s, slope = back(trial, 1.5, h, 2.0, 3.0, n)
    assert 2.0 <= s <= trial and 0.0 <= slope <= 1.0
    width = 1e-5 * (trial - 2.0)
    if n < 1.0 or s > 2.0 + 0.01 * (trial - 2.0):  # for n > 1 flow ends in finite time, with a kink
        higher, lower = back(trial + width, 1.5, h, 2.0, 3.0, n)[0], back(trial - width, 1.5, h, 2.0, 3.0, n)[0]
        assert (higher - lower) / (2.0 * width) == pytest.approx(slope, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("back", RETURNS.values(), ids=RETURNS)
def test_limits_of_a_return(back):
    assert back(1.0, 2.0, 0.1, 1.0, 3.0, 0.5) == (1.0, 1.0)  # at yield
    assert back(5.0, 2.0, 0.1, 1.0, 0.0, 0.5) == (1.0, 0.0)  # no viscosity
    for n in (0.2, 1.0, 1.5):
        assert back(5.0, 2.0, 0.0, 1.0, 3.0, n) == (5.0, 1.0)  # no time
    assert analytic_return(5.0, 2.0, 1e3, 1.0, 3.0, 1.5) == (1.0, 0.0)  # all of it, in finite time


@settings(deadline=None)
@given(n=INDICES, loss=st.floats(-4.0, 3.0))
def test_two_halves_of_the_closed_form_are_the_whole(n, loss):
    h = 10.0**loss
    half, _ = analytic_return(7.0, 1.5, 0.5 * h, 2.0, 3.0, n)
    whole, _ = analytic_return(7.0, 1.5, h, 2.0, 3.0, n)
    assert analytic_return(half, 1.5, 0.5 * h, 2.0, 3.0, n)[0] == pytest.approx(whole, rel=1e-12)


@pytest.mark.parametrize("x", [0.1, 1.0, 10.0])
def test_steady_stress_is_that_of_the_liquid_by_backward_euler_only(x):
    """Of small elastic strain, n = 1 and no yield stress: in a step stress gains 2 mu_hat h gamma, and eta gamma is steady."""
    eta, gamma, steady = 2.0, 3.0, {}
    for name, back in RETURNS.items():
        s = 0.0
        for _ in range(600):
            s, _ = back(s + x * eta * gamma, x * eta / 2.0, 1.0, 0.0, eta, 1.0)
        steady[name] = s / (eta * gamma)
    assert steady == pytest.approx({"closed form": x / np.expm1(x), "backward Euler": 1.0}, rel=1e-12)


@settings(deadline=None)
@given(SEEDS, st.floats(0.0, 1.0))
def test_flow_takes_from_the_deviator_only(seed, left):
    trial = random_strain(np.random.default_rng(seed))
    b = matrix(relaxed_strain(six(trial), left))
    assert np.allclose(b, left * dev(trial) + np.trace(trial) / 3.0 * np.eye(3), atol=1e-14)
    kept = matrix(volume_preserving(six(b)))
    assert np.allclose(dev(kept), dev(b), atol=1e-13) and np.linalg.det(kept) == pytest.approx(1.0, rel=1e-12)
    assert np.linalg.eigvalsh(kept).min() > 0.0 and np.linalg.det(b) >= 1.0 - 1e-12


def test_eq_13_12_swells_in_steady_shear_and_what_keeps_volume_is_steady():
    """The trace grows by 2 b_xy per strain, as eq. 13.12 has flow without a trace."""
    run = (1.0, 1e-3, 20_000, 10.0, 1.0, 0.5, 0.5, True)
    for keeps in (False, True):
        b = shear(REST, *run, keeps)
        later = shear(b, *run[:2], 1000, *run[3:], keeps)
        growth = sum(later[:3]) - sum(b[:3])
        if keeps:
            assert growth == pytest.approx(0.0, abs=1e-9) and np.linalg.det(matrix(later)) == pytest.approx(1.0, rel=1e-12)
        else:
            assert growth == pytest.approx(2.0 * b[5], rel=0.02) and np.linalg.det(matrix(b)) > 1.5


@pytest.mark.parametrize("back", RETURNS.values(), ids=RETURNS)
def test_plastic_strain_is_the_integral_of_flow(back):
    trial, mu_hat, h, sigma, eta, n = 5.0, 2.0, 0.3, 1.0, 3.0, 0.5
    s, _ = back(trial, mu_hat, h, sigma, eta, n)
    if back is analytic_return:
        flow = quad(lambda t: ((back(trial, mu_hat, t, sigma, eta, n)[0] - sigma) / eta) ** (1 / n), 0.0, h, epsabs=1e-13)[0]
    else:
        flow = h * ((s - sigma) / eta) ** (1 / n)
    assert plastic_strain(0.2, trial, s, mu_hat, 0.0, h) == pytest.approx(0.2 + flow, rel=1e-10)


def test_plastic_strain_is_forgotten_exactly_at_an_even_rate():
    """Ten steps are one, and much later it is where flow and recovery balance."""
    strain = 0.2
    for _ in range(10):
        strain = plastic_strain(strain, 2.0, 1.8, 1.0, 3.0, 0.1)
    assert strain == pytest.approx(plastic_strain(0.2, 2.0, 0.0, 1.0, 3.0, 1.0), rel=1e-13)
    assert plastic_strain(0.2, 200.0, 0.0, 1.0, 3.0, 100.0) == pytest.approx(1.0 / 3.0)


@settings(deadline=None)
@given(seed=SEEDS, n=st.sampled_from([0.3, 1.0, 1.3]))
@pytest.mark.parametrize("back", RETURNS.values(), ids=RETURNS)
def test_the_reference_is_the_derivative_of_stress(back, seed, n):
    rng = np.random.default_rng(seed)
    b, gradient, change = random_strain(rng), rng.uniform(-5.0, 5.0, (3, 3)), rng.uniform(-1.0, 1.0, (3, 3))
    constants = (0.02, 10.0, 0.3, 0.4, n, back)
    width = 1e-5
    found = (stress(b, gradient + width * change, *constants) - stress(b, gradient - width * change, *constants)) / (2 * width)
    exact = stress_change(b, gradient, change, *constants)
    # kinks are at yield, and at n > 1 where flow ends
    if abs(10.0 * np.linalg.norm(dev(trial_matrix(b, gradient, 0.02))) - 0.3) > 0.1 and n <= 1.0:
        assert np.allclose(found, exact, rtol=1e-6, atol=1e-6 * np.linalg.norm(exact) + 1e-8)


@settings(deadline=None)
@given(seed=SEEDS, n=st.sampled_from([0.3, 1.0, 1.3]), sigma=st.sampled_from([0.0, 3e-7, 1.0]))
@pytest.mark.parametrize("back", RETURNS.values(), ids=RETURNS)
def test_the_tangent_is_the_derivative_at_rest(back, seed, n, sigma):
    rng = np.random.default_rng(seed)
    gradient, change = 1e-6 * rng.uniform(-1.0, 1.0, (3, 3)), rng.uniform(-1.0, 1.0, (3, 3))
    constants = (0.02, 50.0, sigma, 1e-6, n)
    tangent = tangent_of(np.eye(3), gradient, change, *constants, back)
    exact = stress_change(np.eye(3), gradient, change, *constants, back)
    assert np.allclose(tangent, exact, rtol=1e-6, atol=2e-6 * np.linalg.norm(exact))


@settings(deadline=None)
@given(seed=SEEDS, n=INDICES)
@pytest.mark.parametrize("back", RETURNS.values(), ids=RETURNS)
def test_the_tangent_is_symmetric_and_never_negative(back, seed, n):
    rng = np.random.default_rng(seed)
    b, gradient = random_strain(rng), rng.uniform(-20.0, 20.0, (3, 3))
    one, other = rng.uniform(-1.0, 1.0, (2, 3, 3))
    constants = (0.02, 10.0, 2.0, 0.4, n, back)
    first, second = tangent_of(b, gradient, one, *constants), tangent_of(b, gradient, other, *constants)
    assert np.sum(other * first) == pytest.approx(np.sum(one * second), abs=1e-12)
    assert np.sum(one * first) >= 0.0 and np.trace(first) == pytest.approx(0.0, abs=1e-14)


def tangent_of(b, gradient, change, h, mu, sigma, eta, n, back):
    unit, size, mu_hat = trial_stress(elastic_trial(six(b), gradient, h), mu)
    s, slope = back(mu * size, mu_hat, h, sigma, eta, n)
    return matrix(tangent_stress(strain_rate(change), unit, 2.0 * mu_hat * h * s / (mu * size), 2.0 * mu_hat * h * slope))


def test_much_stiffness_and_no_yield_stress_is_a_newtonian_liquid():
    gradient = np.array([[0.3, 2.0, 0.0], [-0.4, -0.1, 0.7], [0.2, 0.0, -0.2]])
    b, mu, eta = REST, 1e6, 2.0
    for _ in range(100):
        b = flow_step(b, gradient, 1e-4, mu, 0.0, eta, 1.0, True)
    assert np.allclose(mu * np.array(deviator(b)), newtonian_stress(gradient, eta), rtol=1e-3, atol=1e-3)
