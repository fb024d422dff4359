"""The case of stability, as `strandline validate --quick` runs it, and what it takes for unstable."""

from engine.validate import liquid_stability
from engine.validate.catalogue import run


def test_the_semi_implicit_integrator_is_at_its_bar():
    entry = run(["liq-stability"], quick=True)["cases"][0]
    assert entry["status"] == "pass", entry["note"]


def test_what_blows_up_is_not_stable():
    assert liquid_stability.stable_courant("milk-cream", 6, 0.5, liquid_stability.INTEGRATORS["explicit"]) == 0.0


def test_the_search_ends_between_a_stable_step_and_one_that_is_not(monkeypatch):
    monkeypatch.setattr(liquid_stability, "stable_courant", lambda liquid, cells, number, settings: number * (number < 0.43))
    found = liquid_stability.largest_stable("milk-cream", 6, liquid_stability.PATIENT)
    assert 0.43 / 2 ** (1 / 2**liquid_stability.HALVINGS) < found < 0.43


def test_nothing_is_found_where_nothing_is_stable(monkeypatch):
    monkeypatch.setattr(liquid_stability, "stable_courant", lambda *_: 0.0)
    assert liquid_stability.largest_stable("milk-cream", 6, liquid_stability.PATIENT) == 0.0
