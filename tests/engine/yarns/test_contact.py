"""What surrounds the energy of EIL contacts: jumps of gaps at new assignments, places of interpolated points."""

from dataclasses import replace

import numpy as np
import pytest

from engine.yarns import contact
from tests.engine.yarns.stacks import SETTINGS, H, random_stack

EVERY_SEED = pytest.mark.parametrize("seed", range(3))


def gap_at_start(stack):
    """What the constraint of the next step sees at its start, before offsets have faded."""
    potential = stack.potential(replace(SETTINGS, transition_time=1e9 * H))
    potential.internal(stack.state.x, stack.state.u)
    return potential.split, potential.gap


@EVERY_SEED
def test_the_gap_of_a_constraint_does_not_jump_with_the_assignment(seed):
    stack = random_stack(seed)
    state = stack.state
    before = state.gap - state.gap_offset
    contact.absorb_jumps(stack.model, state, stack.chain)
    split, gap = gap_at_start(stack)
    np.testing.assert_allclose(gap[split], before[split], atol=1e-8)
    assert not np.delete(state.gap_offset, split, axis=0).any()  # what is EoL has no gap that could fade


@EVERY_SEED
def test_points_with_eil_nodes_only_lie_midway_between_their_yarns(seed):
    """The gap of a point is then cut in two by it."""
    stack = random_stack(seed)
    model, state, chain = stack.model, stack.state, stack.chain
    points = stack.potential().interpolated
    x = state.x.copy()
    contact.place_eil(points, model.point_nodes, chain.before, chain.after, model.node_point, x, state.u)
    for p in points:
        places = []
        for n in model.point_nodes[p][model.point_nodes[p] >= 0]:
            around = [chain.before[n], chain.after[n]]
            ends = state.x[model.node_point[around]]
            places.append([np.interp(state.u[n], state.u[around], ends[:, k]) for k in range(3)])
        np.testing.assert_allclose(x[p], np.mean(places, axis=0), atol=1e-14)
    others = np.delete(np.arange(len(x)), points)
    np.testing.assert_array_equal(x[others], state.x[others])
