"""Newton directions: condensing contacts leaves them as they are, and so does work in parts, on any number of threads."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.bench.yarns import stacked
from engine.linalg.block_matrix import BLOCK
from engine.linalg.incomplete_cholesky import LARGEST_SHIFT, factorise
from engine.steppers import newton_system
from engine.steppers.newton_system import NewtonSystem
from engine.steppers.step_report import Stopwatch
from engine.yarns import contact
from engine.yarns.model import PointKind
from engine.yarns.settings import YarnSettings
from tests.engine.linalg.dense import dense
from tests.engine.threads import on_one_and_two_threads
from tests.engine.yarns.stacks import Stack, perturbed, random_stack, some_collisions
from tests.engine.yarns.terms import full_hessian, of_points

ALL_IN_ONE = np.zeros(1, np.int64)  # part: none, and everything behind the last


def condensable(seed):
    """A stack in which both nodes of every contact are EIL, also of one between pinned ends; and a place."""
    stack = random_stack(seed)
    model, state = stack.model, stack.state
    both = model.point_nodes[model.point_kind == PointKind.CONTACT]
    state.eil[both] = True
    ends = model.node_point[np.column_stack([stack.chain.before[both], stack.chain.after[both]])]
    assert (model.free_directions[ends] == 0.0).all(axis=(2, 3)).any()
    # other segments are now EoL, and may collide
    return replace(stack, colliding=some_collisions(np.random.default_rng(seed), stack)), perturbed(stack, seed)


def cloths(crossings=800):
    """Two cloths on each other, with the place that they would come to in a step; of 800 crossings they have several strips."""
    built = stacked(crossings)
    model = replace(built.yarns, shear_stiffness=0.1 * built.yarns.stretch_stiffness)
    state = built.state
    rng, spacing = np.random.default_rng(0), model.rest_segment.min()
    x = state.x + 0.02 * spacing * rng.normal(size=state.x.shape)
    u = state.u + 0.02 * spacing * ~model.u_fixed * rng.uniform(-1.0, 1.0, len(state.u))
    return Stack(model, state, built.obstacles, built.gravity), x, u


def direction_of_condensed(potential, x, u, convex, load):
    """The Newton direction by way of the condensed system, and how many points are condensed in it."""
    layout = potential.lay_out(np.float64)
    assert potential.hessian(x, u, np.full(len(x), convex), layout)
    reduced = load[layout.point]
    contact.condense_load(layout.condensed_points, layout.condensed, layout.others, layout.row, layout.inverse,
                          layout.coupling, load, reduced)
    found = np.zeros_like(load)
    found[layout.point] = np.linalg.solve(dense(layout.matrix), reduced.ravel()).reshape(-1, BLOCK)
    contact.expand(layout.condensed_points, layout.condensed, layout.others, layout.inverse, layout.coupling, load, found)
    return found, len(layout.condensed_points)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("convex", [False, True], ids=["true", "convex"])
def test_condensing_is_exact(convex, seed):
    stack, (x, u) = condensable(seed)
    potential = stack.potential()
    load = -potential.gradient(x, u)[1]
    wanted = np.linalg.solve(full_hessian(potential, x, u, convex), load.ravel()).reshape(load.shape)
    found, condensed = direction_of_condensed(potential, x, u, convex, load)
    assert condensed == np.count_nonzero(stack.model.point_kind == PointKind.CONTACT)
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-9 * np.abs(wanted).max())


def test_what_is_held_stays_where_contacts_beside_it_are_condensed():
    stack, (x, u) = condensable(0)
    potential = stack.potential()
    system, (_, gradient) = NewtonSystem(potential, YarnSettings(), Stopwatch()), potential.gradient(x, u)
    direction, _ = system.direction(x, u, gradient, goal=0.0)
    held = direction - np.einsum("pij,pj->pi", potential.projector, direction)
    np.testing.assert_allclose(held, 0.0, atol=1e-14 * np.abs(direction).max())


def test_work_in_parts_is_that_on_one_list():
    stack, x, u = cloths()
    potential = stack.potential(YarnSettings())
    energy, gradient = potential.gradient(x, u)
    layout = potential.lay_out(np.float64)
    for part, points in ((potential.parts, potential.split), (potential.sheared_parts, potential.sheared)):
        assert len(part) > 2 and 0 < part[-1] < len(points)  # within strips, and across
    energy_in_parts, in_parts = potential.gradient(x, u)
    assert energy_in_parts == pytest.approx(energy, rel=1e-12)
    np.testing.assert_allclose(in_parts, gradient, rtol=0.0, atol=1e-12 * np.abs(gradient).max())
    for convex in (False, True):
        found = []
        potential.hessian(x, u, np.full(len(x), convex), layout)
        found.append([of_points(layout), layout.inverse.copy(), layout.coupling.copy()])
        parts = potential.parts, potential.sheared_parts
        potential.parts = potential.sheared_parts = ALL_IN_ONE
        potential.hessian(x, u, np.full(len(x), convex), layout)
        found.append([of_points(layout), layout.inverse.copy(), layout.coupling.copy()])
        potential.parts, potential.sheared_parts = parts
        for in_parts, at_once in zip(*found, strict=True):
            np.testing.assert_allclose(in_parts, at_once, rtol=0.0, atol=1e-12 * np.abs(at_once).max())


def test_parts_share_no_points_that_have_rows():
    stack, _, _ = cloths()
    potential = stack.potential(YarnSettings())
    layout = potential.lay_out()
    members, part = potential._members(), potential.parts
    owner = np.full(len(layout.row), -1)
    for s in range(len(part) - 1):
        of_part = np.unique(members[part[s] : part[s + 1]])
        assert (owner[of_part] == -1).all()
        owner[of_part] = s


def test_directions_are_the_same_to_the_bit_on_any_number_of_threads():
    def direction():
        stack, x, u = cloths()
        potential = stack.potential(YarnSettings())
        system = NewtonSystem(potential, YarnSettings(), Stopwatch())
        energy, gradient = potential.gradient(x, u)
        return energy, gradient.tobytes(), system.direction(x, u, gradient, goal=0.0)[0].tobytes()

    one, two = on_one_and_two_threads(direction)
    assert one == two


def test_a_direction_descends_and_solves_the_system_to_its_tolerance():
    stack, x, u = cloths()
    potential = stack.potential(YarnSettings())
    _, gradient = potential.gradient(x, u)
    system = NewtonSystem(potential, YarnSettings(linear_tolerance=1e-9), Stopwatch())
    direction, iterations = system.direction(x, u, gradient, goal=0.0)
    assert iterations > 0 and np.sum(gradient * direction) < 0.0
    left = full_hessian(potential, x, u, system.convex) @ direction.ravel() + gradient.ravel()
    assert np.linalg.norm(left) <= 1e-5 * np.linalg.norm(gradient)


def assert_newton_direction(system, x, u, gradient, error):
    """Check a direction of a system against the dense solution, with the positive form where it was taken."""
    potential = system.potential
    potential.update_pull(x, u, np.zeros((len(x), BLOCK)))  # as the full Hessian has it
    found, iterations = system.direction(x, u, gradient, goal=0.0)
    wanted = np.linalg.solve(full_hessian(potential, x, u, system.convex), -gradient.ravel())
    assert np.linalg.norm(found.ravel() - wanted) <= error * np.linalg.norm(wanted) and iterations > 0


def test_the_positive_form_is_taken_around_negative_curvature_only():
    """Of a cloth at rest with one contact that a strong pull bends: elsewhere Newton has the true Hessian."""
    stack, _, _ = cloths()
    x, u = stack.state.x, stack.state.u
    system, _, _, gradient = tight_system(stack, x, u)
    system.direction(x, u, gradient, goal=0.0)
    assert not system.convex.any()
    split = system.potential.split
    pulled = split[len(split) // 2]
    system.potential.multiplier[pulled] = 0.1 * stack.model.stretch_stiffness.max()
    gradient = system.potential.gradient(x, u)[1]
    assert np.linalg.eigvalsh(full_hessian(system.potential, x, u, False)).min() < 0.0
    system.forget_factor()
    assert_newton_direction(system, x, u, gradient, error=1e-6)
    assert 0 < np.count_nonzero(system.convex) < 0.1 * len(x)
    direction = system.direction(x, u, gradient, goal=0.0)[0]
    assert np.sum(gradient * direction) < 0.0


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 1000))
def test_the_positive_form_around_a_point_changes_nothing_far_from_it(seed):
    stack = random_stack(seed % 3)
    x, u = perturbed(stack, seed)
    convex = np.arange(len(x)) == seed % len(x)
    potential = stack.potential()
    true, mixed = (full_hessian(potential, x, u, form).reshape(len(x), BLOCK, len(x), BLOCK) for form in (False, convex))
    changed = (true != mixed).any(axis=(1, 3))
    np.testing.assert_array_equal(changed, changed.T)
    layout = potential.lay_out(np.float64, condense=False)
    near = layout.point[near_rows(layout.matrix, layout.row[seed % len(x)])]
    assert set(np.flatnonzero(changed.any(axis=1))) <= set(near)


def near_rows(matrix, row):
    """Rows that are coupled to what a row is coupled to."""
    def around(i):
        return matrix.column[matrix.start[i] : matrix.start[i + 1]]
    return np.unique(np.concatenate([around(i) for i in around(row)])) if row >= 0 else np.zeros(0, np.int64)


def tight_system(stack, x, u):
    """The system of a step, to be solved nearly to round-off, with the place and the gradient there."""
    potential = stack.potential(YarnSettings())
    settings = YarnSettings(linear_tolerance=1e-11)
    return NewtonSystem(potential, settings, Stopwatch()), x, u, potential.gradient(x, u)[1]


def tight_system_of_condensable(seed):
    stack, (x, u) = condensable(seed)
    return tight_system(stack, x, u)


@pytest.mark.parametrize("seed", range(3))
def test_preconditioners_that_are_never_sound_end_in_the_direction_all_the_same(monkeypatch, seed):
    monkeypatch.setattr(newton_system, "OUTLIER", 0.1)  # what every preconditioner exceeds
    system, x, u, gradient = tight_system_of_condensable(seed)
    assert_newton_direction(system, x, u, gradient, error=1e-6)
    assert system.factor.shift >= LARGEST_SHIFT  # it has been through all shifts


@pytest.mark.parametrize("stale", [False, True], ids=["fresh", "stale"])
def test_factors_that_nearly_broke_down_are_replaced(monkeypatch, stale):
    calls = []

    def spoilt(factor, stronger):
        """Factorise as ever, but the first time make a row's pivot next to nothing."""
        calls.append(stronger)
        made = factorise(factor, stronger)
        if len(calls) == 1:
            factor.inverse[len(factor.inverse) // 2] *= 1e3
        return made

    stack, x, u = cloths(200)
    system, _, _, gradient = tight_system(stack, x, u)
    x, u = stack.state.x, stack.state.u  # where the Hessian is positive as it is
    monkeypatch.setattr(newton_system, "factorise", spoilt)
    if stale:  # left from an iteration before
        system.potential.hessian(x, u, np.zeros(len(x), np.bool_), system.layout)
        assert system._factorise(False, stronger=False)
    assert_newton_direction(system, x, u, gradient, error=1e-6)
    assert calls == [False, not stale]  # in place of a fresh factor comes a stronger one, of an old one just a fresh one


@pytest.mark.parametrize("outlier", [newton_system.OUTLIER, 0.1])
@pytest.mark.parametrize("seed", range(3))
def test_a_coarse_space_leaves_the_direction_as_it_is(monkeypatch, seed, outlier):
    monkeypatch.setattr(newton_system, "MANY", 10)
    monkeypatch.setattr(newton_system, "FAR", 0.0)
    monkeypatch.setattr(newton_system, "PATCH", 1.0)
    monkeypatch.setattr(newton_system, "OUTLIER", outlier)
    system, x, u, gradient = tight_system_of_condensable(seed)
    assert system.coarse is not None and system.coarse.patches.count > 3
    assert_newton_direction(system, x, u, gradient, error=1e-3)  # in single precision


def test_a_coarse_space_has_patches_of_one_cloth_each_and_saves_iterations(monkeypatch):
    monkeypatch.setattr(newton_system, "MANY", 100)
    monkeypatch.setattr(newton_system, "FAR", 0.0)
    monkeypatch.setattr(newton_system, "PATCH", 6.0)
    together, x, u, gradient = tight_system(*cloths())
    model, patches = together.potential.model, together.coarse.patches
    node = model.point_nodes[together.layout.point]
    fabric = np.where(node >= 0, model.fabric[model.node_yarn[node]], -1).ravel()
    for p in range(patches.count):
        assert len(set(fabric[patches.members[patches.start[p] : patches.start[p + 1]]])) == 1
    monkeypatch.setattr(newton_system, "FAR", np.inf)
    alone, *_ = tight_system(*cloths())
    assert alone.coarse is None
    iterations = [system.direction(x, u, gradient, goal=0.0)[1] for system in (alone, together)]
    assert 2 * iterations[1] <= iterations[0]
