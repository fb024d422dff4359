"""Which neighbours in a weave touch, how near they may come, and that they do not pass each other."""

from dataclasses import replace

import numpy as np
import pytest

from engine.geometry.handles import Handles
from engine.steppers.yarns import YarnStepper
from engine.yarns import parallel_contact
from engine.yarns.assembly import YarnAssembly
from engine.yarns.model import PointKind
from engine.yarns.settings import YarnSettings
from engine.yarns.topology import chain_of
from tests.engine.yarns.stacks import MATERIAL, NO_OBSTACLES, UP, random_stack

PLAIN, BASKET = "udu", "uud"  # whether the first weft lies under or over each of the warps
THICK, THIN = 0.2, 0.05


def weave(pattern=PLAIN, radius=THICK, cloth=True, contact=False, bend=0.0):
    """Three warps, held, and three wefts, spacing 1, folded along x = 1.5 by `bend`; maybe a stray rod on the first weft.

    A handle holds the first weft.
    """
    yarns, material = YarnAssembly(), replace(MATERIAL, radius=radius, stretch_stiffness=200.0)
    warp, weft = ([yarns.yarn(material, 3.0, 1.0, 0 if cloth else -1) for _ in range(3)] for _ in range(2))

    def place(x, y):
        return np.array([x, y, -bend * abs(x - 1.5)])

    for k in range(3):
        for end in (0.0, 3.0):
            yarns.lagrangian(warp[k], end, place(k + 0.5, end), pinned=True)
            yarns.lagrangian(weft[k], end, place(end, k + 0.5), pinned=k == 0, handle=-(k != 0))
        for j in range(3):
            x, y = k + 0.5, j + 0.5
            weft_below = (pattern[k] == "u") == (j % 2 == 0)
            crossed = (weft[j], x, warp[k], y) if weft_below else (warp[k], y, weft[j], x)
            yarns.crossing(*crossed, place(x, y), UP)
    if contact:
        stray = yarns.yarn(material, 1.0, 1.0, 1)
        for end in (0.0, 1.0):
            yarns.lagrangian(stray, end, place(1.0, end))
        yarns.crossing(weft[0], 1.0, stray, 0.5, place(1.0, 0.5), UP, kind=PointKind.CONTACT)
    return *yarns.build(), warp, weft


def distances(model, state):
    """What d_min is between successive crossings of each yarn, by the yarn and the places of both."""
    chain = chain_of(model, state.order, state.eil, state.active)
    pair, distance = parallel_contact.touching_pairs(model, state, chain)
    assert (model.node_yarn[pair[:, 0]] == model.node_yarn[pair[:, 1]]).all()
    return {(model.node_yarn[i], *np.round(state.u[[i, j]], 9)): d for (i, j), d in zip(pair, distance, strict=True)}


def test_every_pair_of_neighbours_of_a_plain_weave_touches():
    found = distances(*weave()[:2])
    assert len(found) == 12
    np.testing.assert_allclose(list(found.values()), 4 * THICK)


def test_a_weave_at_rest_is_free_of_force_however_thick():
    found = distances(*weave(radius=0.4)[:2])
    np.testing.assert_allclose(list(found.values()), parallel_contact.SHARE)


def test_neighbours_on_one_side_come_nearer():
    model, state, _, weft = weave(BASKET)
    found = distances(model, state)
    assert found[weft[0], 0.5, 1.5] == pytest.approx(2 * THICK)
    assert found[weft[0], 1.5, 2.5] == pytest.approx(4 * THICK)


def test_what_does_not_bend_around_a_yarn_may_pass_on_its_other_side():
    """Rule (b): thin yarns hardly leave the plane; those on one side still touch."""
    assert len(distances(*weave(radius=THIN)[:2])) == 0
    found = distances(*weave(BASKET, radius=THIN)[:2])
    assert found and all(np.isclose(d, 2 * THIN) for d in found.values())


def test_a_fold_bends_yarns_around_those_that_lie_in_it():
    model, state, warp, _ = weave(radius=THIN, bend=1.0)
    found = distances(model, state)  # along the ridge the wefts bend around the warp where they lie on it
    assert set(found) == {(warp[1], 0.5, 1.5), (warp[1], 1.5, 2.5)}


def test_contacts_with_others_are_passed_over():
    """Rule (a)."""
    assert distances(*weave(contact=True)[:2]) == distances(*weave()[:2])


def test_single_yarns_touch_nowhere():
    assert distances(*weave(cloth=False)[:2]) == {}


@pytest.mark.parametrize("seed", range(3))
def test_pairs_follow_each_other_among_the_crossings_of_their_yarn(seed):
    stack = random_stack(seed)
    m, s = stack.model, stack.state
    pair, _ = parallel_contact.touching_pairs(m, s, stack.chain)
    woven = m.point_kind[m.node_point] == PointKind.CROSSING
    for i, j in pair:
        between = woven & (m.node_yarn == m.node_yarn[i]) & (s.u >= s.u[i]) & (s.u <= s.u[j])
        assert set(np.flatnonzero(between)) == {i, j}


def test_pairs_that_are_far_apart_or_part_are_out_of_reach():
    pair, distance, u = np.array([[0, 1]]), np.array([0.8]), np.array([0.0, 1.0])
    for u_rate, reached in (([0.0, 0.0], False), ([1.0, 0.0], True), ([0.0, 1.0], False)):
        assert parallel_contact.within_reach(pair, distance, u, np.array(u_rate), 0.1) == reached
    assert parallel_contact.within_reach(pair, distance, 0.85 * u, np.zeros(2), 0.1)


@pytest.mark.parametrize("factor", [0.0, 1.0], ids=["off", "on"])
def test_a_yarn_that_is_moved_pushes_its_neighbour(factor):
    model, state, warp, _ = weave()
    moves = Handles(np.array([0, 2]), np.array([0.0, 4.0]), np.array([[0.0, 0, 0], [0.0, 0.9, 0.0]]))
    stepper = YarnStepper(model, YarnSettings(parallel_factor=factor), -0.1 * UP, NO_OBSTACLES, moves)
    on_warp = model.point_nodes[np.isin(model.point_kind, PointKind.CROSSING)]
    on_warp = on_warp[np.isin(model.node_yarn[on_warp], warp)]
    nearest = np.inf
    for n in range(80):
        report = stepper.step(state, 0.05 * n, 0.05)
        assert report.accepted, report.reason
        for yarn in warp:
            here = on_warp[model.node_yarn[on_warp] == yarn]
            nearest = min(nearest, np.diff(state.u[here]).min())
    assert (nearest > 0.7) if factor else (nearest < 0.2)
