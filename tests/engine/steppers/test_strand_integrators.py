"""BDF2 of strands: closed forms, order under steps of any lengths, conservation, loads, and what it does in contact."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandAssembly, StrandMaterial
from engine.strands.backward_difference import LARGEST_RATIO, bdf2
from engine.strands.loads import StrandLoads, inertia
from engine.strands.observe import energies
from engine.strands.settings import StrandSettings
from engine.validate.contact_impacts import fate, random_impact
from engine.validate.der_gradients import random_strand
from engine.validate.der_order import bending, twist
from engine.validate.fit import fitted_exponent
from tests.engine.steppers.test_strand_contact import floor, two_that_hit
from tests.engine.steppers.test_strands import hairs

DOWN, ZERO = np.array([0.0, 0.0, -9.81]), np.zeros(3)
BDF2 = StrandSettings(integrator="bdf2")
HAIR = StrandMaterial(density=1300.0, young=3e9, shear=1e9)


@examples(deadline=None)
@given(st.lists(st.floats(0.1, 2.0), min_size=3, max_size=8), st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3))
def test_its_rate_is_exact_for_parabolas(steps, coefficients):
    """And for straight lines in the first step, which has none before it."""
    model, state = hairs(2)
    y = np.polynomial.Polynomial(coefficients)
    vertices, time = len(state.x), 0.0
    for n, h in enumerate(steps):
        earlier, now, end = (np.full(vertices, y(t)) for t in (time - state.last_step[0], time, time + h))
        difference = bdf2(model, state, h, np.zeros(2, np.bool_))
        known = n > 0 and h <= LARGEST_RATIO * state.last_step[0]
        assert known == (difference.lean > 0.0).all()
        wanted = y.deriv()(time + h) if known else (end - now) / h
        np.testing.assert_allclose(difference.rate(end, now, earlier), wanted, atol=1e-9)
        state.last_step[:], time = h, time + h


def test_strands_that_touch_take_implicit_eulers_step():
    model, state = hairs(3)
    state.last_step[:] = 0.1
    difference = bdf2(model, state, 0.1, np.array([False, True, False]))
    first, second = model.start[1:3]
    assert (difference.lean[first:second] == 0.0).all() and (difference.effective[first:second] == 0.1).all()
    np.testing.assert_allclose(difference.lean[:first], 1 / 3)
    np.testing.assert_allclose(difference.effective[second:], 0.2 / 3)


def test_free_fall_keeps_the_error_of_its_first_step():
    """v is exact; x is ahead by g h^2 / 2 after implicit Euler's step, and by (3 - 3^(1-n)) / 2 of that after n steps."""
    model, state = hairs(4, held=False)
    stepper, h, start = StrandStepper(model, DOWN, BDF2), 1e-3, state.x.copy()
    for n in range(1, 8):
        assert stepper.step(state, h).accepted
        np.testing.assert_allclose(state.velocity, np.broadcast_to(n * h * DOWN, start.shape), atol=1e-10)
        ahead = 0.5 * n * n + 0.25 * (3.0 - 3.0 ** (1 - n))
        np.testing.assert_allclose(state.x - start, np.broadcast_to(ahead * h * h * DOWN, start.shape), atol=1e-13)


def test_a_straight_rod_spins_on():
    assembly = StrandAssembly()
    assembly.strand(np.linspace([0.0, 0.0, 0.0], [0.1, 0.0, 0.0], 9), 1e-3, HAIR, normal=np.array([0.0, 0.0, 1.0]))
    model, state = assembly.build()
    state.spin[:-1] = 30.0
    stepper, time = StrandStepper(model, ZERO, BDF2), 0.0
    for h in (1e-3, 1e-3, 5e-4, 1e-3, 2e-3, 2e-3):
        assert stepper.step(state, h).accepted
        time += h
        np.testing.assert_allclose(state.spin[:-1], 30.0, rtol=1e-9)
        turned = np.broadcast_to([0.0, -np.sin(30.0 * time), np.cos(30.0 * time)], (8, 3))
        np.testing.assert_allclose(state.m1[:-1], turned, atol=1e-10)


@pytest.mark.parametrize("make", [bending, twist])
@pytest.mark.parametrize("damping", [0.0, 0.1])
@pytest.mark.parametrize("pattern", [(1.0, 1.0, 0.5, 0.5, 0.5, 0.5, 1.0, 2.0), (2.0, 1.0, 0.5, 0.25, 0.5, 1.0)])
def test_steps_of_many_lengths_keep_the_order(make, damping, pattern):
    mode = make(damping)
    sizes, errors = [], []
    for repeats in (20, 40, 80):
        steps = np.tile(pattern, repeats)
        sizes.append(1 / repeats)
        errors.append(mode.error_after("bdf2", steps * 1.25 * 2 * np.pi / (mode.omega * steps.sum())))
    assert fitted_exponent(sizes, errors) >= 1.8
    assert errors[-1] < 1e-2


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_momentum_is_kept_and_energy_falls_but_for_what_falls_with_the_square_of_the_step(seed):
    """In violent motion energy is never what it was at first, and rises over the least so far by no more than accuracy says."""
    rises, steps = [], (0.025, 0.0125, 0.00625)
    for h in steps:
        model, state = random_strand(seed)
        model = model._replace(damping=0 * model.damping)
        stepper = StrandStepper(model, ZERO, StrandSettings(integrator="bdf2", tolerance=1e-10, contact="none"))
        momentum, energy = model.mass @ state.velocity, [sum(energies(model, state, ZERO).values())]
        for _ in range(round(10.0 / h)):
            assert stepper.step(state, h).accepted
            energy.append(sum(energies(model, state, ZERO).values()))
        np.testing.assert_allclose(model.mass @ state.velocity, momentum, atol=1e-8 * np.abs(momentum).max())
        assert max(energy[1:]) < energy[0]
        rises.append((energy - np.minimum.accumulate(energy)).max())
    assert fitted_exponent(steps, rises) >= 1.8


def test_drag_slows_with_second_order():
    errors, steps = [], (1e-2, 5e-3, 2.5e-3)
    for h in steps:
        model, state = hairs(1, held=False)
        state.velocity[:, 0] = 1.0
        loads, stepper = StrandLoads(drag=model.mass / 0.05), StrandStepper(model, ZERO, BDF2)
        for _ in range(round(0.1 / h)):
            assert stepper.step(state, h, loads).accepted
        errors.append(abs(state.velocity[:, 0].mean() - np.exp(-2.0)))
    assert fitted_exponent(steps, errors) >= 1.8


def test_a_film_sees_the_velocity_along_its_way_with_second_order():
    """D/Dt along the film of v = s sin(t), which is s cos(t) + u sin(t), from the velocities at two times before."""
    errors, steps, pace = [], (0.1, 0.05, 0.025), 1e-3
    for h in steps:
        model, state = hairs(1, curl=0.0, held=False)
        s, end = np.concatenate([[0.0], np.cumsum(model.rest_length[:-1])]), 1.0
        state.velocity[:, 0], state.earlier_velocity[:, 0] = s * np.sin(end - h), s * np.sin(end - 3 * h)
        state.earlier_x, state.last_step[:] = state.x.copy(), 2 * h
        loads = StrandLoads(film_mass=3.0 * model.mass, film_velocity=np.full(len(s), pace))
        difference = bdf2(model, state, h, np.zeros(1, np.bool_))
        total = inertia(model, state, loads, ZERO, difference)
        given_velocity = (total.target - state.x)[:, 0] / difference.effective
        own = difference.base(state.velocity, state.earlier_velocity)[:, 0]
        seen = (4.0 * given_velocity - own) / 3.0
        rate = (s * np.sin(end) - seen) / difference.effective
        errors.append(np.abs(rate - s * np.cos(end) - pace * np.sin(end))[2:].max())
    assert fitted_exponent(steps, errors) >= 1.8


def test_a_rejected_step_changes_nothing_and_history_stays():
    model, state = hairs(2)
    stepper = StrandStepper(model, DOWN, BDF2)
    for _ in range(3):
        assert stepper.step(state, 4e-3).accepted
    before = state.copy()
    hasty = StrandStepper(model, 1e3 * DOWN, StrandSettings(integrator="bdf2", max_newton=1))
    assert not hasty.step(state, 0.1).accepted
    for name, values in vars(before).items():
        np.testing.assert_array_equal(values, getattr(state, name))


@pytest.mark.parametrize("speed", [0.1, 2.0, 20.0])
def test_contact_never_raises_the_energy(speed):
    model, state = two_that_hit(speed, 0.3)
    stepper, start = StrandStepper(model, ZERO, BDF2), sum(energies(model, state, ZERO).values())
    last, contacts, time, h = start, 0, 0.0, 1e-3
    while time < 0.04 / max(speed, 1.0):
        report = stepper.step(state, h)
        if report.accepted:
            time, h = time + h, min(2 * h, 1e-3)
            contacts += report.contacts
            energy = sum(energies(model, state, ZERO).values())
            assert energy <= last + 1e-6 * start
            last = energy
        else:
            h /= 2
    assert contacts > 0 or speed < 1.0


@pytest.mark.parametrize("height", np.linspace(1.2e-4, 1.1e-3, 5))
def test_a_strand_that_hits_the_floor_is_not_thrown_back(height):
    """It falls flat, wherever within a step it arrives: what is lost stays lost."""
    s = np.linspace(0.0, 0.02, 8)
    assembly = StrandAssembly()
    assembly.strand(np.column_stack([s, 0 * s, 0 * s + 2e-3 + height]), 5e-5, HAIR)
    model, state = assembly.build()
    state.velocity[:, 2] = -1.0
    stepper = StrandStepper(model, ZERO, BDF2)
    for _ in range(8):
        assert stepper.step(state, 1e-3, obstacles=floor()).accepted
    assert state.velocity[:, 2].max() < 0.05
    assert (state.last_step == 0.0).all() or state.vertex_contact_force.max() == 0.0


def test_a_strand_that_touches_nothing_does_not_notice_those_that_do():
    model, state = two_that_hit()
    s = np.linspace(-0.02, 0.02, 16)
    assembly = StrandAssembly()
    for points in (state.x[:16], state.x[16:], np.column_stack([s, 20 * s**2 + 0.1, 0 * s])):
        assembly.strand(points, 5e-5, HAIR, friction=0.3)
    alone = StrandAssembly()
    alone.strand(np.column_stack([s, 20 * s**2 + 0.1, 0 * s]), 5e-5, HAIR, friction=0.3)
    ends, pressed = [], 0
    for assembled in (assembly, alone):
        model, state = assembled.build()
        state.velocity[-16:, 2] = 50.0 * s
        if len(state.x) > 16:
            state.velocity[16:32, 2] = -2.0
        stepper = StrandStepper(model, ZERO, BDF2)
        for _ in range(6):
            report = stepper.step(state, 1e-3)
            assert report.accepted
            pressed += report.contacts
        ends.append(state.x[-16:])
    assert pressed > 0
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize("seed", range(8))
def test_impacts_go_through_nothing_and_stay_finite(seed):
    through, _ = fate(random_impact(seed), 1e-3, BDF2)
    assert not through
