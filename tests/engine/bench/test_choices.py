"""Choices of knobs: what is timed and what fails, the front of own rows and the peer's, the peer's time to the same error."""

from math import nan

import pytest

from engine.bench import choices
from engine.bench.choices import Choice, rows, tried
from engine.run.adaptivity import StepTooSmall


def test_short_runs_are_repeated_and_their_result_is_judged(monkeypatch):
    monkeypatch.setattr(choices, "LEAST", 0.01)
    runs = []
    choice = tried("a, b", 10, lambda: runs.append(1) or 3.0, lambda result: result / 2, default=True, segments=4)
    assert len(runs) > 1 and 0.0 < choice.seconds
    assert (choice.case, choice.steps, choice.error, choice.default) == ("a, b", 10, 1.5, True)
    assert choice.details == {"segments": 4}


@pytest.mark.parametrize("failure", [RuntimeError("rejected"), StepTooSmall("rejected")])
def test_a_run_that_fails_has_no_error(failure, monkeypatch):
    monkeypatch.setattr(choices, "LEAST", 1e-3)

    def fails():
        raise failure

    assert tried("a", 1, fails, float).error is None
    assert tried("a", 1, lambda: nan, float).error is None


def test_the_front_is_of_all_and_the_peers_time_is_to_the_same_error():
    own = [Choice("p, 8", 10, 1.0, 0.1), Choice("p, 16", 20, 2.0, 0.2), Choice("p, 32", 30, 3.0, 0.01),
           Choice("p, 64", 1, 0.1, None)]
    peers = [Choice("p, peer 8", 100, 1.5, 0.15), Choice("p, peer 16", 200, 4.0, 0.05), Choice("p, peer 32", 100, 5.0, None)]
    measured = list(rows(own, "peer", peers))
    assert [row.standing.on_front for row in measured] == [True, False, True, False, False, False, False]
    assert [row.peer_seconds for row in measured] == [4.0, 1.5, None, None, None, None, None]
    assert [row.peer for row in measured] == ["peer"] * 4 + [None] * 3
    assert all(row.peer is None and row.peer_seconds is None for row in rows(own))
