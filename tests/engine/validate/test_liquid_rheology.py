"""The cases of a liquid's stress, as `strandline validate --quick` runs them, and what their reference keeps."""

import numpy as np
import pytest

from engine.validate.catalogue import run
from engine.validate.liquid_rheology import LIQUIDS, sheared_strain


@pytest.mark.parametrize("case", ["liq-plastic", "liq-rheometer"])
def test_a_point_of_liquid_is_at_its_bar(case):
    entry = run([case], quick=True)["cases"][0]
    assert entry["status"] == "pass", entry["note"]


def test_the_reference_keeps_volume_where_it_says_so():
    b = sheared_strain(LIQUIDS["shaving-cream"], 10.0, [0.02, 0.1], keeps=True)
    assert np.linalg.det(b) == pytest.approx([1.0, 1.0], rel=1e-9)
