"""Coulomb's law as a projection: potentials and their slopes, friction within its limit, the law at rest."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from engine.contact.cones import friction, friction_limit, friction_potential, friction_slope, normal_force

FORCES = st.floats(-5.0, 5.0)
STIFFNESSES = st.floats(0.1, 10.0)
GAPS = st.floats(-1.0, 1.0)
PULLS = st.sampled_from([0.0, 0.5, 2.0])
LIMITS = st.floats(0.01, 4.0)
WIDTH = 1e-5


def kinks(k, gap, pull):
    """Trial forces at which the normal force has no slope."""
    return np.array([k * gap - pull] if gap <= 0.0 else [k * gap, 0.0, -pull])


@settings(deadline=None)  # the first example compiles
@given(t=FORCES, k=STIFFNESSES, gap=GAPS, pull=PULLS)
def test_the_normal_force_is_the_slope_of_its_potential(t, k, gap, pull):
    assume(np.abs(kinks(k, gap, pull) - t).min() > 2 * WIDTH)
    r, slope, _ = normal_force(t, k, gap, pull)
    after, before = normal_force(t + WIDTH, k, gap, pull), normal_force(t - WIDTH, k, gap, pull)
    assert (after[2] - before[2]) / (2 * WIDTH) == pytest.approx(r, abs=1e-7)
    assert (after[0] - before[0]) / (2 * WIDTH) == pytest.approx(slope, abs=1e-7)
    assert slope in (0.0, 1.0) and r >= -pull


@settings(deadline=None)
@given(k=STIFFNESSES, gap=GAPS, pull=PULLS)
def test_the_normal_force_and_its_potential_have_no_jumps(k, gap, pull):
    for t in kinks(k, gap, pull):
        before, after = normal_force(t - 1e-12, k, gap, pull), normal_force(t + 1e-12, k, gap, pull)
        assert after[0] == pytest.approx(before[0], abs=1e-10) and after[2] == pytest.approx(before[2], abs=1e-10)


@settings(deadline=None)
@given(t=FORCES, more=st.floats(0.0, 3.0), k=STIFFNESSES, gap=GAPS, pull=PULLS)
def test_the_normal_force_rises_with_what_presses(t, more, k, gap, pull):
    low, high = normal_force(t, k, gap, pull)[0], normal_force(t + more, k, gap, pull)[0]
    assert -1e-12 <= high - low <= more + 1e-12


@settings(deadline=None)
@given(r=FORCES, w=GAPS, k=STIFFNESSES, gap=GAPS, pull=PULLS)
def test_a_force_that_is_its_own_keeps_the_law(r, w, k, gap, pull):
    """A fixed point r = r(r - k w) is pressed where sides touch, nothing between, and the pull where they part."""
    own, _, _ = normal_force(r - k * w, k, gap, pull)
    assume(abs(own - r) < 1e-9)
    assert r >= -pull - 1e-9 and gap + w >= -1e-9
    if r > 1e-8:
        assert gap + w == pytest.approx(0.0, abs=1e-8)
    if w > max(-gap, 0.0) + 1e-8:
        assert r == pytest.approx(-pull, abs=1e-8)


@pytest.mark.parametrize(("w", "gap", "r", "lawful"), [
    (-0.2, 0.2, 3.0, True), (-0.2, 0.2, 0.0, True), (-0.1, 0.2, 0.0, True), (0.0, 0.2, -0.3, True), (0.4, 0.2, -0.5, True),
    (0.1, -0.1, 2.0, True), (0.1, -0.1, -0.4, True), (0.3, -0.1, -0.5, True),
    (-0.1, 0.2, 1.0, False), (-0.3, 0.2, 0.0, False), (0.4, 0.2, 0.0, False), (0.0, 0.2, -0.6, False), (0.0, -0.1, 1.0, False),
])
def test_lawful_forces_are_fixed_points_and_others_are_not(w, gap, r, lawful):
    for k in (0.1, 1.0, 10.0):
        assert (abs(normal_force(r - k * w, k, gap, 0.5)[0] - r) < 1e-12) == lawful


@settings(deadline=None)
@given(t1=FORCES, t2=FORCES, k1=STIFFNESSES, k2=STIFFNESSES, limit=LIMITS)
def test_friction_is_within_its_limit_and_nearest(t1, t2, k1, k2, limit):
    r1, r2, a = friction(t1, t2, k1, k2, limit)
    assert np.hypot(r1, r2) <= limit * (1 + 1e-12) and a >= 0.0
    if np.hypot(t1, t2) <= limit:
        assert (r1, r2, a) == (t1, t2, 0.0)
        return

    def energy(angle):
        return (t1 - limit * np.cos(angle)) ** 2 / k1 + (t2 - limit * np.sin(angle)) ** 2 / k2

    around = np.linspace(-np.pi, np.pi, 73)
    start = around[np.argmin(energy(around))]
    least = minimize_scalar(energy, bounds=(start - 0.1, start + 0.1), method="bounded", options={"xatol": 1e-10}).fun
    assert (t1 - r1) ** 2 / k1 + (t2 - r2) ** 2 / k2 <= least * (1 + 1e-9) + 1e-12
    np.testing.assert_allclose([r1 * (1 + a * k1), r2 * (1 + a * k2)], [t1, t2], rtol=1e-9, atol=1e-9)


@settings(deadline=None)
@given(t1=FORCES, t2=FORCES, k1=STIFFNESSES, k2=STIFFNESSES, limit=LIMITS)
def test_friction_is_the_slope_of_its_potential_and_its_slope_is_symmetric(t1, t2, k1, k2, limit):
    assume(abs(np.hypot(t1, t2) - limit) > 1e-3)

    def at(w1, w2):
        t = t1 - k1 * w1, t2 - k2 * w2
        r1, r2, a = friction(*t, k1, k2, limit)
        return friction_potential(*t, r1, r2, k1, k2), np.array([r1, r2]), a

    _, r, a = at(0.0, 0.0)
    s11, s12, s22 = friction_slope(*r, k1, k2, a, True)
    steps = WIDTH / max(k1, k2) * np.eye(2)
    sides = [(at(*d), at(*-d), np.abs(d).max()) for d in steps]
    slopes = np.array([(after[0] - before[0]) / (2 * width) for after, before, width in sides])
    np.testing.assert_allclose(slopes, -r, rtol=1e-5, atol=1e-5 * max(limit, 1.0))
    by_w = np.array([(after[1] - before[1]) / (2 * width) for after, before, width in sides])
    wanted = np.array([[s11, s12], [s12, s22]])
    np.testing.assert_allclose(by_w, -wanted, rtol=1e-4, atol=1e-4 * max(k1, k2))
    assert np.linalg.eigvalsh(wanted)[0] >= -1e-9 * max(k1, k2)


@settings(deadline=None)
@given(t=st.tuples(FORCES, FORCES), other=st.tuples(FORCES, FORCES), k1=STIFFNESSES, k2=STIFFNESSES, limit=LIMITS)
def test_the_secant_of_friction_makes_a_parabola_above_its_potential(t, other, k1, k2, limit):
    r1, r2, a = friction(*t, k1, k2, limit)
    s11, s12, s22 = friction_slope(r1, r2, k1, k2, a, False)
    w1, w2 = (t[0] - other[0]) / k1, (t[1] - other[1]) / k2
    here = friction_potential(*t, r1, r2, k1, k2)
    there = friction_potential(*other, *friction(*other, k1, k2, limit)[:2], k1, k2)
    above = here - r1 * w1 - r2 * w2 + 0.5 * (s11 * w1 * w1 + s22 * w2 * w2)
    assume(np.isfinite(a))
    assert s12 == 0.0
    assert there <= above + 1e-9 * (abs(above) + abs(here) + limit * (abs(w1) + abs(w2)))


@pytest.mark.parametrize("limit", [0.0, 5e-324, 1e-200])
def test_without_a_limit_there_is_no_friction(limit):
    r1, r2, a = friction(1.0, -2.0, 1.0, 3.0, limit)
    assert (r1, r2, a) == (0.0, 0.0, np.inf) and friction_slope(r1, r2, 1.0, 3.0, a, True) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("r", "t", "gap", "limit"), [
    (2.0, 3.0, 0.1, 1.25), (0.0, 0.5, 1.0, 0.0), (-0.3, -0.3, 1.0, 0.1), (-0.5, -2.0, 1.0, 0.0), (-0.2, 1.0, -0.1, 0.15),
])
def test_friction_is_limited_by_force_and_pull_where_sides_are_not_free(r, t, gap, limit):
    assert friction_limit(r, t, 1.0, gap, 0.5, 0.5) == pytest.approx(limit)
