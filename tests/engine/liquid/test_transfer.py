"""Transfers against sums over all faces; what they keep, what they reproduce, and the same bits on any number of threads."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.liquid.grid import sorted_grid, taken
from engine.liquid.transfer import FIELD, TILE, add, load, to_grid, to_particles
from tests.engine.liquid.pools import SPACING, centres, face_centres, liquid, on_faces
from tests.engine.threads import on_one_and_two_threads

ORIGIN = np.array([-0.013, 0.002, 0.5])
DENSITY = 900.0
NO_STRESS = np.zeros((0, 6))
PERIODS = st.sampled_from([(0, 0, 0), (8, 0, 0), (4, 0, 8), (4, 4, 4)])


class Cloud:
    """Particles with random places, velocities and affine moments, sorted on their grid."""

    def __init__(self, seed, count, period=(0, 0, 0)):
        rng = np.random.default_rng(seed)
        self.model = liquid(origin=ORIGIN, period=period)
        x = ORIGIN + SPACING * rng.uniform(-9.0, 9.0, (count, 3)) * (self.model.period == 0)
        x += SPACING * rng.random((count, 3)) * self.model.period
        self.grid, order = sorted_grid(self.model, x)
        self.x = taken(x, order)
        self.volume = SPACING**3 * rng.uniform(0.05, 0.3, count)
        self.velocity, self.affine = rng.normal(size=(count, 3)), rng.normal(size=(count, 3, 3)) / SPACING

    @property
    def mass(self):
        return DENSITY * self.volume

    @property
    def moment(self):
        return self.mass[:, None, None] * self.affine

    def on_grid(self, h=0.0, consistency=0.0, stress=NO_STRESS):
        mass, momentum, filled = self.grid.faces(), self.grid.faces(), self.grid.cells()
        to_grid(self.grid, self.x, self.velocity, self.affine, self.volume, DENSITY, h, consistency, stress,
                mass, momentum, filled)
        return mass, momentum, filled

    def weights(self, nodes):
        """Splines of all particles at nodes [..., 3], and how far each node is from each [m], [..., P] and [..., P, 3]."""
        apart = nodes[..., None, :] - self.x
        length = SPACING * self.model.period
        apart -= length * np.round(apart / np.where(length > 0, length, 1.0))
        d = np.abs(apart) / SPACING
        spline = np.where(d < 0.5, 0.75 - d**2, np.where(d < 1.5, 0.5 * (1.5 - d) ** 2, 0.0))
        return spline.prod(axis=-1), apart


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max(initial=1e-300))


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**31), st.integers(1, 12), st.sampled_from([(0, 0, 0), (8, 0, 0), (16, 8, 8)]))
def test_particles_to_grid(seed, count, period):
    cloud = Cloud(seed, count, period)
    mass, momentum, filled = cloud.on_grid()
    for a in range(3):
        weight, apart = cloud.weights(face_centres(cloud.grid, a))
        close(mass[a], weight @ cloud.mass)
        affine = np.einsum("bcp,bcpk,pk->bc", weight, apart, cloud.moment[:, a])
        close(momentum[a], weight @ (cloud.mass * cloud.velocity[:, a]) + affine)
    close(filled, cloud.weights(centres(cloud.grid))[0] @ cloud.volume / SPACING**3)


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**31), st.integers(1, 12), st.sampled_from([(0, 0, 0), (8, 0, 0), (16, 8, 8)]))
def test_grid_to_particles(seed, count, period):
    cloud = Cloud(seed, count, period)
    u = np.random.default_rng(seed).normal(size=cloud.grid.faces().shape)
    velocity, affine = np.empty((count, 3)), np.empty((count, 3, 3))
    to_particles(cloud.grid, cloud.x, u, velocity, affine)
    for a in range(3):
        weight, apart = cloud.weights(face_centres(cloud.grid, a))
        close(velocity[:, a], np.einsum("bcp,bc->p", weight, u[a]))
        close(affine[:, a], 4.0 / SPACING**2 * np.einsum("bcp,bcpk,bc->pk", weight, apart, u[a]))


def angular(place, momentum):
    return np.cross(place, momentum).reshape(-1, 3).sum(axis=0)


def spin(matrix):
    """Angular momentum of moments [P, 3, 3] times D = spacing^2 / 4, in which rows are components of momentum."""
    turning = (matrix.transpose(0, 2, 1) - matrix).sum(axis=0) * SPACING**2 / 4
    return np.array([turning[1, 2], turning[2, 0], turning[0, 1]])


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**31), st.integers(1, 60), PERIODS)
def test_mass_and_momentum_are_kept_both_ways(seed, count, period):
    cloud = Cloud(seed, count, period)
    mass, momentum, filled = cloud.on_grid()
    size = cloud.mass @ np.abs(cloud.velocity).max(axis=1) + SPACING * np.abs(cloud.moment).sum()
    for a in range(3):
        assert mass[a].sum() == pytest.approx(cloud.mass.sum(), rel=1e-12)
        assert momentum[a].sum() == pytest.approx(cloud.mass @ cloud.velocity[:, a], abs=1e-12 * size)
    assert filled.sum() == pytest.approx(cloud.volume.sum() / SPACING**3, rel=1e-12)
    u = np.divide(momentum, mass, out=np.zeros_like(mass), where=mass > 0)
    velocity, affine = np.empty_like(cloud.velocity), np.empty_like(cloud.affine)
    to_particles(cloud.grid, cloud.x, u, velocity, affine)
    assert np.abs(cloud.mass @ velocity - momentum.sum(axis=(1, 2))).max() <= 1e-12 * size
    if not any(period):  # where space repeats there is no angular momentum
        of_grid = sum(angular(face_centres(cloud.grid, a), momentum[a][..., None] * np.eye(3)[a]) for a in range(3))
        before = angular(cloud.x, cloud.mass[:, None] * cloud.velocity) + spin(cloud.moment)
        after = angular(cloud.x, cloud.mass[:, None] * velocity) + spin(cloud.mass[:, None, None] * affine)
        assert max(np.abs(of_grid - before).max(), np.abs(of_grid - after).max()) <= 1e-12 * size


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**31), st.integers(1, 60))
def test_affine_fields_come_back_exactly(seed, count):
    cloud = Cloud(seed, count)
    rng = np.random.default_rng(seed)
    gradient, still = rng.normal(size=(3, 3)), rng.normal(size=3)

    def field(x):
        return still + (x - ORIGIN) @ gradient.T

    u = on_faces(cloud.grid, field)
    velocity, affine = np.empty((count, 3)), np.empty((count, 3, 3))
    to_particles(cloud.grid, cloud.x, u, velocity, affine)
    close(velocity, field(cloud.x))
    np.testing.assert_allclose(affine, np.broadcast_to(gradient, affine.shape), atol=1e-11)
    cloud.velocity, cloud.affine = velocity, affine
    mass, momentum, _ = cloud.on_grid()
    close(momentum, mass * u)


@pytest.mark.parametrize("newtonian", [False, True])
def test_stress_gives_its_impulse(newtonian):
    """By a slope of splines of 4 / spacing^2 times spline and distance, that of the affine transfer."""
    cloud, h = Cloud(5, 12), 0.01
    if newtonian:
        rate = 0.5 * (cloud.affine + cloud.affine.transpose(0, 2, 1))
        full = 7.0 * (rate - np.trace(rate, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3))
        stressed = cloud.on_grid(h, consistency=7.0)
    else:
        s = np.random.default_rng(1).normal(size=(12, 6))
        full = s[:, np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])]
        stressed = cloud.on_grid(h, stress=s)
    plain = cloud.on_grid()
    assert np.array_equal(stressed[0], plain[0]) and np.array_equal(stressed[2], plain[2])
    for a in range(3):
        weight, apart = cloud.weights(face_centres(cloud.grid, a))
        impulse = -h * 4.0 / SPACING**2 * np.einsum("bcp,bcpk,pk,p->bc", weight, apart, full[:, a], cloud.volume)
        np.testing.assert_allclose(stressed[1][a] - plain[1][a], impulse, atol=1e-12 * np.abs(stressed[1]).max())


def test_tiles_are_copies_and_add_up():
    cloud = Cloud(3, 40)
    grid = cloud.grid
    field, tile = np.random.default_rng(0).random(grid.cells().shape), np.empty(FIELD)
    value = {tuple(cell): v for cell, v in zip(np.round((centres(grid) - ORIGIN) / SPACING - 0.5).astype(int).reshape(-1, 3)
                                               .tolist(), field.reshape(-1), strict=True)}
    for b in grid.turn:
        load(grid.near[b], field, tile)
        expected = [value[tuple((4 * grid.place[b] + np.array(at) - 1).tolist())] for at in np.ndindex(TILE, TILE, TILE)]
        assert np.array_equal(tile, expected)
        added = grid.cells()
        add(grid.near[b], tile, added)
        assert np.array_equal(added[added != 0], field[added != 0]) and (added != 0).sum() == FIELD


def test_a_particle_at_any_edge_of_its_block_stays_on_its_tile():
    """By round-off a place may lie a little before the block that it is in, or at its very end."""
    for origin in (0.0, 0.1, -0.3, 1.7):
        model = liquid(origin=np.full(3, origin), spacing=0.007)
        edge = origin + 0.028 * np.arange(-40.0, 40.0)
        x = np.repeat(np.concatenate([edge, np.nextafter(edge, 9), np.nextafter(edge, -9)])[:, None], 3, axis=1)
        grid, order = sorted_grid(model, x)
        x, ones = taken(x, order), np.ones(len(x))
        mass, momentum, filled = grid.faces(), grid.faces(), grid.cells()
        to_grid(grid, x, np.zeros((len(x), 3)), np.zeros((len(x), 3, 3)), ones, 1.0, 0.0, 0.0, NO_STRESS, mass, momentum, filled)
        assert mass.sum() == pytest.approx(3 * len(x), rel=1e-12) and mass.min() >= 0.0
        middle = np.array([(mass[a][..., None] * face_centres(grid, a)).sum(axis=(0, 1)) for a in range(3)])
        np.testing.assert_allclose(middle, np.broadcast_to(x.sum(axis=0), (3, 3)), atol=1e-9)


def test_the_same_bits_on_any_number_of_threads():
    cloud = Cloud(8, 4000)

    def there_and_back():
        mass, momentum, filled = cloud.on_grid()
        velocity, affine = np.empty_like(cloud.velocity), np.empty_like(cloud.affine)
        to_particles(cloud.grid, cloud.x, momentum, velocity, affine)
        return mass, momentum, filled, velocity, affine

    for one, two in zip(*on_one_and_two_threads(there_and_back), strict=True):
        assert np.array_equal(one, two)
