"""Eulerian coordinates at switches: each is the best of its interval, and the forms of Appendix A agree."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from engine.yarns.transition import entering_eil, entering_eil_by_angle, entering_eil_by_material, entering_eol

PLACES = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)
SAMPLES = np.linspace(0.0, 1.0, 101)


def apart(*places):
    return all(np.linalg.norm(p - q) > 0.1 for p, q in pairwise(places))


@settings(deadline=None)
@given(PLACES, PLACES, PLACES)
def test_a_node_that_turns_eol_is_stretched_alike_on_both_sides(x_a, x_b, x_c):
    assume(apart(x_a, x_b, x_c))
    u = entering_eol(x_a, x_b, x_c, 2.0, 5.0)
    assert 2.0 < u < 5.0
    assert np.linalg.norm(x_b - x_a) / (u - 2.0) == pytest.approx(np.linalg.norm(x_c - x_b) / (5.0 - u))


@settings(deadline=None)
@given(PLACES, PLACES, PLACES)
def test_a_node_that_turns_eil_lands_nearest_to_where_it_was(x_a, x_b, x_c):
    assume(apart(x_a, x_c))
    share = (entering_eil(x_a, x_b, x_c, 2.0, 5.0) - 2.0) / 3.0
    distance = np.linalg.norm(x_a + np.append(share, SAMPLES)[:, None] * (x_c - x_a) - x_b, axis=1)
    assert 0.0 <= share <= 1.0
    assert distance[0] <= distance[1:].min() + 1e-12


@settings(deadline=None)
@given(PLACES, PLACES, PLACES, st.floats(0.5, 2.0))
def test_the_forms_of_the_appendix_agree(x_a, x_b, x_c, stretch):
    """By places, by lengths and angle, and from u alone where both segments are stretched alike."""
    assume(apart(x_a, x_b, x_c, x_a))
    t, s = x_b - x_a, x_c - x_b
    ab, bc = np.linalg.norm(t), np.linalg.norm(s)
    u_a, u_b, u_c = 2.0, 2.0 + ab / stretch, 2.0 + (ab + bc) / stretch
    by_places = entering_eil(x_a, x_b, x_c, u_a, u_c)
    assert entering_eil_by_angle(ab, bc, t @ s / (ab * bc), u_a, u_c) == pytest.approx(by_places)
    assert entering_eil_by_material(u_a, u_b, u_c, t @ s / (ab * bc)) == pytest.approx(by_places)


def test_where_all_is_in_one_place_the_middle_is_taken():
    assert entering_eol(np.ones(3), np.ones(3), np.ones(3), 2.0, 5.0) == 3.5
    assert entering_eil(np.ones(3), np.ones(3), np.ones(3), 2.0, 5.0) == 3.5
