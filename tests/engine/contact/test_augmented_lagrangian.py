"""All contacts of linear strands at once: kernels against dense algebra, solutions against Coulomb's law itself."""

import numpy as np
import pytest

from engine.contact import augmented_lagrangian as al
from engine.contact.cones import friction_limit
from engine.validate.contact_cone import random_problem, residual, solutions, solved
from tests.engine.contact.test_contact_problem import linear, strand_of

SEEDS = range(5)


def prepared(seed: int):
    """A problem with its kernels' arguments: stiffness, limits, forces and slopes of contacts at a random step."""
    problem, rng = random_problem(seed), np.random.default_rng(seed)
    made, number = linear(problem), len(problem.pull)
    stiffness, limit = np.exp(rng.normal(size=(number, 3))), rng.uniform(0.1, 2.0, number)
    force, start = rng.normal(size=(number, 3)), rng.normal(size=(number, 3))
    step = np.where(problem.strands.held, 0.0, rng.normal(size=problem.strands.held.shape))
    return problem, made, stiffness, limit, force, start, step


def evaluated(problem, made, stiffness, limit, force, start, step):
    """The potential, what is left over, and the slopes of forces."""
    w, r, slope = np.empty_like(force), np.empty_like(force), np.empty((len(force), 4))
    residual_ = np.zeros_like(step)
    value = al.evaluate(problem.strands, made, stiffness, limit, force, start, step, w, r, slope, residual_, True)
    return value, residual_, slope


@pytest.mark.parametrize("seed", SEEDS)
def test_what_is_left_over_is_minus_the_slope_of_the_potential(seed):
    problem, made, *numbers, step = prepared(seed)
    touched = np.isin(strand_of(problem), made.strand)
    free = np.argwhere(~problem.strands.held & touched[:, None])
    _, found, _ = evaluated(problem, made, *numbers, step)
    width, rng = 1e-6, np.random.default_rng(0)
    for v, k in rng.permutation(free)[:15]:
        d = np.zeros_like(step)
        d[v, k] = width
        after, before = (evaluated(problem, made, *numbers, there)[0] for there in (step + d, step - d))
        assert -found[v, k] == pytest.approx((after - before) / (2 * width), rel=1e-4, abs=1e-5 * np.abs(found).max())
    assert not found[problem.strands.held & touched[:, None]].any()


def beside_held(problem) -> bool:
    """Whether a contact is on an edge that begins at a held vertex."""
    edge = problem.contacts.edge
    return bool(problem.strands.held[edge[edge >= 0], 0].any())


@pytest.mark.parametrize("beside", [False, True], ids=["amid strands", "beside what is held"])
def test_solutions_keep_coulombs_law(beside):
    """Regular and shifted ones."""
    for seed, problem in enumerate(map(random_problem, range(60))):
        if beside_held(problem) == beside:
            assert residual(problem, solved(problem, 1e-10)) <= 1e-8, seed


def test_the_judge_knows_what_is_not_lawful():
    rng = np.random.default_rng(0)
    for seed in range(10):
        problem = random_problem(seed)
        force = solved(problem, 1e-10)
        assert residual(problem, force) <= 1e-8
        assert residual(problem, force + max(0.1 * np.abs(force).max(), 0.1) * rng.normal(size=force.shape)) > 1e-3
        assert residual(problem, 0 * force) > 1e-3 or not force.any()


def test_a_single_contact_has_one_of_the_solutions_that_there_are():
    single = [p for p in map(random_problem, range(100)) if len(p.pull) == 1]
    sorts = set()
    for problem in single:
        force, candidates = solved(problem, 1e-10)[0], solutions(problem)
        assert len(candidates)
        assert np.abs(candidates - force).max(axis=1).min() <= 1e-6 * max(1.0, np.abs(force).max())
        sorts.add((bool(force.any()), problem.pull[0] > 0.0))
    assert len(sorts) >= 3 and len(single) > 10


def test_what_it_tells_is_what_it_did():
    problem = random_problem(0)
    made, force = linear(problem), problem.contacts.force.copy()
    answer = al.solve(problem.strands, made, problem.moved, force, 1e-8, 500)
    assert answer.error <= 1e-8 and 0 < answer.rounds <= answer.newton <= answer.linear
    jacobian = np.einsum("cij,cju->ciu", made.frame, problem.jacobian)
    load = np.einsum("ciu,ci->u", jacobian, force)
    there = np.linalg.solve(problem.hessian, load - problem.strands.gradient.reshape(-1))
    touched = np.isin(strand_of(problem), made.strand).repeat(4)
    np.testing.assert_allclose(answer.step.reshape(-1)[touched], there[touched], atol=1e-6 * np.abs(there).max())


def test_limits_of_friction_are_those_of_the_law_and_half_of_it_where_they_swing_back():
    problem = next(p for p in map(random_problem, range(50)) if len(p.pull) >= 4)
    made, rng = linear(problem), np.random.default_rng(3)
    stiffness, w, force = (np.exp(rng.normal(size=(len(problem.pull), 3))) for _ in range(3))
    start, before = rng.uniform(0.1, 2.0, len(force)), rng.normal(size=len(force))
    wanted = np.array([
        friction_limit(r, r - k * along, k, *law)
        for r, k, along, *law in zip(
            force[:, 0], stiffness[:, 0], w[:, 0], made.gap, made.friction, made.pull, strict=True)])
    swings = (wanted - start) * before < 0.0
    assert swings.any() and not swings.all()
    for damped, share in ((False, 1.0), (True, np.where(swings, 0.5, 1.0))):
        limit, change = start.copy(), before.copy()
        al.update_limits(made, stiffness, w, force, limit, change, damped)
        np.testing.assert_allclose(limit, start + share * (wanted - start))
        np.testing.assert_allclose(change, share * (wanted - start))


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_sums_are_in_order(size):
    values = np.random.default_rng(size).normal(size=size) * 10.0 ** np.random.default_rng(1).uniform(-8, 8, size)
    total = 0.0
    for value in values:
        total += value
    assert al.in_order(values) == total


def test_rounds_end_where_they_must():
    problem = next(p for p in map(random_problem, range(50)) if len(p.pull) >= 4)
    force = problem.contacts.force.copy()
    answer = al.solve(problem.strands, linear(problem), problem.moved, force, 1e-12, 2)
    assert answer.rounds == 2 and answer.error > 1e-12 and answer.stuck.any()
    force = problem.contacts.force.copy()
    assert not al.solve(problem.strands, linear(problem), problem.moved, force, 1e-8, 500).stuck.any()


def test_rounds_may_leave_a_share_of_what_the_first_moves():
    fewer = 0
    for problem in map(random_problem, range(20)):
        exact, inexact = (
            al.solve(problem.strands, linear(problem), problem.moved, problem.contacts.force.copy(), 1e-10, 500, inexact=share)
            for share in (0.0, 0.05))
        assert inexact.rounds <= exact.rounds
        assert np.abs(inexact.step - exact.step).max() <= 0.2 * np.abs(exact.step).max()
        fewer += inexact.rounds < exact.rounds
    assert fewer > 10
