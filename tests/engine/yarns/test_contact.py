"""What surrounds the energy of EIL contacts: places of interpolated points."""

import numpy as np
import pytest

from engine.yarns import contact
from tests.engine.yarns.stacks import random_stack

EVERY_SEED = pytest.mark.parametrize("seed", range(3))


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
