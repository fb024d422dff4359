"""Materials of liquids: what they need, both conventions, the presets as Table 15.2 has them."""

from math import inf, isinf, sqrt

import pytest
from pydantic import ValidationError

from engine.liquid.model import LiquidModel
from engine.scene.liquid_materials import LIQUID_PRESETS, LiquidConstants, LiquidMaterial, known_liquids, liquid_constants


def test_what_is_absent_is_infinite_or_zero():
    constants = liquid_constants(LiquidMaterial(density=1000.0))
    assert constants == LiquidConstants(1000.0, inf, 0.0, 0.0, 0.0, 1.0, 0.0, inf, 0.0)
    assert LiquidModel._fields[: len(constants)] == LiquidConstants._fields


@pytest.mark.parametrize("n", [0.3, 1.0, 1.4])
@pytest.mark.parametrize("rate", [0.1, 30.0])
def test_a_rheometer_measures_what_the_scene_says(n, rate):
    """Norms of stress and flow in simple shear are sqrt(2) times the stress, and 1/sqrt(2) of the rate."""
    liquid = liquid_constants(LiquidMaterial(density=1.0, shear_modulus=1.0, yield_stress=3.0, consistency=2.0, flow_index=n))
    norm = sqrt(2.0 / 3.0) * liquid.yield_stress + liquid.consistency * (rate / sqrt(2.0)) ** n
    assert norm / sqrt(2.0) == pytest.approx(3.0 + 2.0 * rate**n)


def test_figures_of_the_thesis_are_taken_as_they_are():
    mud = liquid_constants(LIQUID_PRESETS["drilling-mud"])
    assert (mud.density, mud.shear_modulus, mud.yield_stress, mud.consistency) == (1220.0, 100.0, 1.6813, 0.6496)
    assert len(LIQUID_PRESETS) == 8
    for name, material in LIQUID_PRESETS.items():
        constants = liquid_constants(material)
        assert isinf(constants.bulk_modulus) == (name not in ("milk-cream", "shaving-cream", "milk-chocolate"))


def test_water_has_the_viscosity_of_water():
    assert liquid_constants(LIQUID_PRESETS["water"]).consistency / 2.0 == pytest.approx(8.9e-4)


@pytest.mark.parametrize(("wrong", "message"), [
    ({"yield_stress": 1.0}, "yield_stress needs a shear_modulus"),
    ({"flow_index": 0.5}, "flow_index other than 1 needs a shear_modulus"),
    ({"tearing_strain": 0.5}, "tearing_strain needs a shear_modulus"),
    ({"shear_modulus": 5.0}, "needs a yield_stress or a consistency"),
    ({"recovery_rate": 5.0}, "recovery_rate needs a tearing_strain"),
    ({"flow_index": 0.1}, "flow_index"), ({"convention": "poise"}, "convention"), ({"density": 0.0}, "density"),
])
def test_what_makes_no_liquid_is_refused(wrong, message):
    with pytest.raises(ValidationError, match=message):
        LiquidMaterial(**({"density": 1000.0} | wrong))


def test_a_scenes_own_liquid_comes_first():
    own = LiquidMaterial(density=1025.0)
    known = known_liquids({"water": own, "sea": own})
    assert known["water"] is own and known["sea"] is own and "oyster-sauce" in known
