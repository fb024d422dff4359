"""Steps of strands: exact motions, conservation, loads, what is held, hard cases."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandAssembly, StrandMaterial
from engine.strands.loads import StrandLoads, carried_velocity
from engine.validate.der_gradients import Chart, random_strand
from engine.validate.strands import cantilever

NYLON = StrandMaterial(density=1150.0, young=2e9, shear=0.75e9)
DOWN = np.array([0.0, 0.0, -9.81])


def hairs(count: int, vertices: int = 12, curl: float = 0.02, held: bool = True):
    """Curled strands of several lengths that hang from held first edges."""
    assembly = StrandAssembly()
    for k in range(count):
        n = vertices + k % 3
        s = np.linspace(0.0, 0.1, n)
        hold = np.zeros((n, 4), np.bool_)
        hold[:2, :3] = hold[0, 3] = held
        points = np.column_stack([curl * np.cos(80 * s) + 0.01 * k, curl * np.sin(80 * s), -s])
        assembly.strand(points, 1e-4 * np.array([1.0, 0.6]), NYLON, held=hold)
    return assembly.build()


def elastic_energy(model, state) -> float:
    """Of a single strand [J]."""
    chart = Chart(model._replace(mass=0 * model.mass, spin_inertia=0 * model.spin_inertia), state, 1.0)
    return chart.energy(np.zeros(chart.unknowns))


def test_free_strands_fall_as_implicit_euler_says():
    model, state = hairs(4, held=False)
    stepper, h = StrandStepper(model, DOWN), 1e-3
    start = state.x.copy()
    for n in range(1, 6):
        assert stepper.step(state, h).accepted
        np.testing.assert_allclose(state.x - start, np.broadcast_to(0.5 * n * (n + 1) * h * h * DOWN, start.shape), atol=1e-13)


def test_momentum_is_kept_and_energy_never_rises():
    model, state = random_strand(3)
    model = model._replace(damping=0 * model.damping)
    stepper = StrandStepper(model, np.zeros(3), tolerance=1e-10)

    def energy():
        kinetic = np.sum(model.mass[:, None] * state.velocity**2) + np.sum(model.spin_inertia * state.spin**2)
        return 0.5 * kinetic + elastic_energy(model, state)

    momentum, last = model.mass @ state.velocity, energy()
    for _ in range(50):
        assert stepper.step(state, 0.05).accepted
        np.testing.assert_allclose(model.mass @ state.velocity, momentum, atol=1e-9 * np.abs(momentum).max())
        assert energy() <= last * (1 + 1e-9)
        last = energy()


def test_two_threads_give_the_same_bits():
    ends = []
    threads = numba.get_num_threads()
    for count in (1, threads):
        numba.set_num_threads(count)
        model, state = hairs(70)
        stepper = StrandStepper(model, DOWN)
        for _ in range(3):
            assert stepper.step(state, 4e-3).accepted
        ends.append(state)
    numba.set_num_threads(threads)
    assert threads > 1, "numba was started with one thread only"
    for name, values in vars(ends[0]).items():
        np.testing.assert_array_equal(values, getattr(ends[1], name))


def test_what_is_held_stays_and_what_is_given_is_reached():
    model, state = hairs(2)
    stepper, start = StrandStepper(model, DOWN), state.copy()
    for _ in range(5):
        assert stepper.step(state, 4e-3).accepted
    held = model.held[:, :3]
    np.testing.assert_array_equal(state.x[held], start.x[held])
    np.testing.assert_allclose(state.m1[model.held[:, 3]], start.m1[model.held[:, 3]], atol=1e-15)
    x, turn = state.x + np.array([0.0, 1e-3, 0.0]), np.full(len(state.x), 0.3)
    before = state.copy()
    assert stepper.step(state, 4e-3, given=(x, turn)).accepted
    np.testing.assert_array_equal(state.x[held], x[held])
    cosine = np.sum(state.m1 * before.m1, axis=1)[model.held[:, 3]]
    np.testing.assert_allclose(cosine, np.cos(0.3), atol=1e-12)


def test_drag_ends_the_fall_at_the_speed_at_which_it_carries_the_weight():
    model, state = hairs(3, held=False)
    drag = 0.3 * model.mass / 1e-2
    stepper = StrandStepper(model, DOWN)
    stream = np.tile([0.2, 0.0, 0.0], (len(state.x), 1))
    for _ in range(400):
        assert stepper.step(state, 1e-2, StrandLoads(drag=drag, stream=stream)).accepted
    np.testing.assert_allclose(state.velocity, np.broadcast_to([0.2, 0.0, -9.81e-2 / 0.3], state.x.shape), atol=1e-6)


def test_a_film_that_runs_along_brings_the_velocity_from_where_it_was():
    model, state = hairs(2)
    rng = np.random.default_rng(0)
    state.velocity = rng.normal(size=state.x.shape)
    film = np.full(len(state.x), 0.4 * model.rest_length.min())
    carried = carried_velocity(model, state, film, 1.0)
    first = slice(model.start[0], model.start[1])
    share = film[first][1:] / model.rest_length[first][:-1]
    wanted = state.velocity[first].copy()
    wanted[1:] += share[:, None] * (state.velocity[first][:-1] - state.velocity[first][1:])
    np.testing.assert_allclose(carried[first], wanted, atol=1e-12)


def test_a_folded_strand_unfolds():
    model, state = hairs(1, curl=0.0, held=False)
    state.x[6:] = state.x[4:-2][: len(state.x[6:])] * 0 + state.x[5] + (state.x[5] - state.x[6:])
    stepper = StrandStepper(model, np.zeros(3))
    for _ in range(20):
        report = stepper.step(state, 1e-3)
        assert report.accepted, report.reason
        assert all(np.isfinite(values).all() for values in (state.x, state.velocity, state.m1[:-1]))


@pytest.mark.parametrize("rate", [250.0, 1500.0])
def test_a_root_that_whirls_breaks_nothing(rate):
    """The held edge turns about an axis across it, by 0.5 and by 3 radians within 2 ms; steps that fail are halved."""
    model, state = cantilever(16, 0.1, 1e-4, replace(NYLON, damping=1e-3))
    stepper, time, h = StrandStepper(model, DOWN), 0.0, 2e-3
    while time < 0.04:
        x, angle = state.x.copy(), rate * (time + h)
        x[1] = 0.5 * model.rest_length[0] * np.array([np.cos(angle), 0.0, np.sin(angle)])
        x[0] = -x[1]
        if stepper.step(state, h, given=(x, np.zeros(len(x)))).accepted:
            time, h = time + h, min(2 * h, 2e-3)
        else:
            h /= 2
        assert h > 2e-5
    assert np.isfinite(state.x).all()


def test_a_step_that_does_not_converge_leaves_the_state_alone():
    model, state = hairs(2)
    before = state.copy()
    report = StrandStepper(model, 1e3 * DOWN, max_newton=1).step(state, 0.1)
    assert not report.accepted and report.reason == "Newton did not converge"
    for name, values in vars(before).items():
        np.testing.assert_array_equal(values, getattr(state, name))
