"""Contacts that begin."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.yarns import observe
from engine.yarns.addition import INSIDE, SLACK, add, approach, meeting
from engine.yarns.assembly import YarnAssembly
from engine.yarns.model import PointKind
from engine.yarns.removal import remove
from engine.yarns.topology import assign, chain_of
from tests.engine.yarns.stacks import MATERIAL, UP, free_weaves

R = MATERIAL.radius
H = 0.1


def cross(gap=0.5 * R, closing=0.0, u=1.0, sliding=(0.0, 0.0), up=UP, kinematic=False):
    """A yarn along x, and one along y that is `gap` above it and comes down: their contact is out of use."""
    yarns = YarnAssembly()
    below, above = yarns.yarn(MATERIAL, 2.0, 0.5, kinematic=kinematic), yarns.yarn(MATERIAL, 2.0, 0.5)
    for s in (0.0, 0.4, 1.3, 2.0):
        yarns.lagrangian(below, s, [s - u, 0.0, 0.0], pinned=kinematic)
        yarns.lagrangian(above, s, [0.0, s - 1.0, gap])
    yarns.crossing(below, 0.2, above, 1.9, np.zeros(3), up, kind=PointKind.CONTACT)
    model, state = yarns.build()
    remove(model, state, np.array([model.point_count - 1]))
    state.velocity[:] = np.where(model.node_yarn == above, 1.0, 0.0)[:, None, None] * [*sliding, -closing]
    return model, state


def look(model, state):
    return approach(model, state, chain_of(model, state.order, state.eil, state.active))


def begins(**of_cross):
    model, state = cross(**of_cross)
    [found] = meeting(model, look(model, state), H)
    return bool(found)


@settings(deadline=None)
@given(gap=st.floats(-3 * R, 3 * R), u=st.floats(0.02, 1.98), closing=st.floats(-1.0, 1.0),
       sliding=st.tuples(*[st.floats(-1, 1)] * 2))
def test_the_nearest_places_their_gap_and_its_rate_are_found(gap, u, closing, sliding):
    model, state = cross(gap, closing, u, sliding)
    coming = look(model, state)
    [point] = coming.points
    np.testing.assert_allclose(state.u[model.point_nodes[point]], [u, 1.0], atol=1e-12)
    np.testing.assert_allclose(state.x[point], [0.0, 0.0, gap / 2], atol=1e-12)
    np.testing.assert_allclose(coming.between[0], [0.0, 0.0, -gap], atol=1e-12)
    if INSIDE * R < u < 2.0 - INSIDE * R:
        np.testing.assert_allclose([coming.gap[0], coming.rate[0]], [gap, -closing], atol=1e-12)


def test_contacts_begin_where_yarns_would_pass_within_the_step():
    assert begins(gap=0.5 * R, closing=(0.5 + 2 * SLACK) * R / H)
    assert not begins(gap=0.5 * R, closing=(0.5 + 0.5 * SLACK) * R / H)
    assert not begins(gap=0.5 * R, closing=-0.5 * R / H)


def test_contacts_begin_where_yarns_have_just_passed_but_not_from_the_other_side():
    assert begins(gap=-0.1 * R, closing=1e-6)
    assert not begins(gap=-0.1 * R, closing=-0.2 * R / H), "they come apart by themselves"
    assert not begins(gap=-1.5 * R, closing=0.2 * R / H), "they are below each other"
    assert not begins(gap=0.1 * R, closing=R / H, up=-UP), "the lower yarn is the upper one here: they part"
    assert begins(gap=-0.1 * R, closing=-R / H, up=-UP)


@pytest.mark.parametrize("u", [-0.5, 0.5 * INSIDE * R, 2.0, 2.7], ids=["before", "at the start", "at the end", "behind"])
def test_contacts_do_not_begin_beside_a_yarn(u):
    assert not begins(gap=0.0, closing=R / H, u=u)


def test_contacts_begin_on_a_yarn_that_is_given():
    assert begins(gap=0.5 * R, closing=R / H, kinematic=True)


def test_a_contact_that_begins_changes_neither_place_nor_momentum_nor_energy():
    stack = free_weaves(3)
    model, state = stack.model, stack.state
    assign(model, state, 0.1, 0.0, state.u_rate)
    contacts = np.flatnonzero(model.point_kind == PointKind.CONTACT)
    remove(model, state, contacts)
    nodes = model.point_nodes[contacts]
    state.u[nodes] = 0.3  # where they were last seen
    lines = observe.yarn_frame_arrays(model, state)

    def kept():
        return [*observe.momentum(model, state), *observe.energies(model, state, stack.gravity).values()]

    before = kept()
    coming = look(model, state)
    add(model, state, coming, np.ones(len(coming.points), np.bool_))
    np.testing.assert_allclose(kept(), before, rtol=1e-12, atol=1e-14)
    assert state.active[contacts].all() and state.eil[nodes].all()
    np.testing.assert_array_equal(state.anchor[nodes], state.u[nodes])
    for y in range(model.yarn_count):
        own = state.order[model.node_start[y] : model.node_start[y + 1]]
        assert (model.node_yarn[own] == y).all() and (np.diff(state.u[own]) >= 0.0).all()
    drawn = observe.yarn_frame_arrays(model, state)
    assert len(drawn["line_positions"]) == len(lines["line_positions"]) + nodes.size
    assert np.isin(lines["line_points"], drawn["line_points"]).all()


def test_a_contact_is_no_eol_node_until_its_yarns_have_met():
    model, state = cross(gap=0.5 * R, closing=R / H)
    coming = look(model, state)
    add(model, state, coming, np.array([True]))
    nodes = model.point_nodes[coming.points[0]]
    assign(model, state, 0.1, H, state.u_rate)
    assert state.eil[nodes].all()
    state.gap[:] = 0.0
    assign(model, state, 0.1, H, state.u_rate)
    assert not state.eil[nodes].any()
