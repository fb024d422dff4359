"""Updates that keep EoL nodes in order."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.steppers.line_search import KEPT_APART, line_search, longest_update
from engine.yarns.model import PointKind
from engine.yarns.topology import chain_of
from tests.engine.yarns.stacks import perturbed, random_stack, straight_yarn, unknowns


@settings(deadline=None)
@given(du=st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4))
def test_every_segment_keeps_some_of_its_material(du):
    model, state = straight_yarn([0.0, 1.0, 1.5, 3.0], PointKind.EYELET)
    chain = chain_of(model, state.order, np.zeros(4, np.bool_), state.active)
    share = longest_update(chain, state.u, np.array(du))
    before, after = np.diff(state.u), np.diff(state.u + share * np.array(du))
    assert 0.0 < share <= 1.0
    assert (after >= (KEPT_APART - 1e-12) * before).all()
    if share < 1.0:
        np.testing.assert_allclose((after / before).min(), KEPT_APART)


def test_a_descent_is_taken_and_an_ascent_refused():
    stack = random_stack(0)
    p, (x, u) = stack.potential(), perturbed(stack, 0)
    energy, gradient = p.gradient(x, u)
    x_new, u_new, energy_new, gradient_new = line_search(p, x, u, energy, gradient, -1e-3 * gradient)
    assert energy_new < energy
    found = p.gradient(x_new, u_new)
    assert found[0] == energy_new
    np.testing.assert_array_equal(found[1], gradient_new)
    step = unknowns(stack.model, x_new - x, u_new - u)
    np.testing.assert_allclose(step / np.abs(step).max(), -gradient / np.abs(gradient).max(), atol=1e-9)
