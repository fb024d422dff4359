"""What is read off a state, against sums over segments written out."""

from dataclasses import replace

import numpy as np
import pytest

from engine.yarns import observe
from engine.yarns.model import NodeState, PointKind
from tests.engine.yarns.stacks import GRAVITY, MATERIAL, random_stack, straight_yarn


def test_a_straight_yarn_that_flies():
    model, state = straight_yarn([0.0, 0.5, 1.5, 2.0])
    state.velocity[:] = speed = np.array([1.0, -2.0, 3.0])
    mass = MATERIAL.density * 2.0
    np.testing.assert_allclose(observe.momentum(model, state), mass * speed)
    energies = observe.energies(model, state, GRAVITY)
    assert energies["kinetic"] == pytest.approx(0.5 * mass * speed @ speed)
    assert energies["potential"] == pytest.approx(-mass * GRAVITY @ [1.0, 0.0, 0.0])


def test_a_yarn_that_turns():
    """A rod of length L and angular velocity w about its end has the kinetic energy m L^2 w^2 / 6."""
    model, state = straight_yarn([0.0, 0.5, 1.5, 2.0])
    state.velocity[:] = np.cross([0.0, 0.0, 3.0], state.x)[:, None]
    assert observe.energies(model, state, GRAVITY)["kinetic"] == pytest.approx(MATERIAL.density * 2.0 * 4.0 * 9.0 / 6.0)


def test_a_stretched_yarn():
    model, state = straight_yarn([0.0, 0.5, 1.5, 2.0])
    state.x *= 1.1
    assert observe.energies(model, state, np.zeros(3))["potential"] == pytest.approx(
        0.5 * MATERIAL.stretch_stiffness * 2.0 * 0.1**2)
    np.testing.assert_allclose(observe.strain(model, state), 0.1)


def test_counts_tell_every_point_that_is_left():
    stack = random_stack(0)
    model, state = stack.model, stack.state
    state.active[np.flatnonzero(model.point_kind == PointKind.CONTACT)[0]] = False
    counts = observe.counts(model, state)
    states = observe.node_states(model, state)
    assert counts["eil"] == np.isin(states, (NodeState.EOL_EIL, NodeState.EIL_EIL)).sum()
    assert counts["eol_intra"] == np.isin(model.point_kind, (PointKind.CROSSING, PointKind.STITCH)).sum()
    outer = np.isin(model.point_kind, (PointKind.CONTACT, PointKind.EYELET, PointKind.EDGE))
    assert counts["eol_inter"] == outer.sum() - 1


def test_seams_count_between_fabrics_and_stitches_of_one_fabric_within():
    stack = random_stack(0)
    model, state = stack.model, stack.state
    (stitch,) = np.flatnonzero(model.point_kind == PointKind.STITCH)
    before = observe.counts(model, state)
    fabric = model.fabric.copy()
    fabric[model.node_yarn[model.point_nodes[stitch, 1]]] = 7
    after = observe.counts(replace(model, fabric=fabric), state)
    assert (after["eol_intra"], after["eol_inter"]) == (before["eol_intra"] - 1, before["eol_inter"] + 1)


def test_frames_hold_every_node_and_every_point_that_is_left():
    """EIL nodes lie on the straight piece between the EoL nodes beside them, at their u."""
    stack = random_stack(0)
    model, state = stack.model, stack.state
    state.active[np.flatnonzero(model.point_kind == PointKind.CONTACT)[0]] = False
    assert state.eil.any()
    frame = observe.yarn_frame_arrays(model, state)
    strain = dict(zip(observe.chain_now(model, state).node, observe.strain(model, state), strict=True))
    assert len(frame["line_offsets"]) == model.yarn_count + 1
    for y in range(model.yarn_count):
        order = state.order[model.node_start[y] : model.node_start[y + 1]]
        nodes = order[state.active[model.node_point[order]]]
        line = slice(frame["line_offsets"][y], frame["line_offsets"][y + 1])
        np.testing.assert_array_equal(frame["line_points"][line], model.node_point[nodes])
        eol = nodes[~state.eil[nodes]]
        places = [np.interp(state.u[nodes], state.u[eol], state.x[model.node_point[eol], axis]) for axis in range(3)]
        np.testing.assert_allclose(frame["line_positions"][line], np.stack(places, axis=1), rtol=1e-6, atol=1e-6)
        strains = np.interp(state.u[nodes], state.u[eol], [strain[node] for node in eol])
        np.testing.assert_allclose(frame["line_strain"][line], strains, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(frame["node_points"], np.flatnonzero(state.active))
    np.testing.assert_array_equal(frame["node_positions"], state.x[state.active].astype(np.float32))
    assert frame["node_states"].dtype == np.uint8 and frame["node_states"].max() < NodeState.REMOVED


@pytest.mark.parametrize(("reach", "dtype"), [(0.5, np.float32), (1e4, np.float64)])
def test_frames_round_lengths_only_where_that_is_far_below_a_radius(reach, dtype):
    model, state = straight_yarn([0.0, 0.5, 1.5, 2.0])
    state.x[:] *= reach / np.abs(state.x).max()
    frame = observe.yarn_frame_arrays(model, state)
    assert frame["line_positions"].dtype == frame["node_positions"].dtype == dtype
    error = np.abs(frame["line_positions"] - state.x[frame["line_points"]]).max()
    assert error <= 1e-3 * model.radius.min()
