"""How points follow their fabrics: along both where two slide on each other, unmoved where held, bounded where parallel."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.linalg.block_matrix import BLOCK
from engine.yarns import constraints, friction_circle
from engine.yarns.assembly import YarnAssembly
from engine.yarns.fabric_motion import RIDGE, fabrics_at, responses
from engine.yarns.model import PointKind
from tests.engine.yarns.stacks import GRAVITY, MATERIAL, NO_OBSTACLES, UP, Stack, random_stack

SEEDS = pytest.mark.parametrize("seed", range(6))
VECTORS = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)
STRETCHES = st.floats(0.5, 2.0)
RANDOM = np.random.default_rng(0).normal(size=(2, 3))  # displacements of two fabrics


def responses_of(stack):
    """The fabrics and responses of all points, and the slopes w of both yarns at those of two fabrics [P, 2, 3]."""
    model, state, chain = stack.model, stack.state, stack.chain
    fabrics, slope = fabrics_at(model), np.zeros((model.node_count, 3))
    friction_circle.slopes(np.flatnonzero(fabrics[:, 1] >= 0), model.point_nodes, state.eil, chain.before, chain.after,
                           model.node_point, state.x, state.u, slope)
    projector, every = constraints.projectors(model, state), np.arange(model.point_count)
    return fabrics, responses(model, state, chain, fabrics, projector, every), slope[model.point_nodes]


def followed(response, of_a, of_b):
    """What the unknowns of a point, or of several, do where their fabrics move by these displacements."""
    return response[..., 0, :, :] @ of_a + response[..., 1, :, :] @ of_b


def contact_at(angle, stretch_a=1.0, stretch_b=1.0):
    """Two yarns of two fabrics that touch at an angle: the response of their contact, and the slopes of both."""
    yarns = YarnAssembly()
    along = np.array([[1.0, 0.0, 0.0], [np.cos(angle), np.sin(angle), 0.0]]) * [[stretch_a], [stretch_b]]
    a, b = (yarns.yarn(MATERIAL, 2.0, 1.0, fabric) for fabric in (0, 1))
    for yarn, w in ((a, along[0]), (b, along[1])):
        yarns.lagrangian(yarn, 0.0, -w)
        yarns.lagrangian(yarn, 2.0, w)
    point = yarns.crossing(a, 1.0, b, 1.0, np.zeros(3), UP, kind=PointKind.CONTACT)
    _, response, slope = responses_of(Stack(*yarns.build(), NO_OBSTACLES, GRAVITY))
    np.testing.assert_allclose(slope[point], along, atol=1e-12)
    return response[point], along


def ridge_of(slope):
    return RIDGE * np.sum(slope * slope)


@SEEDS
def test_contacts_have_two_fabrics_and_all_else_has_one(seed):
    model = random_stack(seed).model
    fabrics, contact = fabrics_at(model), model.point_kind == PointKind.CONTACT
    first, second = (model.fabric[model.node_yarn[nodes]] for nodes in model.point_nodes.T)
    two = contact & (first != second)
    assert two.any() and not two.all()
    np.testing.assert_array_equal(fabrics[:, 0], first + 1)  # numbers from 0, which single yarns have
    np.testing.assert_array_equal(fabrics[:, 1], np.where(two, second + 1, -1))


def test_fabrics_alone_are_numbered_from_zero():
    yarns = YarnAssembly()
    for fabric in (0, 1):
        yarns.lagrangian(yarns.yarn(MATERIAL, 1.0, 1.0, fabric), 0.0, np.zeros(3))
        yarns.lagrangian(fabric, 1.0, UP)
    assert fabrics_at(yarns.build()[0]).tolist() == [[0, -1], [0, -1], [1, -1], [1, -1]]


@SEEDS
def test_points_of_one_fabric_follow_it_with_u_unmoved(seed):
    stack = random_stack(seed)
    fabrics, response, _ = responses_of(stack)
    alone = fabrics[:, 1] < 0
    free = constraints.projectors(stack.model, stack.state)[:, :3, :3]
    moved = followed(response, *RANDOM)[alone]
    np.testing.assert_allclose(moved[:, :3], free[alone] @ RANDOM[0], atol=1e-6)
    assert not moved[:, 3:].any()


@SEEDS
def test_what_is_held_stays(seed):
    stack = random_stack(seed)
    free = constraints.projectors(stack.model, stack.state)
    moved = followed(responses_of(stack)[1], *RANDOM)
    np.testing.assert_allclose(np.einsum("pij,pj->pi", free, moved), moved, atol=1e-6)
    held = (free == 0.0).all(axis=2)
    assert held.any() and not moved[held].any()


def two_free(stack):
    """The responses and slopes at points of two fabrics at which nothing is held."""
    fabrics, response, slope = responses_of(stack)
    free = (constraints.projectors(stack.model, stack.state) == np.eye(BLOCK)).all(axis=(1, 2))
    at = (fabrics[:, 1] >= 0) & free
    assert at.any()
    return response[at], slope[at]


@SEEDS
def test_points_of_two_fabrics_move_along_both(seed):
    for response, (w_a, w_b) in zip(*two_free(random_stack(seed)), strict=True):
        within = np.column_stack([w_a, -w_b])
        slid = np.array([0.3, -0.7])
        d_a, d_b = RANDOM[0], RANDOM[0] + within @ slid  # which a slide of both yarns takes up
        q = followed(response, d_a, d_b)
        left = ridge_of(np.array([w_a, w_b])) / np.linalg.svd(within, compute_uv=False)[-1] * np.linalg.norm(slid)
        assert np.linalg.norm(q[:3] - d_a - w_a * q[3]) <= 0.5 * left + 1e-6
        assert np.linalg.norm(q[:3] - d_b - w_b * q[4]) <= 0.5 * left + 1e-6


@SEEDS
def test_fabrics_that_move_together_take_their_contacts_along(seed):
    response, _ = two_free(random_stack(seed))
    moved = followed(response, RANDOM[0], RANDOM[0])
    np.testing.assert_allclose(moved[:, :3], np.tile(RANDOM[0], (len(moved), 1)), atol=1e-6)
    np.testing.assert_allclose(moved[:, 3:], 0.0, atol=1e-5)


@settings(deadline=None, max_examples=30)
@given(angle=st.floats(0.5, np.pi - 0.5), stretch_a=STRETCHES, stretch_b=STRETCHES, d_a=VECTORS, d_b=VECTORS)
def test_in_the_normal_direction_the_point_moves_by_the_mean_of_both(angle, stretch_a, stretch_b, d_a, d_b):
    response, (w_a, w_b) = contact_at(angle, stretch_a, stretch_b)
    q = followed(response, d_a, d_b)
    assert q[2] == pytest.approx(0.5 * (d_a[2] + d_b[2]), abs=1e-6)
    only_normal = followed(response, d_a * UP, d_b * UP)
    np.testing.assert_allclose(only_normal[[0, 1, 3, 4]], 0.0, atol=1e-6)
    # and in the plane it moves along both
    left = ridge_of(np.array([w_a, w_b])) / np.linalg.svd(np.column_stack([w_a, w_b]), compute_uv=False)[-1] ** 2
    for d, w, u in ((d_a, w_a, q[3]), (d_b, w_b, q[4])):
        assert np.linalg.norm((q[:3] - d - w * u)[:2]) <= 0.5 * left * np.linalg.norm((d_b - d_a)[:2]) + 1e-6


@pytest.mark.parametrize(("side", "sign"), [(0, -1.0), (1, 1.0)], ids=["A", "B"])
def test_a_fabric_that_slides_along_the_other_moves_one_coordinate_only(side, sign):
    response, _ = contact_at(0.5 * np.pi)
    along_a, along_b = response[side] @ [1.0, 0.0, 0.0], response[side] @ [0.0, 1.0, 0.0]
    unridged = 1.0 / (1.0 + 2.0 * RIDGE)
    np.testing.assert_allclose(along_a[3:], [sign * unridged, 0.0], atol=1e-6)
    np.testing.assert_allclose(along_b[3:], [0.0, -sign * unridged], atol=1e-6)


@settings(deadline=None, max_examples=30)
@given(angle=st.floats(-1e-3, 1e-3), stretch_a=STRETCHES, stretch_b=STRETCHES, d_a=VECTORS, d_b=VECTORS)
def test_parallel_yarns_do_not_slide_without_bounds(angle, stretch_a, stretch_b, d_a, d_b):
    response, slope = contact_at(angle, stretch_a, stretch_b)
    slid = followed(response, d_a, d_b)[3:]
    assert np.linalg.norm(slid) <= 0.5 / np.sqrt(ridge_of(slope)) * np.linalg.norm(d_b - d_a) + 1e-6
