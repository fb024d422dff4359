"""Contacts that end."""

from dataclasses import replace

import numpy as np
import pytest

from engine.yarns import observe
from engine.yarns.model import NodeState, PointKind
from engine.yarns.removal import parted, remove
from engine.yarns.topology import chain_of
from tests.engine.yarns.stacks import random_stack

PULLS = 3e-3  # [s]
SAFETY = 0.1
ENDS_BY_PULLING = {PointKind.CONTACT}
ENDS_OFF_THE_END = {PointKind.CROSSING, PointKind.CONTACT, PointKind.EYELET, PointKind.EDGE}


@pytest.fixture
def stack():
    stack = random_stack(0)
    stack.state.pulling_time[:] = 0.0
    return stack


def kinds_of(stack, points):
    return {PointKind(k) for k in stack.model.point_kind[points]}


def test_nothing_ends_by_itself(stack):
    assert len(parted(stack.model, stack.state, PULLS, SAFETY)) == 0


def test_contacts_between_fabrics_end_by_pulling(stack):
    stack.state.pulling_time[:] = 0.9 * PULLS
    assert len(parted(stack.model, stack.state, PULLS, SAFETY)) == 0
    stack.state.pulling_time[:] = PULLS / 3 + PULLS / 3 + PULLS / 3
    assert kinds_of(stack, parted(stack.model, stack.state, PULLS, SAFETY)) == ENDS_BY_PULLING
    stack.state.pulling_time[:] = 1e-6
    assert kinds_of(stack, parted(stack.model, stack.state, 0.0, SAFETY)) == ENDS_BY_PULLING


@pytest.mark.parametrize("u", [-1e-9, 100.0], ids=["before", "behind"])
def test_what_slides_ends_where_the_yarn_ends(stack, u):
    stack.state.u[:] = u
    ended = parted(stack.model, stack.state, PULLS, SAFETY)
    assert kinds_of(stack, ended) == ENDS_OFF_THE_END
    stack.state.active[ended[0]] = False
    assert list(parted(stack.model, stack.state, PULLS, SAFETY)) == list(ended[1:])  # once only


def test_the_other_yarn_may_end_too(stack):
    point = np.flatnonzero(stack.model.point_kind == PointKind.CONTACT)[0]
    stack.state.u[stack.model.point_nodes[point, 1]] = -0.1
    assert list(parted(stack.model, stack.state, PULLS, SAFETY)) == [point]


def test_yarns_slip_off_an_edge_just_before_its_ends(stack):
    """Where they come from its middle: what lies there stays."""
    point = np.flatnonzero(stack.model.point_kind == PointKind.EDGE)[0]
    margin = SAFETY * stack.model.rest_segment[stack.model.node_yarn[stack.model.point_nodes[point, 0]]]
    half_length = stack.model.edge_half_length.copy()
    middle = stack.model.edge_middle.copy()
    middle[point] = stack.state.x[point] - [3.0, 0.0, 0.0]
    for beyond, rate, ended in ((0.99, 1.0, [point]), (1.01, 1.0, []), (0.99, -1.0, []), (0.99, 0.0, [])):
        half_length[point] = 3.0 + beyond * margin
        stack.state.x_rate[point] = [rate, 0.0, 0.0]
        model = replace(stack.model, edge_middle=middle, edge_half_length=half_length)
        assert list(parted(model, stack.state, PULLS, SAFETY)) == ended


def test_removal_keeps_momentum_and_adds_no_energy(stack):
    model, state = stack.model, stack.state
    points = np.flatnonzero(np.isin(model.point_kind, list(ENDS_OFF_THE_END)))[::3]
    before = [observe.momentum(model, state), observe.energies(model, state, np.zeros(3))["kinetic"]]
    remove(model, state, points)
    np.testing.assert_allclose(observe.momentum(model, state), before[0], atol=1e-13)
    assert observe.energies(model, state, np.zeros(3))["kinetic"] <= before[1]
    assert not state.active[points].any() and not state.normal_force[points].any()
    assert (observe.node_states(model, state)[points] == NodeState.REMOVED).all()
    assert not np.isin(model.node_point[chain_of(model, state.order, state.eil, state.active).node], points).any()
