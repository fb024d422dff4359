"""The cases of discrete elastic rods, as `strandline validate --quick` runs them."""

import pytest

from engine.validate.catalogue import run
from engine.validate.der_statics import elastica_tip

CASES = ["der-gradients", "der-cantilever", "der-vibration", "der-ring", "der-lateral", "der-order", "der-swing"]


@pytest.mark.parametrize("case", CASES)
def test_a_strand_is_at_its_bar(case):
    entry = run([case], quick=True)["cases"][0]
    assert entry["status"] == "pass", entry["note"]


def test_the_elastica_droops_little_as_a_beam_does():
    x, z = elastica_tip(1e-3)
    assert z == pytest.approx(-1e-3 / 8, rel=1e-5) and x == pytest.approx(1.0, abs=1e-6)
