"""The case of the pressure solver, as `strandline validate --quick` runs it, and its domains."""

import numpy as np

from engine.linalg.sealed import sealed_components
from engine.validate.catalogue import run
from engine.validate.liquid_projection import free_surface


def test_the_projection_is_at_its_bar():
    entry = run(["liq-projection"], quick=True)["cases"][0]
    assert entry["status"] == "pass", entry["note"]


def test_domains_have_all_that_makes_pressure_hard():
    system = free_surface(32)
    excess = system.diagonal.copy()
    for a in range(3):
        joined = system.beside[:, 2 * a + 1] >= 0
        excess -= system.coupling[:, a]
        np.subtract.at(excess, system.beside[joined, 2 * a + 1], system.coupling[joined, a])
    assert excess.min() >= -1e-12 and excess.max() > 20.0  # surfaces close to centres of cells
    cut = (system.coupling > 0.0) & (system.coupling < 1.0)
    assert cut.sum() > 100 and system.coupling[cut].min() < 0.05
    assert len(sealed_components(system).start) == 1  # none
