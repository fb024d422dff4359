"""Crimp: where centre lines pass, what makes a weave with crimp free of tension, and what costs nothing without it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine.geometry.handles import no_handles
from engine.steppers.yarns import YarnStepper
from engine.yarns import observe
from engine.yarns.assembly import YarnAssembly
from engine.yarns.crimp import centre_lines
from engine.yarns.model import PointKind
from engine.yarns.settings import YarnSettings
from tests.engine.yarns.stacks import MATERIAL, NO_OBSTACLES, UP, random_stack

TURNS = st.tuples(*[st.floats(-np.pi, np.pi)] * 3).map(Rotation.from_rotvec)
YARNS = 3  # of each family


def plain_weave(radii=(0.1, 0.2), spacings=(1.0, 0.8), turn=None, crimp=True, slack=1.0, set_as_woven=False,
                repeat=2):
    """A plain weave in the plane across `turn` of UP, the ends half a spacing behind the crossings.

    It is a twill where `repeat` is 4. `spacings` are those of the crossings along warps and wefts, `radii` those of warps and
    wefts; `slack` is the length of yarns over that of their lines.
    """
    yarns, turn = YarnAssembly(), turn or Rotation.identity()
    families = [[yarns.yarn(replace(MATERIAL, radius=radius), slack * YARNS * spacing, spacing, fabric=0) for _ in range(YARNS)]
                for radius, spacing in zip(radii, spacings, strict=True)]
    at = [(np.arange(YARNS) + 0.5) * spacing for spacing in spacings]
    for i in range(YARNS):
        for j in range(YARNS):
            below, above = (families[0][i], slack * at[0][j]), (families[1][j], slack * at[1][i])
            if (i + j) % repeat >= repeat // 2:
                below, above = above, below
            yarns.crossing(*below, *above, turn.apply([at[1][i], at[0][j], 0.0]), turn.apply(UP), crimp=crimp,
                           set_as_woven=set_as_woven)
    for k in range(YARNS):
        for end in (0.0, 1.0):
            warp, weft = (end * YARNS * spacing for spacing in spacings)
            yarns.lagrangian(families[0][k], slack * warp, turn.apply([at[1][k], warp, 0.0]))
            yarns.lagrangian(families[1][k], slack * weft, turn.apply([weft, at[0][k], 0.0]))
    return yarns.build()


def centres(model, state):
    """Where the centre of every node is, shape [N, 3]."""
    lines = centre_lines(model, state, observe.chain_now(model, state))
    return lines.through(state.x, state.u)[lines.place]


@settings(deadline=None, max_examples=20)
@given(turn=TURNS, radii=st.tuples(*[st.floats(0.01, 0.3)] * 2), spacings=st.tuples(*[st.floats(0.5, 2.0)] * 2),
       slack=st.floats(0.8, 1.2))
def test_a_weave_with_crimp_is_as_much_stretched_as_without(turn, radii, spacings, slack):
    model, state = plain_weave(radii, spacings, turn, slack=slack)
    np.testing.assert_allclose(observe.strain(model, state), 1.0 / slack - 1.0, atol=1e-9)
    for y, (radius, spacing) in enumerate(zip(np.repeat(radii, YARNS), np.repeat(spacings, YARNS), strict=True)):
        u = state.u[model.node_start[y] : model.node_start[y + 1]]
        wanted = slack * np.array([np.hypot(0.5 * spacing, radius), *[np.hypot(spacing, 2.0 * radius)] * (YARNS - 1)])
        np.testing.assert_allclose(np.diff(u), [*wanted, wanted[0]], rtol=1e-9)
        assert model.length[y] == pytest.approx(u[-1])
    np.testing.assert_array_equal(state.anchor, state.u)


@settings(deadline=None, max_examples=20)
@given(turn=TURNS, radii=st.tuples(*[st.floats(0.01, 0.3)] * 2), risen=st.floats(-0.2, 0.2))
def test_centre_lines_pass_at_the_radii_whichever_of_them_rises(turn, radii, risen):
    """Points that rise and fall by turns, as crossings do, give the crimp of one family to the other."""
    model, state = plain_weave(radii, (1.0, 1.0), turn)
    up, crossing = turn.apply(UP), model.point_kind == PointKind.CROSSING
    first, second = model.point_nodes[crossing].T
    warp_above = model.node_yarn[second] < YARNS
    state.x[crossing] += np.where(warp_above, risen, -risen)[:, None] * up
    at = centres(model, state)
    np.testing.assert_allclose(at[second] - at[first], np.full((len(first), 1), sum(radii)) * up, atol=1e-9)
    amplitude = np.abs((at - turn.apply([0.0, 0.0, 0.0])) @ up)
    for node, warp in ((first, ~warp_above), (second, warp_above)):
        wanted = np.where(warp, abs(radii[0] + risen), abs(radii[1] - risen))
        np.testing.assert_allclose(amplitude[node], wanted, atol=1e-9)


def test_contacts_slide_on_straight_segments_of_the_centre_line():
    """A contact between two crossings bends nothing, wherever it is, and gives way to a crossing, which does."""
    yarns = YarnAssembly()
    long = yarns.yarn(MATERIAL, 3.0, 1.0, fabric=0)
    for end in (0.0, 3.0):
        yarns.lagrangian(long, end, np.array([end, 0.0, 0.0]))
    places = (1.0, 1.05, 2.0, 2.5)
    for k, u in enumerate(places):
        other, own = yarns.yarn(MATERIAL, 2.0, 1.0, fabric=k % 2), k % 2 == 0
        for end in (0.0, 2.0):
            yarns.lagrangian(other, end, np.array([u, end - 1.0, 0.0]))
        below, above = ((long, u), (other, 1.0)) if u == places[0] else ((other, 1.0), (long, u))
        yarns.crossing(*below, *above, np.array([u, 0.0, 0.0]), UP, kind=PointKind.CROSSING if own else PointKind.CONTACT,
                       crimp=own)
    model, state = yarns.build()
    radius, nodes = MATERIAL.radius, slice(model.node_start[0], model.node_start[1])
    heights = [0.0, -radius, -0.9 * radius, radius, radius / 2.0, 0.0]
    np.testing.assert_allclose(centres(model, state)[nodes, 2], heights, atol=1e-12)
    np.testing.assert_allclose(centres(model, state)[nodes, 0], [0.0, *places, 3.0], atol=1e-12)
    assert state.eil[nodes].tolist() == [False, False, True, False, False, False]


def test_without_crimp_centre_lines_are_the_points_themselves():
    stack = random_stack(0)
    lines = centre_lines(stack.model, stack.state, stack.chain)
    assert lines.through(stack.state.x, stack.state.u) is stack.state.x and lines.place is stack.model.node_point


@settings(deadline=None, max_examples=20)
@given(turn=TURNS, shift=st.tuples(*[st.floats(-1.0, 1.0)] * 3), radii=st.tuples(*[st.floats(0.01, 0.3)] * 2),
       repeat=st.sampled_from([2, 4]))
def test_a_weave_that_is_set_stores_nothing_wherever_it_is_turned(turn, shift, radii, repeat):
    model, state = plain_weave(radii, turn=None, set_as_woven=True, repeat=repeat)
    state.x[:] = turn.apply(state.x) + shift
    energy = observe.energies(model, state, np.zeros(3))
    assert energy["potential"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("repeat", [2, 4], ids=["plain", "twill"])
def test_a_weave_that_is_set_stays_as_it_is_without_loads(repeat):
    """Also where yarns pass neighbours on the same side, and bend on one side of a crossing only."""
    model, state = plain_weave(set_as_woven=True, repeat=repeat)
    assert not state.normal_force.any()
    start = state.copy()
    stepper = YarnStepper(model, YarnSettings(), np.zeros(3), NO_OBSTACLES, no_handles())
    for n in range(5):
        assert stepper.step(state, 0.1 * n, 0.1).accepted
    np.testing.assert_allclose(state.x, start.x, atol=1e-9)
    np.testing.assert_allclose(state.u, start.u, atol=1e-9)


def test_a_weave_that_is_set_springs_back():
    """Bent as a whole it stores energy, and of its bending only: less than one that was pressed into the weave loses."""
    model, state = plain_weave(set_as_woven=True)
    bent = state.copy()
    bent.x[:, 2] += 0.1 * (state.x[:, 0] - 1.0) ** 2
    stored = observe.energies(model, bent, np.zeros(3))["potential"]
    flat_model, flat = plain_weave(crimp=False)
    flat.x[:, 2] += 0.1 * (flat.x[:, 0] - 1.0) ** 2
    assert stored > 0.0
    assert stored == pytest.approx(observe.energies(flat_model, flat, np.zeros(3))["potential"], rel=0.5)


def test_crimp_stores_bending_and_presses_before_the_first_step():
    energy, force = zip(*((observe.energies(model, state, np.zeros(3))["potential"], state.normal_force[: YARNS**2])
                          for model, state in (plain_weave(crimp=crimp) for crimp in (False, True))), strict=True)
    assert energy[0] == pytest.approx(0.0, abs=1e-15) and energy[1] > 1e-3
    np.testing.assert_allclose(force[1], force[0], rtol=1e-9)
    assert force[1].min() > 0.0
