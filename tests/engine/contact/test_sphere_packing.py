"""Which parts of yarns collide: nothing in flat stacks, everything that comes near from elsewhere."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from engine.contact.sphere_packing import (
    NEAR_CROSSINGS,
    NEAR_RADII,
    SLACK,
    collision_pairs,
    collisions_at_start,
    spheres_of,
)
from engine.scene.build import build
from engine.scene.load import load_scene
from engine.yarns.model import PointKind
from engine.yarns.removal import remove
from engine.yarns.topology import chain_of
from tests.engine.scene.scenes import cloth, rod, scene_of

RADIUS, SPACING, H = 2.25e-3, 5.6e-3, 1e-3
ROUND_OFF = 1e-15  # of distances between places some centimetres from the origin [m]


def built(**parts):
    return build(load_scene(scene_of(contact={"self": True}, **parts)))


def stack(*angles, shift=0.0, size=10):
    """Cloths on each other in one plane."""
    names = [f"layer{k}" for k in range(len(angles))]
    fabrics = [cloth(name, warps=size, wefts=size, position=[k * shift, 0.3 * k * shift, 0.0], rotation=[0, 0, angle])
               for k, (name, angle) in enumerate(zip(names, angles, strict=True))]
    contacts = [{"lower": a, "upper": b} for a, b in pairwise(names)]
    return built(fabrics=fabrics, contacts=contacts)


def pairs_of(made, state=None, h=0.0):
    state = made.state if state is None else state
    chain = chain_of(made.yarns, state.order, state.eil, state.active)
    return collision_pairs(made.collisions, made.yarns, state, chain, h)


def distances(pairs, x):
    return np.linalg.norm(np.einsum("ca,cak->ck", pairs.weight, x[pairs.point]), axis=1)


def touching(pairs, x):
    return distances(pairs, x) < pairs.rest * (1.0 - 1e-9) - ROUND_OFF


def folded(made, radius, at):
    """Bend a strip along y upwards and back over itself in a half circle."""
    x = made.state.x
    s = x[:, 1] - at
    angle = np.clip(s / radius, 0.0, np.pi)
    beyond = np.maximum(s - np.pi * radius, 0.0)
    x[:, 1] = np.where(s < 0.0, x[:, 1], at + radius * np.sin(angle) - beyond)
    x[:, 2] += radius * (1.0 - np.cos(angle))


@settings(deadline=None, max_examples=25)
@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=4), st.floats(0.0, 0.002))
def test_a_flat_stack_has_nothing_that_collides(angles, shift):
    """Its layers coincide, as the model neglects their thickness, but everywhere they are joined."""
    made = stack(*angles, shift=shift)
    assert len(made.collisions.kept) == 0
    assert not touching(pairs_of(made), made.state.x).any()


@settings(deadline=None, max_examples=25)
@given(st.lists(st.floats(-90.0, 90.0), min_size=1, max_size=4), st.floats(0.0, 0.02))
@example(angles=[0.0, 1.0, 27.0, 1.2146307931041682e-13], shift=0.0)  # distances are round-off there
def test_no_stack_is_torn_apart(angles, shift):
    """Where the layer between does not reach, corners coincide without being joined: they keep what distance they have."""
    made = stack(*angles, shift=shift)
    assert not touching(pairs_of(made), made.state.x).any()


def test_layers_that_part_collide_once_they_are_clear():
    made = stack(0, 10)
    model, state = made.yarns, made.state
    contacts = np.flatnonzero(model.point_kind == PointKind.CONTACT)
    remove(model, state, contacts)
    state.parting[contacts] = True
    upper = (model.fabric[model.node_yarn[model.point_nodes[:, 0]]] == 1) & (model.point_kind != PointKind.CONTACT)
    lift = np.where(upper, 1.0, 0.0)
    flat = state.x.copy()
    for height, close in ((0.5, 0), (1.9, 0), (2.05, 1), (2.1, 1)):
        state.x[:] = flat
        state.x[:, 2] += height * RADIUS * lift
        pairs = pairs_of(made, state)
        assert state.parting[contacts].all() == (not close) and state.parting.any() == (not close)
        assert not touching(pairs, state.x).any()
    np.testing.assert_allclose(pairs.rest, 2.0 * RADIUS)
    assert (upper[pairs.point[:, :2]].all(axis=1) != upper[pairs.point[:, 2:]].all(axis=1)).all(), "one of each layer"
    assert len(set(pairs.point.ravel())) > 0.95 * np.count_nonzero(state.active), "everywhere"
    state.x[:] = flat
    state.x[:, 2] += 1.5 * RADIUS * lift
    assert touching(pairs_of(made, state), state.x).any(), "they push when the layers come back"


def test_a_cloth_folded_over_itself_touches_itself():
    made = built(fabrics=[cloth(warps=4, wefts=30)])
    folded(made, 0.95 * RADIUS, 0.0)
    pairs = pairs_of(made)
    y = np.einsum("ca,ca->c", np.abs(pairs.weight), made.state.x[pairs.point][:, :, 1]) / 2.0
    near = touching(pairs, made.state.x)
    assert near.sum() > 100 and y[near].min() < -0.06, "all along both halves"
    assert (distances(pairs, made.state.x)[near] > 1.5 * RADIUS).all(), "neighbours across the fold are left out"
    np.testing.assert_allclose(pairs.rest, 2.0 * RADIUS)


def test_yarns_that_overlap_at_the_start_keep_their_distance():
    """Two rods that cross without being joined, one radius apart; a third one is far away."""
    rods = [rod("a", points=[[-0.1, 0, 0], [0.1, 0, 0]], segments=8), rod("b", points=[[0, -0.1, RADIUS], [0, 0.1, RADIUS]]),
            rod("c", points=[[-0.1, 0, 0.1], [0.1, 0, 0.1]])]
    made = built(yarns=rods)
    assert made.collisions.overlapping.tolist() == [1] and made.collisions.kept[0] == pytest.approx(RADIUS)
    pairs = pairs_of(made)
    np.testing.assert_allclose(pairs.rest, RADIUS)
    assert (distances(pairs, made.state.x) >= pairs.rest * (1 - 1e-12)).all()


def test_given_yarns_do_not_collide_with_each_other():
    rods = [rod(name, points=[[0, 0, z], [1, 0, z]], kinematic=True) for name, z in (("a", 0.0), ("b", RADIUS))]
    assert len(pairs_of(built(yarns=rods)).rest) == 0


@pytest.mark.parametrize("seed", range(4))
def test_the_search_finds_what_looking_at_every_pair_finds(seed):
    """On a crumpled stack, with distances in the network from a library."""
    made = stack(0, 15, size=6)
    model, state, h = made.yarns, made.state, 1e-3
    rng = np.random.default_rng(seed)
    state.x += rng.normal(scale=4 * RADIUS, size=state.x.shape)
    state.velocity[:] = rng.normal(scale=1.0, size=state.velocity.shape)
    state.active[rng.random(model.point_count) < 0.3] &= model.point_kind[0] == PointKind.CONTACT
    inner = (model.point_kind == PointKind.CONTACT) & (rng.random(model.point_count) < 0.5)
    remove(model, state, np.flatnonzero(inner))
    chain = chain_of(model, state.order, state.eil, state.active)
    collisions = collisions_at_start(model, state, 1.0, 1.0, 1.0)
    found = collision_pairs(collisions, model, state, chain, h)
    spheres = spheres_of(collisions, model, state, chain, h)
    expected = set()
    near, beside = network_distances(model, state), points_beside(model, state, spheres)
    motion = spheres.motion - spheres.motion.mean(axis=0)
    reach = NEAR_RADII * model.radius[0] + NEAR_CROSSINGS * model.crossing_spacing[0]
    for a in range(len(spheres.share)):
        apart = np.linalg.norm(spheres.centre[a] - spheres.centre, axis=1)
        moves = np.linalg.norm(motion[a] - motion, axis=1)
        for b in np.flatnonzero(apart < 2 * RADIUS * (1 + SLACK) + moves):
            ends = model.node_point[spheres.node[a]], model.node_point[spheres.node[b]]
            if b > a and near[np.ix_(beside[a], beside[b])].min() > reach:
                expected.add((*ends[0], *ends[1], round(spheres.share[a], 9), round(spheres.share[b], 9)))
    listed = [(*point, round(weight[1], 9), round(-weight[3], 9))
              for point, weight in zip(found.point.tolist(), found.weight.tolist(), strict=True)]
    assert len(set(listed)) == len(listed) > 50 and set(listed) == expected


def points_beside(model, state, spheres):
    """Points of the last node before and the first behind each sphere, whatever their kind."""
    found = []
    for (i, j), share in zip(spheres.node, spheres.share, strict=True):
        y, here = model.node_yarn[i], state.u[i] + share * (state.u[j] - state.u[i])
        own = [n for n in state.order[model.node_start[y] : model.node_start[y + 1]] if state.active[model.node_point[n]]]
        own = own[own.index(i) : own.index(j) + 1]
        last = max(k for k, n in enumerate(own[:-1]) if k == 0 or state.u[n] <= here)
        found.append(model.node_point[[own[last], own[last + 1]]])
    return np.array(found)


def network_distances(model, state):
    """Length along yarns between all points."""
    order = state.order[state.active[model.node_point[state.order]]]
    i, j = order[:-1], order[1:]
    along = model.node_yarn[i] == model.node_yarn[j]
    i, j = i[along], j[along]
    ends = model.node_point[i], model.node_point[j]
    length = np.maximum(state.u[j] - state.u[i], 1e-12)
    graph = coo_matrix((length, ends), shape=(model.point_count,) * 2)
    return dijkstra(graph.tocsr(), directed=False)


def test_an_edge_couples_each_pair_of_points_once():
    made = built(fabrics=[cloth(warps=4, wefts=30)])
    folded(made, 0.95 * RADIUS, 0.0)
    pairs = pairs_of(made)
    coupled = {tuple(pair) for pair in pairs.coupled(made.yarns.point_count).tolist()}
    wanted = {(min(a, b), max(a, b)) for four in pairs.point.tolist() for a in four for b in four if a != b}
    assert coupled == wanted
