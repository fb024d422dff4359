"""Sweeps over single contacts on random small problems, whose solutions Coulomb's law itself judges."""

import numpy as np
import pytest

from engine.bench.contact_convergence import Judge, LinearProblem
from engine.bench.contact_sweeps import answered, sweep
from engine.contact.contact_problem import contact_problem
from engine.validate import contact_cone

SWEEPS, BAR = 20_000, 1e-8  # the bar of contact-cone


def judged(problem):
    """The judge of a random problem, with its strands and contacts."""
    strand = np.repeat(np.arange(len(problem.strands.start) - 1), np.diff(problem.strands.start))
    contact = contact_problem(problem.contacts, strand, problem.pull, problem.compliance)
    return Judge(LinearProblem(problem.strands, contact, problem.moved, problem.contacts.force))


@pytest.mark.parametrize("seed", range(8))
def test_strands_answer_as_their_hessians_say(seed):
    problem = contact_cone.random_problem(seed)
    judge, force = judged(problem), np.random.default_rng(seed).normal(size=problem.contacts.force.shape)
    moved = answered(judge.contact, judge.operator, judge.in_frames(force))
    w = np.einsum("ce,cej->cj", judge.contact.weight, moved[judge.contact.vertex]) - problem.contacts.carried
    np.testing.assert_allclose(w, contact_cone.displacements(problem, force), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_sweeps_come_to_coulombs_law(seed):
    problem = contact_cone.random_problem(seed)
    judge = judged(problem)
    force = judge.in_frames(problem.contacts.force)
    moved = answered(judge.contact, judge.operator, force)
    for _ in range(SWEEPS):
        sweep(judge.contact, judge.operator, force, moved)
    np.testing.assert_allclose(moved, answered(judge.contact, judge.operator, force), rtol=1e-9, atol=1e-9)
    assert judge.error(force) <= BAR
    assert contact_cone.residual(problem, np.einsum("cij,ci->cj", judge.contact.frame, force)) <= BAR
