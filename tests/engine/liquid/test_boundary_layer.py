"""Velocities behind walls that stick go on as they come towards them, and a plate brakes what slides along it as it should."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.liquid.boundary_layer import extend
from engine.liquid.mirror import reflect
from engine.liquid.settings import LiquidSettings
from engine.steppers.liquid import LiquidStepper
from tests.engine.liquid.pools import SPACING, lattice, liquid, on_faces, particles, planes, tank
from tests.engine.liquid.test_walls import MIDDLE, H, held, inner, unit, ways, within_a_cell
from tests.engine.threads import on_one_and_two_threads


def behind_a_wall(n, offset, field, speed=(0.0, 0.0, 0.0), inertia=1.0):
    """Velocities of faces behind a plane as mirror images, as they go on, and as `field` has them."""
    n, point, speed = unit(n), MIDDLE + offset, np.array(speed)
    solids = planes((point, n))
    begin = solids._replace(centre=solids.centre - H * speed)
    grid, mass, _, found = held(lambda x: (x - point) @ n > 0, solids, True, begin)

    def at(x):
        return speed + field((x - point) @ n / SPACING, n)

    wanted = on_faces(grid, at)
    u = wanted.copy()
    u.reshape(-1)[found.mirror.face] = np.nan
    reflect(found.mirror, u)
    mirrored = u.copy()
    extend(grid, begin, solids, H, found.mirror.face, mass, np.full_like(mass, inertia), u)
    there = found.mirror.face[inner(grid, found.mirror.face)]
    assert len(there) > 50
    return [of.reshape(-1)[there] for of in (mirrored, u, wanted)]


def along(n):
    return np.cross(n, (0.3, 0.5, -0.8))


@settings(max_examples=20, deadline=None)
@given(ways, within_a_cell, st.tuples(*[st.floats(-1, 1)] * 3))
def test_an_even_flow_along_a_wall_goes_on(n, offset, speed):
    _, u, wanted = behind_a_wall(n, offset, lambda height, n: np.broadcast_to(along(n), (*height.shape, 3)), speed)
    np.testing.assert_allclose(u, wanted, atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(ways, within_a_cell)
def test_what_grows_evenly_from_a_wall_is_a_mirror_image(n, offset):
    _, u, wanted = behind_a_wall(n, offset, lambda height, n: height[..., None] * (along(n) + 0.7 * n))
    np.testing.assert_allclose(u, wanted, atol=1e-9)


@pytest.mark.parametrize("axis", range(3))
def test_between_both_it_goes_on_as_a_parabola(axis):
    n = np.eye(3)[axis]
    _, u, wanted = behind_a_wall(n, np.zeros(3), lambda z, n: (1.0 + 0.5 * z + 0.05 * z * z)[..., None] * along(n))
    np.testing.assert_allclose(u, wanted, atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.floats(0, SPACING), st.lists(st.floats(-1, 1), min_size=9, max_size=9))
def test_it_stays_between_what_sticks_and_what_slips(offset, layers):
    """However layers differ, and wherever the wall is: what is behind it is never faster than what is before."""
    heights, shape = 0.5 * np.arange(9), np.array((1.0, 2.0, 0.0))
    _, u, _ = behind_a_wall((0, 0, 1), np.array((0, 0, offset)), lambda z, n: np.interp(z, heights, layers)[..., None] * shape)
    assert np.abs(u).max() <= 2.0 * np.abs(np.interp(np.linspace(0.0, 2.0, 101), heights, layers)).max() + 1e-12


def test_a_face_on_a_wall_is_of_that_wall_whatever_round_off_says():
    n = unit((3, 0, 4))
    for off in (-1e-17, 0.0, 1e-17):
        _, u, wanted = behind_a_wall(n, off * n, lambda height, n: np.broadcast_to(along(n), (*height.shape, 3)))
        np.testing.assert_allclose(u, wanted, atol=1e-9)


def test_what_stress_alone_holds_back_sticks():
    mirrored, u, _ = behind_a_wall((0, 0, 1), np.zeros(3), lambda z, n: np.ones((*z.shape, 3)) - n, inertia=0.0)
    np.testing.assert_allclose(u, mirrored, atol=1e-12)


def test_between_both_the_share_of_inertia_decides():
    def found(inertia):
        return behind_a_wall((0, 0, 1), np.zeros(3), lambda z, n: np.ones((*z.shape, 3)) - n, inertia=inertia)[1]

    np.testing.assert_allclose(found(0.25), 0.75 * found(0.0) + 0.25 * found(1.0), atol=1e-12)


@pytest.mark.parametrize("cells, h, steps, within", [(12, 8e-3, 40, 0.02), (12, 2e-3, 160, 0.06), (24, 2e-3, 160, 0.02)])
def test_a_plate_brakes_what_slides_along_it(cells, h, steps, within):
    """By 2 U sqrt(nu t / pi) per area and density (Rayleigh 1911), once the layer is more than a cell thick."""
    nu, depth = 1e-3, 0.12
    spacing = depth / cells
    model = liquid(spacing=spacing, consistency=2e3 * nu, no_slip=True, period=(4, 4, 0))
    x = lattice((0, 0, 0), (4 * spacing, 4 * spacing, depth), spacing / 2)
    state = particles(model, x, (spacing / 2) ** 3, (1.0, 0.0, 0.0))
    stepper = LiquidStepper(model, np.array((0.0, 0.0, -9.81)), LiquidSettings(shear_tolerance=1e-6))
    floor = planes(((0, 0, 0), (0, 0, 1)))
    for _ in range(steps):
        assert stepper.step(state, h, floor, floor).accepted
    lost = depth * (1.0 - state.velocity[:, 0]).mean()
    assert lost == pytest.approx(2.0 * np.sqrt(nu * steps * h / np.pi), rel=within)
    assert state.velocity[:, 0].max() < 1.02


def test_a_wall_brakes_mud_by_no_more_than_its_stress():
    """A layer much thinner than a cell: mirror images alone would take a tenth of the momentum, whatever the step."""
    model = liquid(spacing=SPACING, shear_modulus=100.0, yield_stress=1.7, consistency=0.65, flow_index=0.5, no_slip=True,
                   period=(4, 4, 0))
    lost = []
    for h in (2e-3, 5e-4):
        state = particles(model, lattice((0, 0, 0), (0.04, 0.04, 0.04)), velocity=(2.0, 0.0, 0.0))
        stepper, floor = LiquidStepper(model, np.array((0.0, 0.0, -9.81))), planes(((0, 0, 0), (0, 0, 1)))
        for _ in range(round(0.02 / h)):
            assert stepper.step(state, h, floor, floor).accepted
        lost.append(1.0 - state.velocity[:, 0].mean() / 2.0)
    assert max(lost) < 3e-3 and lost[1] == pytest.approx(lost[0], rel=0.3)


def test_the_same_bits_on_any_number_of_threads():
    def extended():
        solids = tank(MIDDLE - 0.02, MIDDLE + 0.03, "xyzXYZ")
        grid, mass, _, found = held(lambda x: (np.abs(x - MIDDLE - 0.005) < 0.025).all(axis=1), solids, True)
        u = np.random.default_rng(0).normal(size=mass.shape)
        reflect(found.mirror, u)
        extend(grid, solids, solids, H, found.mirror.face, mass, np.ones_like(mass), u)
        return u

    assert np.array_equal(*on_one_and_two_threads(extended))
