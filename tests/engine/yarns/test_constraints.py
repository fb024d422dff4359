"""Projectors of constrained unknowns."""

import numpy as np
import pytest

from engine.yarns.constraints import projectors
from engine.yarns.model import PointKind
from tests.engine.yarns.stacks import random_stack


@pytest.fixture
def stack():
    """A stack from which two contacts have been removed."""
    stack = random_stack(0)
    stack.state.active[np.flatnonzero(stack.model.point_kind == PointKind.CONTACT)[:2]] = False
    return stack


def test_projectors_are_orthogonal(stack):
    s = projectors(stack.model, stack.state)
    np.testing.assert_allclose(s @ s, s, atol=1e-15)
    np.testing.assert_array_equal(s, s.transpose(0, 2, 1))


def test_every_point_keeps_what_it_may_move(stack):
    """The rank of x and the freedom of both u, point by point."""
    model, state = stack.model, stack.state
    for p, s in enumerate(projectors(model, state)):
        nodes = [n for n in model.point_nodes[p] if n >= 0]
        kind = model.point_kind[p]
        only_eil = all(state.eil[n] for n in nodes) and (len(nodes) == 2 or kind == PointKind.LAGRANGIAN)
        free = 0 if only_eil or not state.active[p] else round(np.trace(model.free_directions[p]))
        assert np.linalg.matrix_rank(s[:3, :3]) == free
        assert not s[:3, 3:].any() and s[3, 4] == 0.0
        for slot in range(2):
            slides = slot < len(nodes) and state.active[p] and not model.u_fixed[nodes[slot]]
            assert s[3 + slot, 3 + slot] == slides


@pytest.mark.parametrize(("kind", "x", "u"), [
    (PointKind.LAGRANGIAN, 3, 0), (PointKind.CROSSING, 3, 2), (PointKind.CONTACT, 3, 2), (PointKind.EYELET, 0, 1),
    (PointKind.STITCH, 3, 0), (PointKind.EDGE, 1, 1)])
def test_degrees_of_freedom_of_eol_points(kind, x, u):
    stack = random_stack(0)
    model, state = stack.model, stack.state
    state.eil[:] = False
    pinned = (model.free_directions == 0.0).all(axis=(1, 2)) & (kind != PointKind.EYELET)
    s = projectors(model, state)[(model.point_kind == kind) & ~pinned]
    np.testing.assert_allclose(np.trace(s[:, :3, :3], axis1=1, axis2=2), x)
    np.testing.assert_array_equal(s[:, 3, 3] + s[:, 4, 4], u)
