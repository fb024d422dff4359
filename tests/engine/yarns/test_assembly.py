"""Assembling yarns: storage by yarn and u, orientation of contacts, many points at once; and handles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine.geometry.handles import Handles, no_handles
from engine.yarns.assembly import YarnAssembly
from engine.yarns.model import PointKind
from tests.engine.yarns.stacks import MATERIAL, UP, random_stack

TURNS = st.tuples(*[st.floats(-np.pi, np.pi)] * 3).map(Rotation.from_rotvec)


def test_nodes_and_points_name_each_other():
    model, state = random_stack(0).model, random_stack(0).state
    for n in range(model.node_count):
        assert model.point_nodes[model.node_point[n], model.node_slot[n]] == n
    for y in range(model.yarn_count):
        nodes = slice(model.node_start[y], model.node_start[y + 1])
        assert (model.node_yarn[nodes] == y).all()
        assert (np.sort(state.order[nodes]) == np.arange(nodes.start, nodes.stop)).all()


@settings(deadline=None)
@given(turn=TURNS, angle=st.floats(0.1, 3.0), swapped=st.booleans())
def test_the_side_turns_the_tangents_normal_from_the_lower_to_the_upper_yarn(turn, angle, swapped):
    yarns = YarnAssembly()
    directions = turn.apply([[1.0, 0.0, 0.0], [np.cos(angle), np.sin(angle), 0.0]])
    for yarn, d in enumerate(directions):
        yarns.yarn(MATERIAL, 2.0, 1.0)
        yarns.lagrangians(yarn, [0.0, 2.0], np.array([-d, d]))
    below, above = (1, 0) if swapped else (0, 1)
    up = turn.apply(UP)
    point = yarns.crossing(below, 1.0, above, 1.0, np.zeros(3), up)
    model, _ = yarns.build()
    t0, t1 = directions[model.node_yarn[model.point_nodes[point]]]
    assert (model.node_yarn[model.point_nodes[point]] == (below, above)).all()
    assert model.side[point] * np.cross(t0, t1) @ up > 0.0


def test_many_points_at_once_are_points_one_by_one():
    u, x = np.array([0.0, 1.0, 2.0]), np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    direction = np.array([0.0, 1.0, 0.0])
    once, singly = YarnAssembly(), YarnAssembly()
    for yarns in (once, singly):
        for _ in range(2):
            yarns.yarn(MATERIAL, 2.0, 1.0)
    once.lagrangians(0, u[::2], x[::2], pinned=[True, False], handle=[3, -1])
    once.lagrangians(1, u[::2], x[::2] + UP)
    once.crossings(0, u[1:2], 1, u[1:2], x[1:2], UP, 0.3, PointKind.CONTACT)
    once.edges(0, u[1:2] + 0.5, x[1:2] + 0.5, direction, 0.2)
    singly.lagrangian(0, u[0], x[0], True, 3)
    singly.lagrangian(0, u[2], x[2])
    for i in (0, 2):
        singly.lagrangian(1, u[i], x[i] + UP)
    singly.crossing(0, u[1], 1, u[1], x[1], UP, 0.3, PointKind.CONTACT)
    singly.edge(0, u[1] + 0.5, x[1] + 0.5, direction, 0.2)
    for many, one in zip(once.build(), singly.build(), strict=True):
        for name, values in vars(many).items():
            np.testing.assert_array_equal(values, getattr(one, name), err_msg=name)


@pytest.mark.parametrize(("time", "offset"), [(-1.0, 1.0), (0.0, 1.0), (0.5, 2.0), (1.0, 3.0), (9.0, 3.0)])
def test_handles_move_linearly_between_keyframes(time, offset):
    handles = Handles(np.array([0, 2, 3]), np.array([0.0, 1.0, 5.0]), np.array([[1.0, 2, 3], [3.0, 6, 9], [7.0, 7, 7]]))
    np.testing.assert_allclose(handles.offsets(time), [[offset, 2 * offset, 3 * offset], [7.0, 7.0, 7.0]])


@settings(deadline=None)
@given(st.tuples(*[st.floats(-360, 360)] * 3), st.integers(1, 7))
def test_handles_turn_about_their_pivots_however_time_is_cut(angles, steps):
    pivot, offset = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]]), np.array([[0.1, 0.2, 0.3], [1.0, 0.0, 0.0]])
    still = np.zeros(3)
    handles = Handles(np.array([0, 2, 4]), np.array([0.0, 1.0] * 2), np.array([still, offset[0], still, offset[1]]),
                      np.array([still, angles, still, still]), pivot)
    start, handle = np.random.default_rng(1).normal(size=(6, 3)), np.array([0, 0, 0, 0, 1, 1])
    x = start
    for k in range(steps):
        x = handles.carry(x, handle, k / steps, 1 / steps)
    turned = Rotation.from_euler("xyz", angles, degrees=True).apply(start - pivot[0]) + pivot[0]
    np.testing.assert_allclose(x, np.where(handle[:, None] == 0, turned, start) + offset[handle], atol=1e-12)


def test_no_handles_have_no_offsets():
    assert no_handles().offsets(0.0).shape == (0, 3)
