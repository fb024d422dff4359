"""The benchmark of strands: a row for every size, with the solutions per second."""

from engine.bench.strands import measurements


def test_rows_say_what_a_step_takes():
    few, more = measurements({8: (5, 40)})
    assert (few.size, more.size) == (5, 40) and few.case == more.case == "strands of 8 vertices"
    assert few.error <= 1e-6 and few.details["newton"] >= 1
    assert few.details["directions_per_s"] > 0 and few.peer is None
