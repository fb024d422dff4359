"""Open shares and speeds of faces at solids, faces and cells behind walls as mirror images, and particles that got inside."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from engine.geometry.signed_distance import SPHERE
from engine.liquid.grid import sorted_grid, taken
from engine.liquid.mirror import collect, collect_mass, reflect, reflect_change
from engine.liquid.surface import volume
from engine.liquid.walls import fold, open_share, open_space, push_out, walls
from tests.engine.liquid.pools import SPACING, centres, face_centres, lattice, liquid, on_faces, on_grid, planes, tank
from tests.engine.threads import on_one_and_two_threads

H = 0.01
MIDDLE = np.full(3, 0.08)
ways = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda n: np.linalg.norm(n) > 0.1)
within_a_cell = st.tuples(*[st.floats(0, SPACING)] * 3)


def unit(n):
    return np.array(n) / np.linalg.norm(n)


def cube():
    """A full cube of 16 cells, whose middle any walls cut."""
    x = lattice((0, 0, 0), 2 * MIDDLE)
    return x, *sorted_grid(liquid(), x)


CUBE, GRID, ORDER = cube()
FACES = np.stack([face_centres(GRID, a) for a in range(3)])


def mass_of(x):
    """Mass of the faces of the cube's grid, of particles x of it."""
    grid, order = sorted_grid(liquid(), x)
    x = taken(x, order)
    mass, _, filled = on_grid(grid, x, SPACING**3 / 8)
    return grid, mass, filled


def held(before, solids, no_slip, begin=None):
    """Grid, mass, filled cells and walls of that part of the cube for which `before` is true."""
    grid, mass, filled = mass_of(CUBE[before(CUBE)])
    return grid, mass, filled, walls(grid, begin or solids, solids, H, no_slip, mass)


def places_of(grid, g):
    """Where the faces g are [m]."""
    return np.stack([face_centres(grid, a) for a in range(3)]).reshape(-1, 3)[g]


def inner(grid, g):
    """Which of the faces g lie where neither the edge of the cube nor that of the liquid is near."""
    return (np.abs(places_of(grid, g) - MIDDLE) < 0.04).all(axis=1)


@settings(max_examples=300, deadline=None)
@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))
def test_the_open_share_of_a_face_by_sampling(distance, a, b):
    assume(max(abs(distance), abs(a), abs(b)) > 0.02)  # else the plane is the face
    at = (np.arange(200) + 0.5) / 200 - 0.5
    open_ = distance + a * at[:, None] + b * at[None, :] > 0
    assert open_share(distance, a, b) == pytest.approx(open_.mean(), abs=0.008)


@settings(max_examples=12, deadline=None)
@given(ways, within_a_cell)
def test_faces_at_a_plane_are_open_as_it_leaves_them(n, offset):
    n, point = unit(n), MIDDLE + offset
    solids = planes((point, n))
    found = walls(GRID, solids, solids, H, False, GRID.faces())
    at = SPACING * ((np.arange(40) + 0.5) / 40 - 0.5)
    apart = np.abs((FACES - point) @ n)
    near = (apart < 2 * SPACING) & (apart > 1e-4 * SPACING)  # a face that is in the plane is shut, whatever samples say
    for axis in range(3):
        one, other = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        samples = at[:, None, None] * one + at[None, :, None] * other
        cut = FACES[axis][near[axis]][::7]
        share = ((cut[:, None, None] + samples - point) @ n > 0).mean(axis=(1, 2))
        np.testing.assert_allclose(found.open[axis][near[axis]][::7], share, atol=0.03)
        far = apart[axis] >= 2 * SPACING
        assert np.array_equal(found.open[axis][far], ((FACES[axis] - point) @ n > 0)[far])
    signed = (centres(GRID) - point) @ n / SPACING
    close = found.near[:, None] & (signed < 3)
    np.testing.assert_allclose(found.distance[close], signed[close], atol=1e-9)
    assert (found.distance[~close] >= 3 - 1e-9).all()


def test_the_volume_that_faces_leave_of_a_ball_is_of_second_order():
    """By Gauss: places times closed shares of faces sum to three volumes of the ball."""
    errors = []
    for radius in (3.0, 6.0):
        ball = planes((MIDDLE + 0.003, (0, 0, 1)))._replace(kind=np.array([SPHERE]), size=np.full((1, 3), radius * SPACING))
        closed = 1.0 - walls(GRID, ball, ball, H, False, GRID.faces()).open
        volume = 4 / 3 * np.pi * radius**3
        errors.append(max(abs(closed[a].sum() / volume - 1.0) for a in range(3)))
    assert errors[0] < 0.03 and errors[1] < errors[0] / 3


def test_a_plane_on_faces_closes_them():
    low, high = np.full(3, 4 * SPACING), np.full(3, 12 * SPACING)
    solids = tank(low, high, "xXyYzZ")
    found = walls(GRID, solids, solids, H, False, GRID.faces())
    for axis in range(3):
        cell = np.round(FACES[axis] / SPACING - 0.5 * (np.arange(3) != axis), 6)
        inside = (cell >= 4) & (cell < 12)
        inside[..., axis] = (cell[..., axis] > 4) & (cell[..., axis] < 12)
        np.testing.assert_allclose(found.open[axis], inside.all(axis=-1), atol=3e-6)


def test_walls_that_move_and_turn():
    n, point = unit((0.2, -0.5, 1.0)), MIDDLE + 0.002
    begin = planes((point, n))
    turn = np.array([[np.cos(0.1), -np.sin(0.1), 0], [np.sin(0.1), np.cos(0.1), 0], [0, 0, 1]])
    end = begin._replace(centre=begin.centre + np.array((0.001, 0.002, -0.003)), rotation=turn @ begin.rotation)
    found = walls(GRID, begin, end, H, False, GRID.faces())
    came_from = begin.centre[0] + (FACES - end.centre[0]) @ turn
    for axis in range(3):
        shut = found.open[axis] < 1.0
        velocity = (FACES[axis] - came_from[axis]) / H
        np.testing.assert_allclose(found.speed[axis][shut], velocity[shut][:, axis], atol=1e-12)
        assert shut.any() and not found.speed[axis][~shut].any()


@settings(max_examples=20, deadline=None)
@given(ways, within_a_cell, st.booleans(), st.booleans())
def test_velocities_that_grow_evenly_from_a_wall_go_on_behind_it(n, offset, no_slip, moves):
    """Where it sticks all of u, where it slips the part along the normal; the wall may move.

    Exactly so where all faces around the image are before the wall; where it is nearer, those that are stand for all.
    """
    n, point = unit(n), MIDDLE + offset
    solids = planes((point, n))
    speed = np.array([0.3, -0.2, 0.1]) if moves else np.zeros(3)
    begin = solids._replace(centre=solids.centre - H * speed)
    along = np.cross(n, (0.3, 0.5, -0.8))

    def field(x):
        depth = ((x - point) @ n / SPACING)[..., None]
        return speed + (depth * np.array([1.0, -2.0, 0.5]) if no_slip else along + 0.7 * depth * n)

    grid, _, _, found = held(lambda x: (x - point) @ n > 0, solids, no_slip, begin)
    exact = on_faces(grid, field)
    u = exact.copy()
    u.reshape(-1)[found.mirror.face] = np.nan
    reflect(found.mirror, u)
    behind = found.mirror.face[inner(grid, found.mirror.face)]
    error = np.abs(u - exact).reshape(-1)[behind]
    assert len(behind) > 50 and error.max() < 1.5 * np.abs((1.0, 2.0, 0.5)).sum()
    behind = behind[(point - places_of(grid, behind)) @ n > SPACING * np.abs(n).sum()]
    np.testing.assert_allclose(u.reshape(-1)[behind], exact.reshape(-1)[behind], atol=1e-9)


@pytest.mark.parametrize("no_slip, field", [
    (False, lambda d: d * (1.0, -2.0, 0.5)),
    (True, lambda d: d[..., :1] * d[..., 1:2] * d[..., 2:] * np.array([1.0, -2.0, 0.5])),
], ids=["slip", "no slip"])
@pytest.mark.parametrize("offset", [0.0, 0.5])
def test_behind_corners_walls_mirror_one_after_the_other(no_slip, field, offset):
    point = MIDDLE + offset * SPACING
    grid, _, _, found = held(lambda x: (x > point).all(axis=1), tank(point, point, "xyz"), no_slip)
    exact = on_faces(grid, lambda x: field((x - point) / SPACING))
    u = exact.copy()
    u.reshape(-1)[found.mirror.face] = np.nan
    reflect(found.mirror, u)
    behind = found.mirror.face[inner(grid, found.mirror.face)]
    np.testing.assert_allclose(u.reshape(-1)[behind], exact.reshape(-1)[behind], atol=1e-9)


def oblique(no_slip):
    n, point = unit((0.4, -0.3, 0.8)), MIDDLE + np.array((0.001, 0.004, 0.007))
    return held(lambda x: (x - point) @ n > 0, planes((point, n)), no_slip)


@pytest.mark.parametrize("no_slip", [True, False])
def test_collect_is_the_transpose_of_reflect(no_slip):
    grid, _, _, found = oblique(no_slip)
    rng = np.random.default_rng(0)
    change, force = rng.normal(size=grid.faces().shape), rng.normal(size=grid.faces().shape)
    reflected, collected = change.copy(), force.copy()
    reflect_change(found.mirror, reflected)
    collect(found.mirror, collected)
    assert not collected.reshape(-1)[found.mirror.face].any()
    assert (force * reflected).sum() == pytest.approx((collected * change).sum(), rel=1e-12)


def test_mass_behind_walls_goes_to_faces_before_them():
    _, mass, _, found = oblique(True)
    before, after = mass.copy(), mass.copy()
    collect_mass(found.mirror, after)
    after.reshape(-1)[found.mirror.face] = 0.0
    assert after.min() >= 0.0
    lost = mass.reshape(-1)[found.mirror.face[~found.mirror.weight.any(axis=1)]].sum()  # at edges, where nothing is before
    assert after.sum() + lost == pytest.approx(before.sum(), rel=1e-12) and lost < 1e-5 * before.sum()


@settings(max_examples=10, deadline=None)
@given(within_a_cell)
def test_a_full_tank_is_full_wherever_its_walls_are(offset):
    low = 0.04 + np.array((0.0, 0.0, offset[2]))  # in corners that two walls cut, cells have only the nearer one's share
    x = lattice(low, low + 0.06)
    grid, order = sorted_grid(liquid(), x)
    mass, _, filled = on_grid(grid, taken(x, order), np.full(len(x), (SPACING / 2) ** 3))
    solids = tank(low, low + 0.06, "xyzXYZ")
    found = walls(grid, solids, solids, H, False, mass)
    fold(found, filled)
    np.testing.assert_allclose(filled[found.distance >= 0], 1.0, atol=0.06)
    assert volume(grid, filled, found.distance) == pytest.approx(0.06**3, rel=0.02)


def test_folded_cells_are_even_about_a_wall():
    grid, _, filled, found = held(lambda x: x[:, 2] > 0.08, tank(MIDDLE, MIDDLE, "z"), False)
    fold(found, filled)
    middle = centres(grid)
    there = (np.abs(middle[..., :2] - MIDDLE[:2]) < 0.05).all(axis=-1) & (np.abs(middle[..., 2] - 0.08) < 1.9 * SPACING)
    np.testing.assert_allclose(filled[there], 1.0, rtol=1e-12)


def inside_of(solids, x, velocity, begin=None):
    """Places and velocities after those inside were pushed out."""
    grid, order = sorted_grid(liquid(), x)
    x, velocity = taken(x, order), taken(velocity, order)
    found = walls(grid, begin or solids, solids, H, False, grid.faces())
    push_out(grid, found.near, found.distance, 1.0, begin or solids, solids, H, x, velocity)
    return x, velocity, taken(np.arange(len(x)), order)


def test_what_got_inside_is_put_on_the_surface_and_goes_no_deeper():
    n, speed = unit((0.2, 0.3, 1.0)), np.array([0.1, 0.0, 0.2])
    solids = planes(((0, 0, 0), n))
    rng = np.random.default_rng(1)
    before, wanted = rng.uniform(-0.02, 0.02, (300, 3)), rng.normal(size=(300, 3))
    x, velocity, order = inside_of(solids, before, wanted, solids._replace(centre=solids.centre - H * speed))
    before, wanted = before[order], wanted[order]
    depth = before @ n
    np.testing.assert_allclose(x, before - np.minimum(depth, 0.0)[:, None] * n, atol=1e-15)
    normal = (wanted - speed) @ n
    held_back = (depth < 0) & (normal < 0)
    np.testing.assert_allclose(velocity, wanted - np.where(held_back, normal, 0.0)[:, None] * n, atol=1e-12)


def test_what_got_into_an_edge_is_put_out_of_both_walls():
    rng = np.random.default_rng(2)
    x, velocity, _ = inside_of(tank(np.zeros(3), np.zeros(3), "xyz"), rng.uniform(-0.009, 0.009, (300, 3)),
                               rng.normal(size=(300, 3)))
    assert x.min() >= -1e-12
    assert velocity[x <= 1e-12].min() >= -1e-12


def test_no_solids_is_open_space():
    found, open_ = walls(GRID, planes(), planes(), H, True, GRID.faces()), open_space(GRID)
    assert not found.near.any() and (found.open == 1).all() and len(found.mirror.face) == len(found.cell_mirror.cell) == 0
    assert np.array_equal(found.distance, open_.distance)


def test_the_same_bits_on_any_number_of_threads():
    def cut():
        _, _, filled, found = oblique(True)
        fold(found, filled)
        return filled, found.open, found.distance, *found.mirror, *found.cell_mirror

    for one, two in zip(*on_one_and_two_threads(cut), strict=True):
        assert np.array_equal(one, two)
