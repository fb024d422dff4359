"""Pressure of what is at rest, pushed, or drawn together by its surface; and no divergence after it has acted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.liquid.grid import CELLS, sorted_grid, taken
from engine.liquid.pressure import accelerate, air_pressure, divergence, pressure, spread_outwards, wet_cells
from engine.liquid.surface import depths, seen
from engine.liquid.walls import open_space, walls
from tests.engine.liquid.pools import SPACING, centres, lattice, liquid, on_grid, planes
from tests.engine.threads import on_one_and_two_threads

H, DENSITY, G = 2e-3, 1000.0, 9.81
FACTOR = H / DENSITY
seen_all = np.vectorize(seen, otypes=[float])


class Basin:
    """Cells filled up to a plane or a ball, exactly as splines see them, on the grid of a column of particles."""

    def __init__(self, depth, solids=None, begin=None, compliance=0.0, period=(4, 8, 0), low=(0, 0, 0), high=(0.04, 0.08, 0.16)):
        model = liquid(period=period)
        x = lattice(low, high)
        self.grid, order = sorted_grid(model, x)
        self.mass, _, _ = on_grid(self.grid, taken(x, order), SPACING**3 / 8)
        self.walls = open_space(self.grid) if solids is None else walls(self.grid, begin or solids, solids, H, False, self.mass)
        filled, self.depth = seen_all(depth(centres(self.grid)) / SPACING), self.grid.cells()
        depths(filled, self.depth)
        whole = self.grid.faces()
        self.compliance = np.broadcast_to(compliance, filled.shape)
        self.wet = wet_cells(self.grid, filled, self.depth, self.walls.open, whole + FACTOR / SPACING**2, self.compliance,
                             model.period)
        self.middle = centres(self.grid).reshape(-1, 3)[self.wet.cell]

    def divergence(self, u):
        found = np.empty(len(self.wet.cell))
        divergence(self.grid, u, self.walls.open, self.walls.speed, self.wet.cell, found)
        return found

    def settle(self, u, load=0.0, air=None):
        """Pressure, and which faces it acted on."""
        p, how = pressure(self.wet, load - self.divergence(u), 1e-12, 300)
        assert how.residual <= 1e-12
        air = np.zeros(len(p)) if air is None else air
        return p, accelerate(self.grid, self.wet.row, p, air, self.depth, self.walls.open,
                             self.grid.faces() + FACTOR, u)


def column(surface, floor, speed=0.0, **rest):
    solids = planes(((0, 0, floor), (0, 0, 1)))
    begin = solids._replace(centre=solids.centre - (0, 0, H * speed))
    return Basin(lambda x: surface - x[..., 2], solids, begin, **rest)


heights = st.floats(0.1, 0.12).filter(lambda z: abs((z / SPACING + 0.5) % 1.0 - 1.0) > 0.03 and (z / SPACING + 0.5) % 1.0 > 0.03)


@settings(deadline=None, max_examples=12)
@given(heights, st.floats(0.0, 0.02), st.sampled_from([0.0, -0.3, 0.5]))
def test_the_pressure_of_a_column_is_linear_whatever_its_height(surface, floor, speed):
    """On a floor that rests, or is a piston that starts to move: then weight is that of the acceleration as well."""
    basin = column(surface, floor, speed)
    u = basin.grid.faces()
    u[2] = -H * G
    p, solved = basin.settle(u)
    weight = DENSITY * (G + speed / H)
    np.testing.assert_allclose(p, weight * (surface - basin.middle[:, 2]), atol=1e-8 * abs(weight) * surface)
    assert np.abs(u[2][solved[2]] - speed).max() < 1e-9 and np.abs(u[:2]).max() < 1e-9


@settings(deadline=None, max_examples=8)
@given(st.integers(0, 2**31))
def test_nothing_diverges_once_pressure_has_acted(seed):
    rng = np.random.default_rng(seed)
    n = np.append(rng.uniform(-0.4, 0.4, 2), 1.0)
    basin = Basin(lambda x: 0.11 - x[..., 2] + 0.02 * np.sin(40 * x[..., 0]), planes(((0.02, 0.04, 0.03), n)),
                  period=(0, 0, 0), low=(-0.04, -0.04, 0), high=(0.08, 0.12, 0.16))
    u = rng.normal(size=basin.grid.faces().shape)
    before = np.abs(basin.divergence(u)).max()
    basin.settle(u)
    assert np.abs(basin.divergence(u)).max() < 1e-9 * before


def test_a_sealed_compressed_liquid_has_the_pressure_of_its_volume():
    low, high = (0, 0, 0.02), (0.04, 0.08, 0.12)
    solids = planes((low, (0, 0, 1)), (high, (0, 0, -1)))
    compliance = 1.0 / (H * 1e6)
    basin = Basin(lambda x: np.full(x.shape[:-1], 0.05), solids, compliance=compliance)
    u = basin.grid.faces()
    p, _ = basin.settle(u, load=compliance * 500.0)
    within = (basin.middle[:, 2] > 0.02) & (basin.middle[:, 2] < 0.12)
    np.testing.assert_allclose(p[within], 500.0, rtol=1e-9)
    assert np.abs(u).max() < 1e-12


def test_a_compressible_column_gives_way_as_a_spring_does():
    """One step from rest: p'' = (p - p0) compliance / conductance in the bulk, so its cosh from the floor on."""
    stiffness = 40.0  # K: waves go a few cells in the step
    basin = column(0.12, 0.0, compliance=1.0 / (H * stiffness))
    u = basin.grid.faces()
    u[2] = -H * G
    p, _ = basin.settle(u)
    length = H * np.sqrt(stiffness / DENSITY) / SPACING
    rate = 2.0 * np.arcsinh(0.5 / length)  # of the grid's own cosh
    z, top = basin.middle[:, 2] / SPACING, 12.0
    # u on the floor is zero: dp/dz = -rho g there; p = 0 at the top
    slope = -DENSITY * G * SPACING / (2.0 * np.sinh(0.5 * rate))
    exact = slope * (np.sinh(rate * z) - np.tanh(rate * top) * np.cosh(rate * z))
    np.testing.assert_allclose(p, exact, atol=2e-2 * exact.max())


@pytest.mark.parametrize("radius", [4.3, 6.7])
def test_a_drop_is_under_the_pressure_of_its_surface(radius):
    tension, middle = 0.07, np.array([0.08, 0.083, 0.078])
    basin = Basin(lambda x: radius * SPACING - np.linalg.norm(x - middle, axis=-1), period=(0, 0, 0), high=(0.16, 0.16, 0.16))
    air = air_pressure(basin.wet, basin.depth, tension, basin.grid)
    jump = 2 * tension / (radius * SPACING)
    surface = np.abs(np.linalg.norm(basin.middle - middle, axis=1) / SPACING - radius) < 0.6
    np.testing.assert_allclose(air[surface].mean(), jump, rtol=0.05)
    assert not air_pressure(basin.wet, basin.depth, 0.0, basin.grid).any()


def test_faces_beyond_the_surface_change_like_those_beside_them():
    basin = column(0.1, 0.0)
    change = basin.grid.faces()
    known = np.broadcast_to(np.abs(centres(basin.grid)[..., 2] - 0.05) < 0.045, change.shape).copy()
    change[known] = 3.0
    liquid_ = basin.mass > 0
    found = spread_outwards(basin.grid, basin.mass, known, change)
    assert (change[found] == 3.0).all() and not change[~found].any()
    assert not (found & ~known & ~liquid_).any() and (found & ~known).any()


def test_the_same_bits_on_any_number_of_threads():
    def solved():
        basin = column(0.113, 0.004)
        u = np.random.default_rng(0).normal(size=basin.grid.faces().shape)
        p, where = basin.settle(u)
        return p, where, u

    for one, two in zip(*on_one_and_two_threads(solved), strict=True):
        assert np.array_equal(one, two)


def test_cells_shut_in_by_walls_have_no_pressure():
    basin = column(0.1, 0.055)
    assert (basin.middle[:, 2] > 0.05).all() and len(basin.wet.cell) == 4 * 8 * 5
    assert basin.wet.row.shape == (len(basin.grid.place), CELLS)
