"""The cases of liquids, as `strandline validate --quick` runs them, and their closed forms."""

import numpy as np
import pytest

from engine.scene.liquid_materials import LiquidMaterial
from engine.validate import liquid_film, liquid_hydrostatic, liquid_transfer, liquid_wave
from engine.validate.catalogue import run
from engine.validate.liquids import EARTH, FLOOR, Vessel, box, ends, liquid, planes


@pytest.mark.parametrize("case", ["liq-transfer", "liq-hydrostatic", "liq-wave", "liq-film", "liq-volume"])
def test_a_liquid_is_at_its_bar(case):
    entry = run([case], quick=True)["cases"][0]
    assert entry["status"] == "pass", entry["note"]


def test_a_face_without_its_share_of_momentum_would_be_noticed(monkeypatch):
    def leaky(grid, x, velocity, affine, *rest):
        liquid_transfer_to_grid(grid, x, velocity, (1.0 + 1e-6) * affine, *rest)

    liquid_transfer_to_grid = liquid_transfer.to_grid
    monkeypatch.setattr(liquid_transfer, "to_grid", leaky)
    assert liquid_transfer.conserved(50, seed=0) > 1e-9


def test_the_column_carries_the_weight_above():
    modulus = liquid_hydrostatic.MODULUS
    z = np.linspace(0.0, liquid_hydrostatic.HEIGHT, 2001)
    j = liquid_hydrostatic.compression(z, modulus)
    p = -0.5 * modulus * (j - 1.0 / j)
    assert j[-1] == pytest.approx(1.0, abs=1e-14) and 0.75 < j[0] < 0.85
    weight = liquid_hydrostatic.DENSITY * EARTH * np.trapezoid(1.0 / j, z)
    assert p[0] == pytest.approx(weight, rel=1e-6)


@pytest.mark.parametrize("name", liquid_film.LIQUIDS)
def test_the_film_balances_its_weight_and_sticks_to_the_incline(name):
    material = liquid_film.LIQUIDS[name]
    z = np.linspace(0.0, liquid_film.DEPTH, 4001)
    u = liquid_film.velocity_at(material, z)
    rate = np.diff(u) / np.diff(z)
    stress = liquid_film.PULL * (liquid_film.DEPTH - 0.5 * (z[1:] + z[:-1]))
    flows = stress > 1.01 * material.yield_stress
    flow_stress = material.yield_stress + material.consistency * rate**material.flow_index
    assert u[0] == 0.0
    assert flow_stress[flows] == pytest.approx(stress[flows], rel=1e-3)
    assert np.all(rate[stress < 0.99 * material.yield_stress] == 0.0)


def test_the_wave_of_deep_water_has_the_frequency_of_deep_water():
    assert liquid_wave.OMEGA**2 == pytest.approx(EARTH * liquid_wave.WAVENUMBER, rel=5e-3)


def test_a_box_fills_its_cells_and_falls_freely_without_a_floor():
    model = liquid(LiquidMaterial(density=1000.0), 0.1)
    state = box(model, (0.2, 0.3, 0.4))
    assert len(state.x) == 8 * 2 * 3 * 4 and state.volume.sum() == pytest.approx(0.024)
    vessel = Vessel(model, state, (0.0, 0.0, -EARTH), planes())
    before = state.x[:, 2].mean()
    vessel.reach(0.01)
    assert vessel.state.x[:, 2].mean() - before == pytest.approx(-EARTH * 0.01**2, rel=1e-9)


def test_a_step_beyond_the_courant_number_is_taken_in_parts_or_refused():
    model = liquid(LiquidMaterial(density=1000.0), 0.1)
    state = box(model, (0.2, 0.2, 0.2))
    state.velocity[:, 0] = 3.0
    vessel = Vessel(model, state, (0.0, 0.0, 0.0), planes())
    with pytest.raises(RuntimeError, match="Courant"):
        vessel.step(0.1)
    before = state.x[:, 0].mean()
    vessel.reach(0.1)
    assert vessel.state.x[:, 0].mean() - before == pytest.approx(0.3, rel=1e-6)
    vessel.state.velocity[:, 0] = 300.0
    with pytest.raises(RuntimeError, match="no step"):
        vessel.reach(0.1)


def test_walls_point_to_the_liquid_between_them():
    walls = planes(FLOOR, *ends(2.0, axis=1))
    assert walls.rotation[:, :, 2] == pytest.approx(np.array([[0, 0, 1], [0, 1, 0], [0, -1, 0]]))
    assert walls.centre == pytest.approx(np.array([[0, 0, 0], [0, 0, 0], [0, 2, 0]]))
