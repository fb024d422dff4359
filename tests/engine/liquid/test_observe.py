"""Energies, stresses and pictures of known states."""

import numpy as np
import pytest

from engine.liquid import observe
from engine.liquid.grid import sorted_grid, taken
from tests.engine.liquid.pools import CREAM, SPACING, centres, lattice, liquid, particles

G = (0.0, 0.0, -9.81)
FINE = (SPACING / 2) ** 3


def block(**changes):
    model = liquid(**changes)
    return model, particles(model, lattice((0, 0, 0), (0.04, 0.02, 0.06)))


def test_water_that_flows_evenly():
    model, state = block()
    state.velocity[:] = (3.0, 0.0, 4.0)
    energies = observe.energies(model, state, G)
    mass = 1000.0 * 0.04 * 0.02 * 0.06
    assert energies["kinetic"] == pytest.approx(0.5 * mass * 25.0)
    assert energies["potential"] == pytest.approx(mass * 9.81 * 0.03), "the middle is 3 cm above the origin"


def test_kinetic_energy_is_that_of_the_moments_that_the_grid_gets():
    model, state = block()
    state.affine[:] = np.arange(9.0).reshape(3, 3)
    assert observe.energies(model, state, G)["kinetic"] == pytest.approx(
        0.5 * 1000.0 * state.volume.sum() * 204.0 * SPACING**2 / 4)


def test_a_sheared_cream_holds_half_mu_times_strain_squared():
    model, state = block(**CREAM)
    strain = 0.05
    state.strain[:] = [1.0 + strain**2, 1.0, 1.0, 0.0, 0.0, strain]
    assert observe.energies(model, state, np.zeros(3))["potential"] == pytest.approx(
        0.5 * 300.0 * strain**2 * state.volume.sum(), rel=1e-9)
    np.testing.assert_allclose(observe.shear_stress(model, state), 300.0 * strain, rtol=1e-3)


@pytest.mark.parametrize("j", [0.8, 1.0, 1.3])
def test_compression_has_the_energy_of_its_pressure(j):
    model, state = block(**CREAM)
    held = []
    for change in (-1e-5, 1e-5):
        state.compression[:] = j + change
        held.append(observe.energies(model, state, np.zeros(3))["potential"])
    pressure = -0.5 * 1e5 * (j - 1.0 / j)
    assert (held[1] - held[0]) / 2e-5 == pytest.approx(-pressure * state.volume.sum(), abs=1e-4 * state.volume.sum() * 1e5)
    np.testing.assert_allclose(observe.present_volume(state), (j + 1e-5) * FINE)


def test_a_newtonian_liquid_shows_viscosity_times_rate():
    model, state = block(consistency=8.0)
    state.affine[:] = np.outer([1.0, 0, 0], [0, 25.0, 0]) + 7.0 * np.eye(3)
    state.affine += np.array([[0, 0, 3.0], [0, 0, 0], [-3.0, 0, 0]])  # neither swelling nor turning counts
    np.testing.assert_allclose(observe.shear_stress(model, state), 4.0 * 25.0)


def test_a_frame_says_what_yields_and_how_large_particles_are():
    model, state = block(**CREAM)
    at_yield = 30.0 / np.sqrt(3.0) / 300.0
    state.strain[:, 5] = np.where(np.arange(len(state.x)) % 2, 1.01, 0.99) * at_yield
    state.compression[:] = 1.1
    frame = observe.frame_arrays(model, state, np.full(len(state.x), 5.0, np.float32))
    assert np.array_equal(frame["yielded"], np.arange(len(state.x)) % 2 == 1)
    np.testing.assert_allclose(4 / 3 * np.pi * frame["radius"].astype(float) ** 3, 1.1 * FINE, rtol=1e-6)
    assert frame["positions"].dtype == frame["speed"].dtype == frame["shear"].dtype == np.float32
    assert (frame["pressure"] == 5.0).all() and len(frame["surface_vertices"]) == 0
    water, still = block()
    assert observe.frame_arrays(water, still, np.zeros(len(still.x), np.float32))["yielded"].all()


def test_particles_show_the_number_of_their_cell():
    rng = np.random.default_rng(0)
    x = rng.uniform(-0.05, 0.05, (200, 3))
    grid, order = sorted_grid(liquid(), x)
    x = taken(x, order)
    row = np.full(grid.cells().shape, -1, np.int32)
    some = rng.random(row.shape) < 0.7
    row[some] = rng.permutation(some.sum())
    values, shown = rng.random(some.sum()), np.empty(len(x), np.float32)
    observe.of_cells(grid, x, row, values, shown)
    middle = centres(grid).reshape(-1, 3)
    for p in range(len(x)):
        n = row.reshape(-1)[np.abs(middle - x[p]).max(axis=1).argmin()]
        assert shown[p] == np.float32(values[n] if n >= 0 else 0.0)
