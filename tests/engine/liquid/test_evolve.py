"""What a step does to particles: they flow as one point does, swell, tear, move and come back into the period."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.liquid import evolve
from engine.liquid.grid import SIDE, sorted_grid, taken
from engine.liquid.rheology import elastic_trial, flow_step, trial_stress, volume_preserving
from tests.engine.liquid.pools import UNSTRAINED, centres, lattice, liquid, on_faces
from tests.engine.threads import on_one_and_two_threads

H = 1e-3
CREAM = (300.0, 24.0, 8.0, 0.5)  # shear modulus, yield norm, consistency, flow index


def strained(count, seed=0):
    """Velocity gradients, and strains that some of them have led to."""
    rng = np.random.default_rng(seed)
    affine = rng.normal(size=(count, 3, 3)) * np.exp(rng.uniform(-3, 4, count))[:, None, None]
    strain = np.tile(UNSTRAINED, (count, 1))
    for p in range(count):
        strain[p] = elastic_trial(strain[p], 0.1 * affine[p] / np.linalg.norm(affine[p]), 1.0)
    return affine, strain


@pytest.mark.parametrize("implicit", [True, False])
def test_particles_flow_as_one_point_does(implicit):
    affine, strain = strained(60)
    before, history = strain.copy(), np.full(60, 0.25)
    evolve.flow(affine, H, *CREAM, 0.0, implicit, strain, history)
    flowed = np.zeros(60, bool)
    for p in range(60):
        trial = elastic_trial(before[p], affine[p], H)
        after = flow_step(before[p], affine[p], H, *CREAM, implicit)
        _, pull, mu_hat = trial_stress(trial, CREAM[0])
        _, left, _ = trial_stress(after, CREAM[0])
        flowed[p] = CREAM[0] * pull > CREAM[1]
        np.testing.assert_allclose(strain[p], volume_preserving(after) if flowed[p] else trial, atol=1e-13)
        assert history[p] == pytest.approx(0.25 + CREAM[0] * (pull - left) / (2 * mu_hat), abs=1e-12)
    assert 10 < flowed.sum() < 60, "some below yield and some beyond"
    xx, yy, zz, yz, xz, xy = strain.T
    np.testing.assert_allclose(xx * (yy * zz - yz**2) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz), 1.0, atol=1e-12)


def test_plastic_strain_is_forgotten():
    strain, history = np.tile(UNSTRAINED, (3, 1)), np.array([0.0, 1.0, 5.0])
    evolve.flow(np.zeros((3, 3, 3)), 0.5, *CREAM, 2.0, True, strain, history)
    np.testing.assert_allclose(history, np.array([0.0, 1.0, 5.0]) * np.exp(-1.0))
    assert np.array_equal(strain, np.tile(UNSTRAINED, (3, 1)))


def pool():
    x = lattice((0, 0, 0), (0.06, 0.06, 0.06))
    grid, order = sorted_grid(liquid(), x)
    return grid, taken(x, order)


def test_volumes_grow_with_the_divergence_of_wet_cells():
    grid, x = pool()
    rate = 30.0 + 200.0 * centres(grid)[..., 0]
    compression = np.full(len(x), 0.9)
    evolve.swell(grid, x, rate, np.ones_like(rate), H, compression)
    np.testing.assert_allclose(compression, 0.9 * np.exp(H * (30.0 + 200.0 * x[:, 0])), rtol=1e-12)


def test_what_is_not_wet_has_no_say():
    grid, x = pool()
    wet = (centres(grid)[..., 0] < 0.03).astype(float)
    compression = np.ones(len(x))
    evolve.swell(grid, x, 50.0 * wet, wet, H, compression)
    away = x[:, 0] > 0.04
    np.testing.assert_allclose(compression[~away], np.exp(50.0 * H), rtol=1e-12)
    assert (compression[away] == 1.0).all() and away.any()


def test_torn_particles_bear_no_tension():
    compression = np.array([1.2, 1.2, 0.7, 1.2])
    evolve.tear(np.array([0.0, 3.0, 3.0, 2.0]), 2.0, compression)
    assert compression.tolist() == [1.2, 1.0, 0.7, 1.2]


def test_particles_move_and_shift():
    grid, x = pool()
    velocity = np.random.default_rng(0).normal(size=x.shape)
    moved = x.copy()
    evolve.move(moved, velocity, H)
    np.testing.assert_allclose(moved, x + H * velocity, atol=1e-16)
    gradient = np.random.default_rng(1).normal(size=(3, 3))
    shifted = x.copy()
    evolve.shift(grid, shifted, on_faces(grid, lambda at: 1e-3 + at @ gradient.T))
    np.testing.assert_allclose(shifted, x + 1e-3 + x @ gradient.T, atol=1e-15)


@settings(deadline=None, max_examples=60)
@given(st.floats(-10, 10), st.floats(1e-4, 0.3), st.sampled_from([4, 8, 16, 40, 136]), st.integers(0, 2**31))
def test_what_leaves_the_period_comes_back_at_its_other_end(origin, spacing, cells, seed):
    """Whatever round-off does, particles are then in blocks of the period, as the grid wants them."""
    rng, length = np.random.default_rng(seed), spacing * cells
    at = rng.uniform(-2, 3, (60, 3))
    at[::2] = rng.integers(-2, 4, (30, 3))
    x = origin + length * at
    x[::4] = np.nextafter(x[::4], rng.choice([-99.0, 99.0], (15, 3)))
    wrapped = x.copy()
    evolve.wrap(wrapped, np.full(3, origin), np.array([length, length, 0.0]))
    assert np.array_equal(wrapped[:, 2], x[:, 2])
    turns = (x - wrapped)[:, :2] / length
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9 + 1e-14 * abs(origin) / length)
    block = np.floor((wrapped[:, :2] - origin) / (SIDE * spacing))
    assert block.min() >= 0 and block.max() < cells // SIDE


def test_the_same_bits_on_any_number_of_threads():
    grid, x = pool()
    affine, strained_ = strained(len(x), seed=3)
    rate = np.random.default_rng(2).random(grid.cells().shape)

    def evolved():
        strain, history, compression, moved = strained_.copy(), np.zeros(len(x)), np.ones(len(x)), x.copy()
        evolve.flow(affine, H, *CREAM, 1.0, True, strain, history)
        evolve.swell(grid, x, rate, np.ones_like(rate), H, compression)
        evolve.shift(grid, moved, np.random.default_rng(4).random(grid.faces().shape))
        return strain, history, compression, moved

    for one, two in zip(*on_one_and_two_threads(evolved), strict=True):
        assert np.array_equal(one, two)
