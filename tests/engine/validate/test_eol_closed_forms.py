"""The cases of rods against closed forms, as `strandline validate --quick` runs them."""

import pytest

from engine.validate.catalogue import run


def measured(case: str) -> dict:
    return run([case], quick=True)["cases"][0]


@pytest.mark.parametrize("case", ["eol-catenary", "eol-peg", "eol-capstan", "eol-transition", "yarn-collision"])
def test_a_rod_is_at_its_bar(case):
    entry = measured(case)
    assert entry["status"] == "pass", entry["note"]
    assert len(entry["rows"]) >= 3


@pytest.fixture(scope="module")
def flights():
    return measured("eol-momentum")


def test_momentum_is_exact(flights):
    assert flights["error"] is not None, flights["note"]
    assert flights["error"] <= flights["bar"]
    assert "no EIL switches" not in flights["note"]


@pytest.mark.xfail(strict=True, reason="yarns move at once when a contact turns EIL where they bend, or turns EoL")
def test_energy_never_rises(flights):
    assert "energy rises" not in flights["note"]
