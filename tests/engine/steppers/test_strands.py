"""Steps of strands: exact motions, conservation, loads, what is held, hard cases."""

from dataclasses import replace

import numpy as np
import pytest

from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandAssembly, StrandMaterial
from engine.strands.backward_difference import implicit_euler
from engine.strands.loads import StrandLoads, carried_velocity, inertia
from engine.strands.settings import StrandSettings
from engine.validate.der_gradients import Chart, random_strand
from engine.validate.strands import cantilever
from tests.engine.threads import on_one_and_two_threads

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
    stepper = StrandStepper(model, np.zeros(3), StrandSettings(tolerance=1e-10))

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
    def moved():
        model, state = hairs(70)
        stepper = StrandStepper(model, DOWN)
        assert all(stepper.step(state, 4e-3).accepted for _ in range(3))
        return vars(state)

    one, two = on_one_and_two_threads(moved)
    for name, values in one.items():
        np.testing.assert_array_equal(values, two[name])


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
    turned = model.held[:, 3]
    t = np.diff(before.x, axis=0, append=np.zeros((1, 3)))
    m2 = np.cross(t / np.linalg.norm(t, axis=1)[:, None], before.m1)
    np.testing.assert_allclose(state.m1[turned], np.cos(0.3) * before.m1[turned] + np.sin(0.3) * m2[turned], atol=1e-12)


def test_drag_ends_the_fall_at_the_speed_at_which_it_carries_the_weight():
    model, state = hairs(3, held=False)
    drag = 0.3 * model.mass / 1e-2
    stepper = StrandStepper(model, DOWN)
    stream = np.tile([0.2, 0.0, 0.0], (len(state.x), 1))
    for _ in range(400):
        assert stepper.step(state, 1e-2, StrandLoads(drag=drag, stream=stream)).accepted
    np.testing.assert_allclose(state.velocity, np.broadcast_to([0.2, 0.0, -9.81e-2 / 0.3], state.x.shape), atol=1e-6)


@pytest.mark.parametrize("pace", [0.4, -0.3])
def test_a_film_that_runs_along_brings_the_velocity_from_where_it_was(pace):
    model, state = hairs(2)
    rng = np.random.default_rng(0)
    state.velocity = rng.normal(size=state.x.shape)
    film = np.full(len(state.x), pace * model.rest_length[:11].min())
    carried = carried_velocity(model, state.velocity, film, np.ones(2))
    for first, last in zip(model.start[:-1], model.start[1:], strict=True):
        own, length = state.velocity[first:last], model.rest_length[first : last - 1]
        wanted, share = own.copy(), abs(film[first]) / length[:, None]
        if pace > 0:
            wanted[1:] += share * (own[:-1] - own[1:])
        else:
            wanted[:-1] += share * (own[1:] - own[:-1])
        np.testing.assert_allclose(carried[first:last], wanted, atol=1e-12)


def test_a_film_is_heavy_and_pushes_as_eq_13_50_says():
    """m Du/Dt = ... - m_film u_film grad u: a strand that spreads along x, under a film that runs along x, is slowed."""
    model, state = hairs(1, curl=0.0, held=False)
    s = np.concatenate([[0.0], np.cumsum(model.rest_length[:-1])])
    state.velocity[:, 0] = 5.0 * s
    loads = StrandLoads(film_mass=3.0 * model.mass, film_velocity=np.full(len(s), 0.2))
    h = 1e-6
    total = inertia(model, state, loads, DOWN, implicit_euler(model, h))
    np.testing.assert_allclose(total.mass, 4.0 * model.mass)
    np.testing.assert_allclose(total.weight, 4.0 * model.mass * 9.81)
    acceleration = ((total.target - state.x) / h - state.velocity) / h
    np.testing.assert_allclose(acceleration[1:, 0], -3.0 / 4.0 * 0.2 * 5.0, rtol=1e-4)
    np.testing.assert_allclose(acceleration[:, 2], -9.81, rtol=1e-4)


def folded(aside: float):
    """A strand whose second half lies on its first, but for so much of a metre an edge."""
    model, state = hairs(1, curl=0.0, held=False)
    state.x[6:] = 2 * state.x[5] - state.x[6:]
    state.x[6:, 0] += aside * np.arange(1, len(state.x) - 5)
    return model, state


def test_a_folded_strand_unfolds():
    model, state = folded(1e-3)
    stepper = StrandStepper(model, np.zeros(3))
    assert np.linalg.norm(state.x[-1] - state.x[0]) < 0.02
    for _ in range(200):
        report = stepper.step(state, 1e-3)
        assert report.accepted, report.reason
    assert np.linalg.norm(state.x[-1] - state.x[0]) > 0.05


@pytest.mark.parametrize("aside", [0.0, 1e-9, 1e-6])
def test_a_fold_that_is_all_but_exact_breaks_nothing(aside):
    """It holds kilojoules by the law of bending: steps are rejected, or taken, but nothing is lost."""
    model, state = folded(aside)
    stepper, before = StrandStepper(model, np.zeros(3)), state.copy()
    for _ in range(20):
        report = stepper.step(state, 1e-4)
        for name, values in vars(state).items():
            assert np.isfinite(values).all()
            assert report.accepted or np.array_equal(values, getattr(before, name))
        before = state.copy()


@pytest.mark.parametrize("what", ["force", "given"])
def test_what_is_not_a_number_is_rejected(what):
    model, state = hairs(2)
    spoilt, before = np.zeros_like(state.x), state.copy()
    spoilt[0] = np.nan
    kwargs = {"loads": StrandLoads(force=spoilt)} if what == "force" else {"given": (state.x + spoilt, np.zeros(len(spoilt)))}
    assert not StrandStepper(model, DOWN).step(state, 1e-3, **kwargs).accepted
    np.testing.assert_array_equal(state.x, before.x)


def test_coincident_vertices_are_rejected():
    model, state = hairs(2, held=False)
    state.x[4] = state.x[3]
    report = StrandStepper(model, DOWN).step(state, 1e-3)
    assert not report.accepted


def test_a_strand_moves_the_same_whatever_it_is_packed_with():
    def strands(counts):
        assembly = StrandAssembly()
        for n in counts:
            s = np.linspace(0.0, 0.1, n)
            assembly.strand(np.column_stack([0.02 * np.cos(50 * s), 0.02 * np.sin(50 * s), -s]), 1e-4, NYLON)
        model, state = assembly.build()
        state.velocity[:] = np.concatenate([np.linspace(0, 1, n) for n in counts])[:, None] * [1.0, 0.5, 0.0]
        stepper = StrandStepper(model, DOWN, StrandSettings(contact="none"))  # all are in one place
        for _ in range(3):
            assert stepper.step(state, 2e-3).accepted
        return [state.x[a:b] for a, b in zip(model.start[:-1], model.start[1:], strict=True)]

    counts = (2, 80, 3, 14, 40) * 20
    together = strands(counts)
    for n in set(counts):
        alone = strands([n])[0]
        for x in (x for x, count in zip(together, counts, strict=True) if count == n):
            np.testing.assert_array_equal(x, alone)


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
    report = StrandStepper(model, 1e3 * DOWN, StrandSettings(max_newton=1)).step(state, 0.1)
    assert not report.accepted and report.reason == "Newton did not converge"
    for name, values in vars(before).items():
        np.testing.assert_array_equal(values, getattr(state, name))
