"""Appendix A as functions and as it acts on the nodes of a yarn."""

import numpy as np
import pytest

from engine.yarns.assembly import YarnAssembly, YarnMaterial
from engine.yarns.topology import assign, chain_of
from engine.yarns.transition import entering_eil, entering_eol, settle_switched

A, B, C = np.array([-0.3, 0.0, 0.0]), np.array([0.0, 0.2, 0.0]), np.array([0.8, 0.1, 0.0])


@pytest.mark.parametrize("formula", [entering_eol, entering_eil])
def test_the_direction_in_which_u_counts_makes_no_difference(formula):
    there, back = formula(A, B, C, 0.0, 1.0), formula(C, B, A, 1.0, 0.0)
    assert there == pytest.approx(back, abs=1e-15)


@pytest.mark.parametrize("beyond, end", [(C + (C - A), 1.0), (A - (C - A), 0.0)])
def test_a_node_that_turns_eil_stays_between_its_neighbours(beyond, end):
    assert entering_eil(A, beyond, C, 0.0, 1.0) == end


def test_places_that_coincide_put_u_in_the_middle():
    assert entering_eol(A, A, A, 0.0, 1.0) == entering_eil(A, A, A, 0.0, 1.0) == 0.5


def held_rod(*u: float):
    """A rod from A over B to C through eyelets at B, all with their anchors 0.01 behind."""
    assembly = YarnAssembly()
    rod = assembly.yarn(YarnMaterial(radius=1e-3, density=0.01, stretch_stiffness=100.0), 1.0, 1.0)
    assembly.lagrangians(rod, [0.0, 1.0], [A, C])
    for place in u:
        assembly.eyelet(rod, place, B)
    model, state = assembly.build()
    state.anchor -= 0.01
    return model, state


def switch(model, state, distance: float):
    """Assign nodes at a safety distance and settle those that switch."""
    was_eil = state.eil.copy()
    assign(model, state, distance, h=1.0)
    settle_switched(model, state, was_eil, chain_of(model, state.order, state.eil, state.active), distance)


def test_nodes_that_switch_take_their_anchors_along():
    model, state = held_rod(0.6)
    switch(model, state, distance=0.95)
    assert state.u[1] == entering_eil(A, B, C, 0.0, 1.0)
    switch(model, state, distance=0.01)
    assert state.u[1] == entering_eol(A, B, C, 0.0, 1.0)
    np.testing.assert_allclose(state.anchor, state.u - 0.01, rtol=0, atol=1e-15)


def test_nodes_that_do_not_switch_and_ends_stay():
    model, state = held_rod(0.6)
    before = state.copy()
    switch(model, state, distance=0.01)
    assert np.array_equal(state.u, before.u) and np.array_equal(state.anchor, before.anchor)
    switch(model, state, distance=0.95)
    assert state.u[0] == 0.0 and state.u[2] == 1.0


def test_a_node_that_turns_eol_keeps_the_safety_distance():
    model, state = held_rod(0.6)
    switch(model, state, distance=0.95)
    state.x[2] = A + 1e-3 * (B - A)  # equal stretch would put it a thousandth from the end
    switch(model, state, distance=0.1)
    assert not state.eil.any() and state.u[1] == pytest.approx(0.1)


def test_neighbours_that_turn_eol_together_stay_in_order():
    model, state = held_rod(0.3, 0.6)
    switch(model, state, distance=0.95)
    state.u[1:3] = 0.3, 0.6
    switch(model, state, distance=0.1)
    assert not state.eil.any() and (np.diff(state.u) >= 0.1 - 1e-15).all()
