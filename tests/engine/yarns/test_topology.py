"""Assignment of EoL and EIL nodes, and the chains that follow from it, against slow and obvious versions."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.yarns.model import PointKind
from engine.yarns.topology import assign, chain_of
from tests.engine.yarns.stacks import random_stack, straight_yarn

H = 0.1
SAFETY = 0.1
STAYS, SLIDES, GIVES_WAY = 2, 1, 0  # what a node may be: held at its place, a contact, a mere point of discretisation


PLACES = st.integers(0, 10 * 2**20).map(lambda n: n * 2.0**-20)


@st.composite
def yarns(draw):
    """A yarn of ten rest segments, in any order of nodes, on which all but the ends is drawn.

    All its points lie in one place, so that it is nowhere straighter than elsewhere.
    """
    inner = draw(st.lists(st.tuples(PLACES, st.sampled_from([STAYS, SLIDES, GIVES_WAY])), max_size=12))
    inner.sort()
    u = np.array([0.0, *(place for place, _ in inner), 10.0])
    standing = np.array([STAYS, *(what for _, what in inner), STAYS])
    model, state = straight_yarn(u, kinematic=draw(st.booleans()))
    count = len(u)
    pinned = standing == STAYS
    pinned[[0, -1]] = draw(st.booleans())
    state.x[:] = 0.0
    model = replace(
        model, rest_segment=np.ones(1), u_fixed=standing != SLIDES,
        point_kind=np.where(standing == SLIDES, PointKind.EYELET, PointKind.LAGRANGIAN).astype(np.int64),
        free_directions=np.where(pinned[:, None, None], np.zeros((3, 3)), np.eye(3)))
    state.u_rate = np.where(model.u_fixed, 0.0, draw(st.lists(st.floats(-2.0, 2.0), min_size=count, max_size=count)))
    state.active[1:-1] = draw(st.lists(st.booleans(), min_size=count - 2, max_size=count - 2))
    state.order = np.array(draw(st.permutations(range(count))))
    return model, state, standing


def reference(model, state, standing):
    """Order and EIL flags of one yarn, node by node on lists."""
    order = sorted(state.order, key=lambda i: state.u[i])  # stable
    kept, eil = [], np.zeros(len(order), bool)
    for i in order:
        if not state.active[i]:
            continue
        if model.kinematic[0]:
            eil[i] = standing[i] == SLIDES
            continue
        while kept and apart(state, kept[-1], i) < SAFETY and not eil[i]:
            if standing[i] != STAYS and standing[i] <= standing[kept[-1]]:
                eil[i] = True
            elif standing[kept[-1]] == STAYS:
                break
            else:
                eil[kept.pop()] = True
        if not eil[i]:
            kept.append(i)
    return order, eil


def apart(state, i, j):
    """The distance of two nodes, now or at the end of the step, whichever is less."""
    distances = [state.u[j] - state.u[i], state.u[j] + H * state.u_rate[j] - state.u[i] - H * state.u_rate[i]]
    return min(distances)


def assigned(model, state):
    state = state.copy()
    assign(model, state, SAFETY, H, state.u_rate)
    return state


@settings(deadline=None)
@given(yarns())
def test_the_assignment_is_that_of_the_reference(yarn):
    model, state, standing = yarn
    if model.kinematic[0]:
        standing = np.where(standing == GIVES_WAY, STAYS, standing)
    order, eil = reference(model, state, standing)
    found = assigned(model, state)
    np.testing.assert_array_equal(found.order, order)
    np.testing.assert_array_equal(found.eil, eil)


@settings(deadline=None)
@given(yarns())
def test_rates_that_are_expected_count_as_the_last_ones_do(yarn):
    model, state, _ = yarn
    wanted, rates = assigned(model, state), state.u_rate
    for last, expected in ((rates, 0.0 * rates), (0.0 * rates, rates)):
        found = state.copy()
        found.u_rate = last
        assign(model, found, SAFETY, H, expected)
        np.testing.assert_array_equal(found.eil, wanted.eil)


@settings(deadline=None)
@given(yarns())
def test_nodes_are_sorted_and_ties_keep_their_order(yarn):
    model, state, _ = yarn
    found = assigned(model, state)
    u, was = state.u[found.order], np.argsort(state.order)[found.order]
    assert sorted(found.order) == list(range(model.node_count))
    assert ((np.diff(u) > 0) | ((np.diff(u) == 0) & (np.diff(was) > 0))).all()


@settings(deadline=None)
@given(yarns())
def test_eol_nodes_keep_their_distance_unless_both_must_stay(yarn):
    model, state, standing = yarn
    found = assigned(model, state)
    eol = [i for i in found.order if found.active[i] and not found.eil[i]]
    for i, j in pairwise(eol):
        assert model.kinematic[0] or apart(state, i, j) >= SAFETY or standing[i] == standing[j] == STAYS


@settings(deadline=None)
@given(yarns())
def test_what_must_stay_stays_and_removed_points_are_no_nodes(yarn):
    model, state, standing = yarn
    found = assigned(model, state)
    assert not found.eil[standing == STAYS].any()
    assert not found.eil[~state.active].any()
    chain = chain_of(model, found.order, found.eil, found.active)
    assert set(chain.node) == set(np.flatnonzero(found.active & ~found.eil))
    assert {0, model.node_count - 1} <= set(chain.node)


@settings(deadline=None)
@given(yarns())
def test_a_second_assignment_changes_nothing(yarn):
    model, state, _ = yarn
    once = assigned(model, state)
    twice = assigned(model, once)
    np.testing.assert_array_equal(once.order, twice.order)
    np.testing.assert_array_equal(once.eil, twice.eil)


def test_a_free_coordinate_gives_way_to_a_fixed_one_on_either_side():
    """Of an eyelet next to an end, the eyelet is tagged, whichever comes first along the yarn."""
    model, state = straight_yarn([0.0, 0.02, 0.98, 1.0], PointKind.EYELET)
    model = replace(model, rest_segment=np.ones(1))
    np.testing.assert_array_equal(assigned(model, state).eil, [False, True, True, False])


def test_of_two_contacts_the_second_is_tagged_and_a_discretisation_point_before_either():
    model, state = straight_yarn([0.0, 0.5, 0.55, 0.58, 1.0], PointKind.EYELET)
    model = replace(model, rest_segment=np.ones(1))
    state.x[:] = 0.0
    np.testing.assert_array_equal(assigned(model, state).eil, [False, False, True, True, False])
    model.point_kind[1] = PointKind.LAGRANGIAN
    model.u_fixed[1], model.free_directions[1] = True, np.eye(3)
    np.testing.assert_array_equal(assigned(model, state).eil, [False, True, False, True, False])


@pytest.mark.parametrize(("heights", "tagged"), [((0.2, 0.1), 2), ((0.1, 0.2), 1)])
def test_of_two_contacts_the_one_gives_way_where_the_yarn_is_straighter_and_stays_so(heights, tagged):
    model, state = straight_yarn([0.0, 0.49, 0.51, 1.0], PointKind.EYELET)
    model = replace(model, rest_segment=np.ones(1))
    state.eil[:], state.x[1:3, 2] = False, heights
    once = assigned(model, state)
    assert list(np.flatnonzero(once.eil)) == [tagged]
    once.x[1:3, 2] = heights[::-1]
    np.testing.assert_array_equal(assigned(model, once).eil, once.eil)


def test_nodes_that_close_in_count_as_nearer():
    model, state = straight_yarn([0.0, 0.4, 0.6, 1.0], PointKind.EYELET)
    model = replace(model, rest_segment=np.ones(1))
    assert not assigned(model, state).eil.any()
    state.u_rate = np.array([0.0, 0.6, -0.6, 0.0])
    np.testing.assert_array_equal(assigned(model, state).eil, [False, False, True, False])
    state.u_rate *= -1.0
    assert not assigned(model, state).eil.any()


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 1000), removed=st.sets(st.integers(0, 200)))
def test_chains_link_every_active_node_to_its_nearest_eol_nodes(seed, removed):
    stack = random_stack(seed)
    model, state = stack.model, stack.state
    contacts = np.flatnonzero(model.point_kind == PointKind.CONTACT)
    state.active[[p for p in contacts if p in removed]] = False
    assign(model, state, SAFETY, H, state.u_rate)
    chain = chain_of(model, state.order, state.eil, state.active)
    for y in range(model.yarn_count):
        order = state.order[model.node_start[y] : model.node_start[y + 1]]
        order = [i for i in order if state.active[model.node_point[i]]]
        assert list(chain.node[chain.start[y] : chain.start[y + 1]]) == [i for i in order if not state.eil[i]]
        for k, i in enumerate(order):
            assert chain.before[i] == next((j for j in reversed(order[:k]) if not state.eil[j]), -1)
            assert chain.after[i] == next((j for j in order[k + 1 :] if not state.eil[j]), -1)
    gone = ~state.active[model.node_point]
    assert (chain.before[gone] == -1).all() and (chain.after[gone] == -1).all()
