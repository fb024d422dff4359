"""Depth is the inverse of what splines see; planes are found where they are, and volumes are those of what is there."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.liquid.grid import sorted_grid, taken
from engine.liquid.surface import FAR, deep, depth_of, depths, seen, volume
from engine.liquid.walls import fold, open_space, walls
from tests.engine.liquid.pools import SPACING, cells_of, centres, lattice, liquid, on_grid, tank

FINE = (SPACING / 2) ** 3


def filled_by(x, volumes=FINE, model=None):
    model = model or liquid()
    grid, order = sorted_grid(model, x)
    x = taken(x, order)
    mass, _, filled = on_grid(grid, x, volumes)
    return grid, mass, filled


def depth_in(filled):
    depth = np.empty_like(filled)
    depths(filled, depth)
    return depth


@given(st.floats(-2.0, 2.0))
def test_what_a_spline_sees_of_a_half_space(d):
    at = np.linspace(-1.5, 1.5, 30001)
    weight = np.where(np.abs(at) < 0.5, 0.75 - at**2, 0.5 * (1.5 - np.abs(at)) ** 2)
    assert seen(d) == pytest.approx(np.trapezoid(np.where(at <= d, weight, 0.0), at), abs=1e-4)


@given(st.floats(-FAR, FAR))
def test_depth_is_the_inverse_of_what_is_seen(d):
    share = seen(d)
    assert seen(depth_of(share)) == pytest.approx(share, abs=1e-11)
    if abs(d) < 1.4:  # nearer to the ends what is seen hardly depends on depth
        assert depth_of(share) == pytest.approx(d, abs=1e-9)
    assert depth_of(-share) == -FAR and depth_of(1.0 + share) == FAR


@settings(deadline=None, max_examples=20)
@given(st.floats(0.0, 1.0), st.integers(0, 2))
def test_a_plane_at_any_height_is_found(height, axis):
    """Of particles so fine that they are a continuum: eight times as many along the axis as on the lattice."""
    top, fine = (6.0 + height) * SPACING, 128
    low, high = np.full(3, -4 * SPACING), np.full(3, 4 * SPACING)
    low[axis], high[axis] = 0.0, SPACING
    x = lattice(low, high)
    x = x[np.abs(x[:, axis] - 0.25 * SPACING) < 1e-9]
    stack = top * (np.arange(fine) + 0.5) / fine
    x = np.concatenate([np.where(np.arange(3) == axis, at, x) for at in stack])
    grid, _, filled = filled_by(x, top / fine * (SPACING / 2) ** 2)
    depth, middle = depth_in(filled), centres(grid)
    across = [k for k in range(3) if k != axis]
    inner = (np.abs(middle[..., across]) < 2.4 * SPACING).all(axis=-1)
    exact = np.clip((top - middle[..., axis]) / SPACING, -FAR, FAR)
    near = inner & (np.abs(exact) < 1.0) & (middle[..., axis] > 2 * SPACING)
    assert near.sum() >= 25
    np.testing.assert_allclose(depth[near], exact[near], atol=2e-3)


@settings(deadline=None, max_examples=15)
@given(st.tuples(*[st.integers(1, 6)] * 3), st.tuples(*[st.integers(-5, 5)] * 3))
def test_the_volume_of_a_box_on_the_lattice_is_exact(size, low):
    low, size = SPACING * np.array(low), SPACING * np.array(size)
    grid, _, filled = filled_by(lattice(low, low + size))
    assert volume(grid, filled, open_space(grid).distance) == pytest.approx(size.prod(), rel=1e-12)


def test_the_volume_of_a_box_between_walls_is_exact():
    low, high = np.zeros(3), SPACING * np.array([6.0, 5.0, 7.0])
    grid, mass, filled = filled_by(lattice(low, high))
    solids = tank(low, high, "xXyz")
    found = walls(grid, solids, solids, 1.0, False, mass)
    fold(found, filled)
    assert volume(grid, filled, found.distance) == pytest.approx(high.prod(), rel=1e-12)


def test_holes_between_particles_that_liquid_is_around_count_as_full():
    x = lattice((0, 0, 0), np.full(3, 8 * SPACING))
    some = x[np.random.default_rng(0).random(len(x)) > 0.1]
    grid, _, filled = filled_by(some)
    found = volume(grid, filled, open_space(grid).distance)
    assert FINE * len(some) < 0.92 * FINE * len(x) < found < FINE * len(x)


def test_what_lies_deep():
    grid, _, filled = filled_by(lattice((0, 0, 0), np.full(3, 8 * SPACING)))
    once, twice = deep(grid, filled, open_space(grid).distance)
    cells = cells_of(grid)
    for found, margin in ((once, 1), (twice, 2)):
        assert np.array_equal(found, ((cells >= margin) & (cells < 8 - margin)).all(axis=-1))


def test_walls_are_as_good_as_liquid_beside_a_cell():
    grid, mass, filled = filled_by(lattice((0, 0, 0), np.full(3, 8 * SPACING)))
    solids = tank(np.zeros(3), np.full(3, 8 * SPACING), "xz")
    found = walls(grid, solids, solids, 1.0, False, mass)
    fold(found, filled)
    once, twice = deep(grid, filled, found.distance)
    cells = cells_of(grid)
    for deeper, margin in ((once, 1), (twice, 2)):
        low = np.array([0, margin, 0])
        before = found.distance >= 0
        assert np.array_equal(deeper & before, ((cells >= low) & (cells < 8 - margin)).all(axis=-1))
