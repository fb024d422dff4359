"""Steps of liquid: what falls and turns freely, waves of shear against closed forms, and steps that are refused."""

import numpy as np
import pytest

from engine.liquid.settings import LiquidSettings
from engine.steppers.liquid import LiquidStepper
from tests.engine.liquid.pools import CREAM, FOAM, SPACING, lattice, liquid, particles, planes, tank
from tests.engine.threads import on_one_and_two_threads

KINDS = {"water": {}, "honey": {"consistency": 20.0}, "foam": FOAM, "cream": CREAM}
kinds = pytest.mark.parametrize("kind", KINDS)
TURNING = np.array([[0.0, -4.0, -2.0], [4.0, 0.0, -3.0], [2.0, 3.0, 0.0]])


def ball(radius=0.03):
    x = lattice((-0.04,) * 3, (0.04,) * 3)
    return x[np.linalg.norm(x, axis=1) < radius]


def advance(model, state, h, steps, gravity=(0.0, 0.0, 0.0), solids=None, **settings):
    stepper = LiquidStepper(model, np.array(gravity), LiquidSettings(**settings))
    for _ in range(steps):
        report = stepper.step(state, h, solids, solids)
        assert report.accepted, report.reason
    return stepper, report


def arrays(state):
    return {name: values for name, values in vars(state).items() if values is not None}


@kinds
def test_free_fall_is_exact(kind):
    """To what the tolerance of the shear solve leaves."""
    model = liquid(**KINDS[kind])
    state = particles(model, ball(), velocity=(0.3, 0.1, 0.2))
    gravity, middle = np.array([0.0, 1.0, -9.81]), state.x.mean(axis=0)
    advance(model, state, 1e-3, 3, gravity, shear_tolerance=1e-8)
    np.testing.assert_allclose(state.velocity, np.broadcast_to((0.3, 0.1, 0.2) + 3e-3 * gravity, state.x.shape), atol=1e-8)
    # of implicit steps: h^2 g (1 + 2 + 3)
    np.testing.assert_allclose(state.x.mean(axis=0) - middle, 3e-3 * np.array([0.3, 0.1, 0.2]) + 6e-6 * gravity, atol=1e-8)


def angular_momentum(model, state):
    spin = SPACING**2 / 4 * (state.affine.transpose(0, 2, 1) - state.affine)
    own = np.stack([spin[:, 1, 2], spin[:, 2, 0], spin[:, 0, 1]], axis=1)
    return model.density * state.volume @ (np.cross(state.x, state.velocity) + own)


@kinds
def test_a_ball_that_turns_goes_on_turning(kind):
    model = liquid(**KINDS[kind])
    state = particles(model, ball())
    state.velocity[:], state.affine[:] = state.x @ TURNING.T, TURNING
    before = angular_momentum(model, state)
    advance(model, state, 2e-3, 5)
    after, size = angular_momentum(model, state), np.linalg.norm(before)
    assert np.abs(after - before).max() < 1e-3 * size
    assert np.abs(model.density * state.volume @ state.velocity).max() < 1e-9 * size / 0.03


def wave(cells, height=0.08, **changes):
    """Particles in a column that repeats itself, and the wave of shear that fits in it once."""
    spacing = height / cells
    model = liquid(spacing=spacing, period=(4, 4, cells), **changes)
    state = particles(model, lattice((0, 0, 0), (4 * spacing, 4 * spacing, height), spacing / 2), (spacing / 2) ** 3)
    k = 2 * np.pi / height
    shape = np.sin(k * state.x[:, 2])
    state.velocity[:, 0], state.affine[:, 0, 2] = 1e-2 * shape, 1e-2 * k * np.cos(k * state.x[:, 2])
    return model, state, k


def share(state, k):
    """How much of the wave there is."""
    return 2e2 * np.mean(state.velocity[:, 0] * np.sin(k * state.x[:, 2]))


def test_a_shear_wave_of_a_newtonian_liquid_decays():
    """As exp(-nu k^2 t); the error falls as the square of the spacing, steps being fine."""
    errors = []
    for cells in (8, 16):
        model, state, k = wave(cells, consistency=20.0)
        nu, steps = 10.0 / 1000.0, 12
        time = 0.5 / (nu * k**2)
        decay = (1.0 + nu * k**2 * time / steps) ** -steps  # of backward Euler, to see the error in space
        advance(model, state, time / steps, steps, shear_tolerance=1e-7)
        errors.append(abs(share(state, k) / decay - 1.0))
    assert errors[0] < 0.12 and errors[1] < errors[0] / 2.8


def test_a_shear_wave_of_an_elastic_liquid_swings():
    """Its velocity vanishes after a quarter of 2 pi / (k sqrt(mu / rho))."""
    model, state, k = wave(16, **FOAM | {"yield_stress": 1e6})
    omega = k * np.sqrt(model.shear_modulus / model.density)
    shares, h = [1.0], 0.5 * np.pi / omega / 40
    while shares[-1] > 0.0 and len(shares) < 80:
        advance(model, state, h, 1, shear_tolerance=1e-5)
        shares.append(share(state, k))
    quarter = h * (len(shares) - 2 + shares[-2] / (shares[-2] - shares[-1]))
    assert quarter * omega == pytest.approx(0.5 * np.pi, rel=0.03)


def test_a_film_that_runs_down_a_wall_has_its_profile():
    """Steady: u = rho g (H z - z^2 / 2) / viscosity, of a Newtonian liquid of 1 Pa s."""
    height, push, spacing = 0.01, 4.9, 0.01 / 8
    model = liquid(spacing=spacing, consistency=2.0, no_slip=True, period=(4, 4, 0))
    x = lattice((0, 0, 0), (4 * spacing, 4 * spacing, height), spacing / 2)
    state = particles(model, x, (spacing / 2) ** 3)
    advance(model, state, 4e-3, 75, (push, 0.0, -8.5), planes(((0, 0, 0), (0, 0, 1))), shear_tolerance=1e-4)
    z = state.x[:, 2]
    exact = 1000.0 * push * (height * z - z**2 / 2)
    assert np.abs(state.velocity[:, 0] - exact).max() < 0.01 * exact.max()


def test_a_block_below_yield_comes_to_rest_and_does_not_creep():
    """8 cm of cream on a slope that its yield stress can hold, and after that no plastic strain."""
    model = liquid(**FOAM | {"no_slip": True, "period": (4, 4, 0)})
    state = particles(model, lattice((0, 0, 0), (0.04, 0.04, 0.08)))
    floor = planes(((0, 0, 0), (0, 0, 1)))
    advance(model, state, 8e-3, 120, (1.0, 0.0, -9.0), floor)
    place = state.x[:, 0].mean()
    advance(model, state, 8e-3, 20, (1.0, 0.0, -9.0), floor)
    assert not state.plastic_strain.any() and abs(state.x[:, 0].mean() - place) < 2e-5
    np.testing.assert_allclose(300.0 * state.strain[:, 4], 80.0 * (0.08 - state.x[:, 2]), atol=0.1 * 80.0 * 0.08)


def test_liquid_stands_on_a_floor_in_the_midst_of_cells():
    model = liquid(period=(4, 4, 0))
    state = particles(model, lattice((0, 0, 0.005), (0.04, 0.04, 0.085)))
    advance(model, state, 4e-3, 60, (0.0, 0.0, -9.81), planes(((0, 0, 0.005), (0, 0, 1))))
    assert state.x[:, 2].mean() == pytest.approx(0.045, abs=0.05 * SPACING)


def test_liquid_stands_on_a_floor_between_cells():
    model = liquid(period=(4, 4, 0))
    state = particles(model, lattice((0, 0, 0), (0.04, 0.04, 0.085)))
    advance(model, state, 4e-3, 60, (0.0, 0.0, -9.81), planes(((0, 0, 0), (0, 0, 1))))
    assert state.x[:, 2].mean() == pytest.approx(0.0425, abs=0.05 * SPACING)
    assert np.abs(state.velocity).max() < 1e-3 * np.sqrt(9.81 * 0.085)


def test_a_drop_is_held_together_by_its_surface():
    model = liquid(surface_tension=0.07)
    x = lattice((-0.08,) * 3, (0.08,) * 3)
    state = particles(model, x[np.linalg.norm(x, axis=1) < 0.07])
    stepper, _ = advance(model, state, 1e-4, 1, pressure_tolerance=1e-8)
    radius = np.cbrt(0.75 / np.pi * state.volume.sum())
    deep = np.linalg.norm(state.x, axis=1) < 0.05
    np.testing.assert_allclose(stepper.particle_pressure[deep].mean(), 2 * 0.07 / radius, rtol=0.08)


def test_air_presses_on_what_compresses_no_more_than_once():
    """The pressure of a compressible drop comes about by compression: at rest, none is there at first."""
    model = liquid(surface_tension=0.07, bulk_modulus=1e4)
    state = particles(model, ball(0.035))
    advance(model, state, 1e-3, 40, pressure_tolerance=1e-8)
    assert state.compression[np.linalg.norm(state.x, axis=1) < 0.02].mean() < 1.0 - 0.5 * 2 * 0.07 / 0.035 / 1e4


def test_foam_under_a_plate_keeps_its_volume():
    """A plate presses a slab to two thirds of its height, and comes back: particles stay spread as far as they are compressed."""
    model, h = liquid(**CREAM | {"no_slip": True}), 4e-3
    state = particles(model, lattice((-0.04, -0.04, 0), (0.04, 0.04, 0.03)))
    stepper, height, drift = LiquidStepper(model, np.array((0.0, 0.0, -9.81))), 0.03, []
    at_rest = state.volume.sum()

    def between(top):
        return planes(((0, 0, 0), (0, 0, 1)), ((0, 0, top), (0, 0, -1)))

    for n in range(100):
        before, height = height, height + (-2e-4 if n < 50 else 1e-4)
        assert stepper.step(state, h, between(before), between(height)).accepted
        solids = between(height)
        drift.append(stepper.volume(state, solids, solids) / (at_rest * state.compression.mean()) - 1.0)
    assert np.abs(drift).max() < 0.03 and abs(drift[-1]) < 0.01


@kinds
def test_a_step_that_is_too_large_leaves_all_as_it_was(kind):
    model = liquid(**KINDS[kind])
    state = particles(model, np.random.default_rng(0).permutation(ball()), velocity=(0.0, 0.0, 1.0))
    before = {name: values.copy() for name, values in arrays(state).items()}
    stepper = LiquidStepper(model, np.array([0.0, 0.0, 1e4]))
    for h, velocity in ((0.02, 1.0), (2e-3, 1.0)):  # too fast before the step, and after it
        report = stepper.step(state, h)
        assert not report.accepted and "Courant number" in report.reason, velocity
        order = np.lexsort(state.x.T), np.lexsort(before["x"].T)
        for name in ("x", "velocity", "affine", "volume", "strain", "compression", "plastic_strain"):
            if name in before:
                assert np.array_equal(getattr(state, name)[order[0]], before[name][order[1]]), name


def test_a_step_of_nothing():
    model = liquid(**CREAM)
    state = particles(model, np.zeros((0, 3)))
    stepper, report = advance(model, state, 1e-3, 2)
    assert report.accepted and len(stepper.order) == len(stepper.particle_pressure) == len(state.x) == 0


def test_order_says_who_was_who():
    model = liquid()
    state = particles(model, np.random.default_rng(0).permutation(ball()))
    state.volume[:] = np.linspace(1.0, 1.1, len(state.x)) * SPACING**3 / 8
    before = state.volume.copy()
    stepper, _ = advance(model, state, 1e-3, 1)
    assert np.array_equal(state.volume, before[stepper.order])


def test_measuring_the_volume_changes_nothing():
    model = liquid()
    state = particles(model, np.random.default_rng(0).permutation(lattice((0, 0, 0), (0.04, 0.04, 0.06))))
    before = {name: values.copy() for name, values in arrays(state).items()}
    sides = tank((0, 0, 0), (0.04, 0.04, 1.0))
    assert LiquidStepper(model, np.zeros(3)).volume(state, sides, sides) == pytest.approx(0.04 * 0.04 * 0.06, rel=1e-9)
    assert all(np.array_equal(values, before[name]) for name, values in arrays(state).items())


@pytest.mark.parametrize("kind", ["water", "cream"])
def test_the_same_bits_on_any_number_of_threads(kind):
    def stepped():
        model = liquid(**KINDS[kind] | {"no_slip": kind == "cream"})
        state = particles(model, lattice((0, 0, 0), (0.1, 0.06, 0.08)))
        stepper, _ = advance(model, state, 1e-3, 3, (0.0, 0.0, -9.81), tank((0, 0, 0), (0.2, 0.06, 1.0)))
        return [*arrays(state).values(), stepper.particle_pressure]

    for one, two in zip(*on_one_and_two_threads(stepped), strict=True):
        assert np.array_equal(one, two)
