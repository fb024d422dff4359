"""Shear of crossings: its law, jamming, and what it holds upright."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.yarns import shear
from tests.engine.yarns.stacks import perturbed, random_stack
from tests.engine.yarns.terms import TERMS, alone, full_hessian
from tests.engine.yarns.test_energies import assert_close, differences

SHEAR = next(term for term in TERMS if term.name == "shear")


def jamming_stack(seed):
    """A random stack whose yarns are so thick that some crossings jam."""
    return random_stack(seed, radius=0.3)


@pytest.mark.parametrize("seed", range(3))
def test_jammed_crossings_have_true_derivatives_and_a_positive_form(seed):
    stack = jamming_stack(seed)
    p, (x, u) = alone(SHEAR, stack.potential()), perturbed(stack, seed)
    limp = alone(SHEAR, stack.potential())
    limp.free_angle = np.full(stack.model.point_count, np.pi)
    assert p.gradient(x, u)[0] > 2.0 * limp.gradient(x, u)[0]  # some jam
    assert_close(p.gradient(x, u)[1].ravel(), differences(lambda x, u: p.gradient(x, u)[0], stack.model, x, u), 1e-5)
    change = differences(lambda x, u: p.gradient(x, u)[1].ravel(), stack.model, x, u)
    assert_close(full_hessian(p, x, u, convex=False), change, 1e-4)
    positive = full_hessian(p, x, u, convex=True)
    assert np.linalg.eigvalsh(positive).min() > -1e-9 * np.abs(positive).max()
    assert np.linalg.eigvalsh(positive - full_hessian(p, x, u, convex=False)).max() > 0.0


@settings(deadline=None)
@given(phi=st.floats(0.01, np.pi - 0.01), free=st.floats(0.0, 1.5))
def test_the_law_is_symmetric_about_the_right_angle_and_twice_differentiable(phi, free):
    step = 1e-6
    ahead, here, back = (shear._law(phi + d, 1.0, free) for d in (step, 0.0, -step))
    scale = max(here[2], 1.0)
    assert (ahead[0] - back[0]) / (2.0 * step) == pytest.approx(here[1], abs=1e-5 * scale)
    assert (ahead[1] - back[1]) / (2.0 * step) == pytest.approx(here[2], abs=1e-2)  # J step^2 at the angle of jamming
    mirrored = shear._law(np.pi - phi, 1.0, free)
    np.testing.assert_allclose(mirrored, [here[0], -here[1], here[2]], rtol=1e-9, atol=1e-9)


def test_only_crossings_within_a_fabric_resist_shear():
    stack = random_stack(0)
    kinds = stack.model.point_kind[shear.sheared(stack.model, stack.state)]
    assert len(kinds) == 8 and (kinds == 1).all()
    limp = random_stack(0, shear_stiffness=0.0)
    assert len(shear.sheared(limp.model, limp.state)) == 0


def test_yarns_jam_where_a_rhombus_of_their_spacing_closes():
    for radius, free in ((0.5, np.pi / 6), (0.9, 0.0)):  # the thicker ones are jammed from the start
        stack = random_stack(0, radius=0.5 * radius)
        points = shear.sheared(stack.model, stack.state)
        np.testing.assert_allclose(shear.free_angle(stack.model)[points], free, atol=1e-12)
