"""The impulse of shear stress against virtual work, its derivative, and what the implicit solve keeps."""

import numpy as np
import pytest

from engine.liquid.grid import sorted_grid, taken
from engine.liquid.rheology import flow_step
from engine.liquid.settings import LiquidSettings
from engine.liquid.shear import add_diagonal, add_elastic_impulse, add_tangent_impulse, add_viscous_impulse, shear_solve
from engine.liquid.transfer import to_particles
from engine.liquid.walls import open_space
from tests.engine.liquid.pools import CREAM, SPACING, UNSTRAINED, lattice, liquid, on_grid
from tests.engine.threads import on_one_and_two_threads

H = 1e-3
HONEY = {"consistency": 20.0}
YIELD_NORM = np.sqrt(2 / 3) * CREAM["yield_stress"]
LAW = (CREAM["shear_modulus"], YIELD_NORM, CREAM["consistency"], CREAM["flow_index"])
FULL = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


class Lump:
    """A cube of particles off its lattice."""

    def __init__(self, strain=0.05, seed=0, **changes):
        rng = np.random.default_rng(seed)
        self.model = liquid(**changes)
        x = lattice((0, 0, 0), (0.04, 0.04, 0.04)) + rng.uniform(-0.002, 0.002, (512, 3))
        self.grid, order = sorted_grid(self.model, x)
        self.x, self.volume = taken(x, order), rng.uniform(0.5, 1.5, len(x)) * SPACING**3 / 8
        self.strain = np.tile(UNSTRAINED, (len(x), 1))
        for p in range(len(x)):
            self.strain[p] = flow_step(self.strain[p], strain * rng.normal(size=(3, 3)), 1.0, 1.0, np.inf, 1.0, 1.0, True)
        self.mass, _, _ = on_grid(self.grid, self.x, SPACING**3 / 8, self.model.density)

    def random_velocities(self, seed):
        return np.random.default_rng(seed).normal(size=self.mass.shape) * (self.mass > 0)

    def gradients(self, u):
        velocity, affine = np.empty_like(self.x), np.empty((len(self.x), 3, 3))
        to_particles(self.grid, self.x, u, velocity, affine)
        return affine

    def elastic(self, u, implicit=True):
        force, tangent = self.grid.faces(), np.empty((len(self.x), 8), np.float32)
        add_elastic_impulse(self.grid, self.x, self.volume, self.strain, u, H, *LAW, implicit, force, tangent)
        return force, tangent

    def viscous(self, u):
        force = self.grid.faces()
        add_viscous_impulse(self.grid, self.x, self.volume, u, H, 20.0, force)
        return force

    def product(self, tangent, u):
        force = self.grid.faces()
        add_tangent_impulse(self.grid, self.x, tangent, u, force)
        return force


@pytest.mark.parametrize("implicit", [True, False])
def test_the_elastic_impulse_does_the_work_of_stress(implicit):
    """Its product with any d is -h times the sum of volume, stress after the step, and gradient of d."""
    lump = Lump(**CREAM)
    u, d = 3.0 * lump.random_velocities(1), lump.random_velocities(2)
    force, _ = lump.elastic(u, implicit)
    work = 0.0
    for p, (gradient, along) in enumerate(zip(lump.gradients(u), lump.gradients(d), strict=True)):
        b = np.array(flow_step(lump.strain[p], gradient, H, *LAW, implicit))[FULL]
        work -= H * lump.volume[p] * LAW[0] * np.sum((b - np.trace(b) / 3 * np.eye(3)) * along)
    assert (force * d).sum() == pytest.approx(work, rel=1e-9)


def test_the_viscous_impulse_falls_with_what_is_dissipated():
    lump = Lump(**HONEY)
    u, d = lump.random_velocities(1), lump.random_velocities(2)

    def dissipated(u):
        e = lump.gradients(u)
        e = 0.5 * (e + e.transpose(0, 2, 1))
        e -= np.trace(e, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        return 0.5 * H * 20.0 * lump.volume @ (e**2).sum(axis=(1, 2))

    assert (lump.viscous(u) * d).sum() == pytest.approx(-(dissipated(u + d) - dissipated(u - d)) / 2, rel=1e-9)


def test_the_matrix_is_symmetric_and_positive():
    lump = Lump(**CREAM)
    u, v = lump.random_velocities(1), lump.random_velocities(2)
    _, tangent = lump.elastic(3.0 * lump.random_velocities(3))
    assert (lump.product(tangent, u) * v).sum() == pytest.approx((lump.product(tangent, v) * u).sum(), rel=1e-9)
    assert (lump.product(tangent, u) * u).sum() < 0
    even = lump.product(tangent, np.ones_like(u))
    assert np.abs(even).max() < 1e-9 * np.abs(lump.product(tangent, u)).max(), "what moves evenly is not strained"


def test_the_diagonal_is_that_of_the_matrix():
    lump = Lump(**CREAM)
    tangent = np.zeros((len(lump.x), 8), np.float32)
    tangent[:, 6] = tangent[:, 7] = np.random.default_rng(0).uniform(1, 2, len(lump.x))
    diagonal = lump.grid.faces()
    add_diagonal(lump.grid, lump.x, tangent[:, 6], diagonal)
    for face in np.flatnonzero(lump.mass.reshape(-1))[::97]:
        unit = lump.grid.faces()
        unit.reshape(-1)[face] = 1.0
        assert -lump.product(tangent, unit).reshape(-1)[face] == pytest.approx(diagonal.reshape(-1)[face], rel=1e-9)


def test_the_matrix_is_the_derivative_where_strains_are_small():
    """Below yield and beyond it; what it leaves out is of the order of the elastic strain."""
    errors = []
    for strain in (2e-2, 2e-3):
        lump = Lump(strain=strain, **CREAM)
        scale = strain / 2e-2
        law = (LAW[0] / scale, *LAW[1:])  # the same stress at a tenth of the strain
        u, d = 3.0 * scale * lump.random_velocities(1), scale * lump.random_velocities(2)

        def force(u, lump=lump, law=law):
            found, tangent = lump.grid.faces(), np.empty((len(lump.x), 8), np.float32)
            add_elastic_impulse(lump.grid, lump.x, lump.volume, lump.strain, u, H, *law, True, found, tangent)
            return found, tangent

        slope = (force(u + 1e-4 * d)[0] - force(u - 1e-4 * d)[0]) / 2e-4
        product = lump.product(force(u)[1], d)
        errors.append(np.abs(product - slope).max() / np.abs(slope).max())
    assert errors[0] < 0.3 and errors[1] < errors[0] / 5


@pytest.mark.parametrize("changes", [HONEY, CREAM], ids=["honey", "cream"])
def test_the_solve_keeps_momentum_and_leaves_what_moves_rigidly(changes):
    lump = Lump(**changes)
    lump.strain[:] = UNSTRAINED
    tight = LiquidSettings(shear_tolerance=1e-10, max_newton=60)
    mirror = open_space(lump.grid).mirror
    u = 0.3 * lump.random_velocities(1)
    free = u + np.array([0.0, 0.01, -0.02])[:, None, None] * (lump.mass > 0)
    solved = shear_solve(lump.grid, lump.model, tight, lump.x, lump.volume, lump.strain, mirror, lump.mass, u, free, H)
    assert solved.converged and solved.residual <= 1e-10
    np.testing.assert_allclose((lump.mass * solved.u).sum(axis=(1, 2)), (lump.mass * free).sum(axis=(1, 2)), atol=1e-9)
    assert (lump.mass * solved.u**2).sum() < (lump.mass * free**2).sum()
    falling = np.array([0.3, 0.0, -2.0])[:, None, None] * (lump.mass > 0)
    solved = shear_solve(lump.grid, lump.model, tight, lump.x, lump.volume, lump.strain, mirror, lump.mass,
                         0 * falling, falling, H)
    np.testing.assert_allclose(solved.u, falling, atol=1e-9)


def test_inertia_rules_where_little_diffuses_in_a_step_and_stress_where_much_does():
    """Its share falls from 1 with viscosity h / (density spacing^2), and has none where liquid slips."""
    median = []
    for consistency in (2e-3, 2.0, 2e4):
        lump = Lump(consistency=consistency, no_slip=True)
        u = lump.random_velocities(1)
        mirror = open_space(lump.grid).mirror
        found = shear_solve(lump.grid, lump.model, LiquidSettings(), lump.x, lump.volume, None, mirror, lump.mass, u, u, H)
        assert found.inertia.min() >= 0.0 and found.inertia.max() <= 1.0 and not found.inertia[lump.mass == 0].any()
        median.append(np.median(found.inertia[lump.mass > 0.5 * lump.mass.max()]))
    assert median[0] > 0.999 and 0.95 < median[1] < 0.999 and median[2] < 0.1
    slips = Lump(consistency=2.0)
    found = shear_solve(slips.grid, slips.model, LiquidSettings(), slips.x, slips.volume, None, mirror, slips.mass, u, u, H)
    assert found.inertia is None


def test_the_same_bits_on_any_number_of_threads():
    lump = Lump(**CREAM)
    mirror = open_space(lump.grid).mirror
    u = lump.random_velocities(1)

    def solved():
        found = shear_solve(lump.grid, lump.model, LiquidSettings(), lump.x, lump.volume, lump.strain, mirror, lump.mass,
                            u, u, H)
        return found.u, found.newton, found.linear, found.residual

    one, two = on_one_and_two_threads(solved)
    assert np.array_equal(one[0], two[0]) and one[1:] == two[1:]
