"""The benchmark of strands in contact: rows by size and by tolerance."""

from engine.bench.strand_contacts import by_size, by_tolerance


def test_rows_say_what_contacts_cost():
    (row,) = by_size((4,))
    assert row.size == 4 and row.details["contacts"] > 0 and row.details["contacts_per_s"] > 0
    assert row.error < 0.05 and row.details["linear_iterations"] > 0


def test_precision_is_bought_with_iterations():
    rough, fine = by_tolerance(4, (1e-1, 1e-3, 1e-5))
    assert fine.error <= rough.error and fine.details["linear_iterations"] >= rough.details["linear_iterations"]
    assert fine.error <= 1e-3
