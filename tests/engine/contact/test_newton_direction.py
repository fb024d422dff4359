"""Newton's direction of strands in contact against dense algebra."""

import numpy as np
import pytest

from engine.contact import newton_direction
from engine.validate.contact_cone import random_problem
from tests.engine.contact.test_augmented_lagrangian import SEEDS, evaluated, prepared


def direction(problem, made, slope, b):
    """The solution for the right-hand side b [V, 4], and the iterations."""
    factor, x, stiffness = np.empty_like(problem.strands.band), np.zeros_like(b), np.empty((len(slope), 3, 3))
    newton_direction.stiffness_in_space(made, slope, stiffness)
    assert newton_direction.factorise(problem.strands, made, stiffness, factor)
    made_in = newton_direction.conjugate_gradients(problem.strands, made, stiffness, factor, b, x)
    return x.reshape(-1), made_in


def dense(problem, made, slope):
    """The Hessian of strands with their contacts; those without contacts have the identity."""
    full = problem.hessian.copy()
    jacobian = np.einsum("cij,cju->ciu", made.frame, problem.jacobian)
    for rows, (along, first, mixed, second) in zip(jacobian, slope, strict=True):
        full += rows.T @ np.array([[along, 0, 0], [0, first, mixed], [0, mixed, second]]) @ rows
    return full


@pytest.mark.parametrize("seed", SEEDS)
def test_conjugate_gradients_solve_what_dense_algebra_solves(seed):
    problem, made, *numbers, step = prepared(seed)
    _, b, slope = evaluated(problem, made, *numbers, step)
    found, _ = direction(problem, made, slope, b)
    full = dense(problem, made, slope)
    wanted = np.linalg.solve(full, b.reshape(-1))
    off = found - wanted
    # in the energy of the matrix, about what is asked for
    assert off @ full @ off <= (3 * newton_direction.INEXACT) ** 2 * (wanted @ full @ wanted)


def test_for_one_strand_on_solids_the_preconditioner_is_exact():
    seen = 0
    for seed in range(60):
        problem = random_problem(seed)
        if (problem.contacts.edge[:, 1] < 0).all():
            problem, made, *numbers, step = prepared(seed)
            _, b, slope = evaluated(problem, made, *numbers, step)
            found, iterations = direction(problem, made, slope, b)
            assert iterations <= 1
            wanted = np.linalg.solve(dense(problem, made, slope), b.reshape(-1))
            np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-9)
            seen += 1
    assert seen > 5
