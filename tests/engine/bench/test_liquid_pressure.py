"""The benchmark of the pressure solver: rows with iterations and memory, with and without the peer."""

import pytest

from engine.bench.liquid_pressure import TOLERANCE, measurements
from engine.bench.suite import Note
from tests.engine.bench.peers import without


def test_rows_say_what_a_solution_takes():
    pytest.importorskip("pyamg")
    (row,) = measurements((16,))
    assert row.size > 1000 and row.error <= TOLERANCE and 1 <= row.details["iterations"] <= 20
    assert row.peer_seconds > 0 and row.details["peer_iterations"] >= 1
    assert 60 < row.details["bytes_per_cell"] < 400  # the inverse counts, at this size


def test_a_peer_that_is_not_installed_is_noted(monkeypatch):
    without(monkeypatch, "pyamg")
    note, row = measurements((16,))
    assert isinstance(note, Note) and "pyamg" in note.text
    assert row.peer is row.peer_seconds is None and row.error <= TOLERANCE
