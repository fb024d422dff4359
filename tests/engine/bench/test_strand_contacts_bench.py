"""The benchmark of strands in contact: rows by size, by tolerance and by iterations."""

from itertools import pairwise

import numpy as np

import engine.steppers.strands
from engine.bench.strand_contacts import by_iterations, by_size, by_tolerance, warm


def test_rows_say_what_contacts_cost():
    (row,) = by_size((4,))
    assert row.size == 4 and row.details["contacts"] > 0 and row.details["contacts_per_s"] > 0
    assert row.error < 0.05 and row.details["linear_iterations"] > 0


def test_precision_is_bought_with_iterations():
    rough, fine = by_tolerance(4, (1e-1, 1e-3, 1e-5))
    assert fine.error <= rough.error and fine.details["linear_iterations"] >= rough.details["linear_iterations"]
    assert fine.error <= 1e-3


def test_solvers_converge_from_the_same_guess():
    rows = list(by_iterations(9, (1, 2, 30), (1, 10, 100)))
    rough, fine, sweeps = ([row for row in rows if row.case.endswith(end)] for end in ("to 0.01", "to 1e-06", "over contacts"))
    assert all(row.converging and row.case.startswith("9 strands, ") for row in rows)
    assert rough and [row.size for row in sweeps] == [1, 10, 100] and sweeps[-1].error < sweeps[0].error
    assert [row.details["rounds"] for row in fine[:2]] == [1, 2] and fine[-1].details["rounds"] < 30
    for earlier, later in (*pairwise(fine), *pairwise(sweeps)):
        assert earlier.size <= later.size and (earlier.unit == "iterations" or earlier.seconds < later.seconds)
    assert fine[-1].error <= 1e-6 and fine[-1].details["error_of_its_own"] <= 1e-6


def test_the_problem_is_that_of_the_next_step(monkeypatch):
    bundle, given = warm(4), []
    linear = bundle.linear_problem()
    solve = engine.steppers.strands.solve

    def keep(strands, contact, moved, force, *rest):
        given.append((strands, contact._replace(frame=contact.frame.copy()), moved.copy(), force.copy()))
        return solve(strands, contact, moved, force, *rest)

    monkeypatch.setattr(engine.steppers.strands, "solve", keep)
    bundle.step()
    strands, contact, moved, force = given[0]
    vertices = np.isin(bundle.stepper.touching.strand, contact.strand)  # others are not linearised
    np.testing.assert_array_equal(linear.strands.gradient[vertices], strands.gradient[vertices])
    np.testing.assert_array_equal(*(some.band.reshape(len(vertices), -1)[vertices] for some in (linear.strands, strands)))
    for own, theirs in zip((*linear.contact, linear.moved, linear.force), (*contact, moved, force), strict=True):
        np.testing.assert_array_equal(own, theirs)
    assert linear.force.any()
