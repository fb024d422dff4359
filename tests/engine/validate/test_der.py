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


def test_a_cantilever_that_shears_and_stretches_droops_more_and_hangs_longer():
    x, z = elastica_tip(1e-3, shear=0.02)
    assert z == pytest.approx(-1e-3 * (1 / 8 + 0.02 / 2), rel=1e-5) and x == pytest.approx(1.0, abs=1e-6)
    stiff, soft = elastica_tip(1e3), elastica_tip(1e3, stretch=1e-5)
    assert soft[1] - stiff[1] == pytest.approx(-1e-5 * 1e3 / 2, rel=0.1)  # nearly all of it hangs straight down
