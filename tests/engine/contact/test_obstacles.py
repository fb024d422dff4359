"""Contact with obstacles: forces in closed form, and how a step's end settles anchors and normal forces."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine.contact import obstacles
from engine.contact.obstacles import ObstacleKind, Obstacles, motion, posed
from engine.geometry.handles import Handles, no_handles

DISTANCE, STIFFNESS, FRICTION = 0.1, 5.0, 0.4
FLOOR = Obstacles(np.array([ObstacleKind.PLANE]), np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)), np.array([FRICTION]))
STILL = motion(FLOOR, no_handles(), 0.0, 0.1)
ONE_POINT = np.array([0])
UP = np.array([[0.0, 0.0, 1.0]])
SLIPS = st.floats(-1.0, 1.0)


def pushed(x, anchor=None, last_force=0.0, x0=None, moved=STILL):
    """Energy and force of the floor on one point."""
    x = np.array([x], float)
    anchors = x.copy() if anchor is None else np.array([anchor], float)
    normal, limit, gradient = np.zeros((1, 3)), np.zeros(1), np.zeros((1, 5))
    obstacles.carry(ONE_POINT, moved.begin, moved.end, moved.friction, np.array([last_force]),
                    x if x0 is None else np.array([x0], float), anchors, normal, limit)
    energy = obstacles.add_gradient(
        ONE_POINT, moved.end, np.array([DISTANCE]), np.array([STIFFNESS]), anchors, normal, limit, x, gradient)
    return energy, -gradient[0, :3]


def settled(x, anchor, last_force):
    """Anchor, normal force and deepest penetration after a step that ended at x."""
    anchors, force = np.array([anchor], float), np.zeros(1)
    deepest = obstacles.settle(
        ONE_POINT, STILL.end, np.array([DISTANCE]), np.array([STIFFNESS]), np.array([FRICTION * last_force]),
        np.array([x], float), anchors, force)
    return anchors[0], force[0], deepest


@pytest.mark.parametrize(("height", "force"), [(0.2, 0.0), (0.1, 0.0), (0.04, 0.3), (-0.1, 1.0)])
def test_the_floor_pushes_within_its_distance(height, force):
    energy, found = pushed([3.0, 4.0, height])
    assert energy == pytest.approx(0.5 * force**2 / STIFFNESS)
    np.testing.assert_allclose(found, [0.0, 0.0, force], atol=1e-15)


@settings(deadline=None)
@given(slip=st.tuples(SLIPS, SLIPS), last_force=st.floats(0.0, 2.0))
def test_friction_is_a_spring_up_to_coulombs_limit(slip, last_force):
    energy, force = pushed([*slip, 1.0], [0.0, 0.0, 5.0], last_force)
    length, limit = np.hypot(*slip), FRICTION * last_force
    assert np.linalg.norm(force) == pytest.approx(min(STIFFNESS * length, limit), abs=1e-12)
    assert force[:2] @ slip <= 0.0 and force[2] == pytest.approx(0.0, abs=1e-12)
    assert energy >= 0.0


@settings(deadline=None)
@given(slip=st.tuples(SLIPS, SLIPS), last_force=st.floats(0.01, 2.0), height=st.floats(-0.2, 0.09))
def test_an_anchor_that_slides_trails_at_the_limit(slip, last_force, height):
    x = [*slip, height]
    anchor, force, deepest = settled(x, [0.0, 0.0, 0.3], last_force)
    assert force == pytest.approx(STIFFNESS * (DISTANCE - height))
    assert deepest == max(-height, 0.0)
    before, after = pushed(x, [0.0, 0.0, 0.3], last_force), pushed(x, anchor, last_force)
    np.testing.assert_allclose(after[1], before[1], atol=1e-12)  # no force changes between steps
    reach = FRICTION * last_force / STIFFNESS
    np.testing.assert_allclose(np.linalg.norm(anchor[:2] - slip), min(np.hypot(*slip), reach), atol=1e-12)


@pytest.mark.parametrize(("height", "last_force"), [(0.1, 1.0), (0.05, 0.0)], ids=["leaves", "has just come"])
def test_an_anchor_goes_along_where_nothing_holds_it(height, last_force):
    anchor, _, _ = settled([1.0, 2.0, height], [0.0, 0.0, 0.0], last_force)
    np.testing.assert_array_equal(anchor, [1.0, 2.0, height])


def test_friction_stays_that_of_the_obstacle_at_the_start_of_the_step():
    """A step that reaches across an edge keeps the tangents with which it began, so that its potential is smooth."""
    _, beside = pushed([0.3, 0.0, 1.0], [0.0, 0.0, 1.0], 2.0, x0=[0.0, 0.0, 0.05])
    np.testing.assert_allclose(beside, [-FRICTION * 2.0, 0.0, 0.0], atol=1e-15)


def test_obstacles_are_where_their_handles_carry_them():
    two = Obstacles(np.array([ObstacleKind.SPHERE] * 2), np.array([[0.0, 0, 0], [5.0, 0, 0]]), np.stack([np.eye(3)] * 2),
                    np.ones((2, 3)), np.zeros(2), np.array([0, -1]))
    handles = Handles(np.array([0, 2]), np.array([0.0, 2.0]), np.array([[0.0, 0, 0], [0.0, 0, 4.0]]))
    np.testing.assert_array_equal(posed(two, handles, 0.5).centre, [[0, 0, 1.0], [5.0, 0, 0]])
    step = motion(two, handles, 0.5, 1.0)
    np.testing.assert_array_equal([step.begin.centre[0, 2], step.end.centre[0, 2]], [1.0, 3.0])
    np.testing.assert_array_equal(two.centre[0], 0.0)  # constants stay what they are


@settings(deadline=None, max_examples=25)
@given(turn=st.tuples(*[st.floats(-np.pi, np.pi)] * 3).map(Rotation.from_rotvec), shift=st.tuples(SLIPS, SLIPS, SLIPS))
def test_whoever_moves_with_the_obstacle_feels_no_change(turn, shift):
    """Anchor and normal go along with an obstacle that turns and shifts within the step."""
    end = STILL.end._replace(centre=np.array([shift]), rotation=turn.as_matrix()[None])
    before = pushed([0.2, 0.1, 0.05], [0.1, 0.1, 0.3], 1.0)
    along = pushed(turn.apply([0.2, 0.1, 0.05]) + shift, [0.1, 0.1, 0.3], 1.0, [0.2, 0.1, 0.05], replace(STILL, end=end))
    assert along[0] == pytest.approx(before[0], rel=1e-9)
    np.testing.assert_allclose(along[1], turn.apply(before[1]), atol=1e-12)


def updated(pull, slip, dx, limit):
    """What `update_pull` makes of the pull of a point that slid by `slip` [2] on the floor, for an update dx [3] of x."""
    pull = np.array([pull], float)
    obstacles.update_pull(ONE_POINT, np.array([STIFFNESS]), np.zeros((1, 3)), UP, np.array([limit]),
                          np.array([[*slip, 1.0]]), np.array([dx], float), pull)
    return pull[0]


def hessian(pull, slip, limit):
    """The second derivatives that Newton sees for a point above the floor, which slid by `slip` [2]."""
    block = np.zeros((1, 5, 5))
    obstacles.add_hessian(ONE_POINT, STILL.end, np.array([DISTANCE]), np.array([STIFFNESS]), np.zeros((1, 3)), UP,
                          np.array([limit]), np.array([pull], float), np.array([[*slip, 1.0]]), ONE_POINT, block)
    return block[0, :3, :3]


@settings(deadline=None)
@given(slip=st.tuples(SLIPS, SLIPS), last_force=st.floats(0.01, 2.0))
def test_the_pull_without_an_update_is_the_friction_over_its_limit(slip, last_force):
    limit = FRICTION * last_force
    _, force = pushed([*slip, 1.0], [0.0, 0.0, 1.0], last_force)
    np.testing.assert_allclose(-limit * updated(np.zeros(3), slip, np.zeros(3), limit), force, atol=1e-12)


@settings(deadline=None)
@given(slip=st.tuples(SLIPS, SLIPS), dx=st.tuples(SLIPS, SLIPS, SLIPS), before=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
       limit=st.floats(0.01, 2.0))
def test_no_pull_is_more_than_the_limit_or_makes_the_hessian_negative(slip, dx, before, limit):
    pull = updated([before[0], before[1], 0.0], slip, dx, limit)
    assert np.linalg.norm(pull) <= 1.0 + 1e-12 and pull[2] == 0.0
    found = hessian(pull, np.add(slip, dx[:2]), limit)
    np.testing.assert_allclose(found, found.T)
    assert np.linalg.eigvalsh(found)[0] >= -1e-9 * max(1.0, np.abs(found).max())


@settings(deadline=None)
@given(rest=st.tuples(SLIPS, SLIPS).map(np.array), start=st.tuples(SLIPS, SLIPS).map(np.array))
def test_newton_finds_whether_a_point_sticks_though_it_starts_many_reaches_away(rest, start):
    limit, hold, slip, pull = 1e-3, 2e-3, start, np.zeros(3)  # held by a weak spring at `rest`
    for _ in range(25):
        gradient = hold * (slip - rest) - pushed([*slip, 1.0], [0.0, 0.0, 1.0], limit / FRICTION)[1][:2]
        if np.abs(gradient).max() < 1e-9:
            break
        step = np.linalg.solve(hold * np.eye(2) + hessian(pull, slip, limit)[:2, :2], -gradient)
        pull, slip = updated(pull, slip, [*step, 0.0], limit), slip + step
    length = np.linalg.norm(rest)
    np.testing.assert_allclose(slip, rest * max(0.0, 1.0 - limit / hold / max(length, 1e-300)), atol=2 * limit / STIFFNESS)
