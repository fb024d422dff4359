"""Updates that keep EoL nodes in order."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.steppers.line_search import KEPT_APART, ON_TREND, line_search, longest_update
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


@settings(deadline=None, max_examples=20)
@given(length=st.floats(1e-9, 1e-4), seed=st.integers(0, 2))
def test_further_steps_end_where_twice_the_way_would_gain_next_to_nothing(length, seed):
    """And what the potential keeps, as the gaps, is of the place that is returned."""
    stack = random_stack(seed)
    p, (x, u) = stack.potential(), perturbed(stack, seed)
    energy, gradient = p.gradient(x, u)
    direction = -length * gradient
    near = line_search(p, x, u, energy, gradient, direction)
    x_far, u_far, energy_far, gradient_far = line_search(p, x, u, energy, gradient, direction, further=True)
    gap = p.gap.copy()
    assert energy_far <= near[2]
    found = p.gradient(x_far, u_far)
    assert found[0] == energy_far
    np.testing.assert_array_equal(found[1], gradient_far)
    np.testing.assert_array_equal(p.gap, gap)
    beyond = x + 2.0 * (x_far - x), u + 2.0 * (u_far - u)
    in_reach = longest_update(p.chain, u, 2.0 * (u_far - u)) == 1.0
    times = np.linalg.norm(x_far - x) / np.linalg.norm(direction[:, :3])
    least_gain = ON_TREND * times * -np.sum(gradient * direction)
    assert times < 1.0 or not in_reach or p.gradient(*beyond)[0] > energy_far - (1.0 + 1e-9) * least_gain
