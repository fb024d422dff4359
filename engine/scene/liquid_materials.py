"""Materials of liquids as scenes give them, presets among them, and the constants that the engine takes."""

from math import inf, sqrt
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from engine.scene.quantities import NotNegative, Part, Positive


class LiquidMaterial(Part):
    """What a liquid is made of. It is incompressible and without viscosity where nothing else is given."""

    density: Positive
    """Mass per volume at rest [kg/m^3]."""
    bulk_modulus: Positive | None = None
    """kappa [Pa] of a liquid with air in it; incompressible where not given."""
    shear_modulus: Positive | None = None
    """mu [Pa], with which it resists shear until it flows; where not given it is Newtonian, and keeps no elastic strain."""
    yield_stress: NotNegative = 0.0
    """Shear stress [Pa] below which it does not flow: t_Y, or tau_Y in the convention of the thesis."""
    consistency: NotNegative = 0.0
    """Of flow [Pa s^n]: K of shear stress t_Y + K rate^n, of a Newtonian liquid its viscosity; or eta of the thesis."""
    flow_index: Annotated[float, Field(ge=0.2, le=1.5)] = 1.0
    """n: below 1 it thins with the rate of shear, above 1 it thickens."""
    surface_tension: NotNegative = 0.0
    """Force per length of its surface [N/m]."""
    tearing_strain: Positive | None = None
    """Plastic strain beyond which it bears no tension; it never tears where not given."""
    recovery_rate: NotNegative = 0.0
    """Rate [1/s] at which it forgets plastic strain, so that it mends."""
    convention: Literal["rheometer", "thesis"] = "rheometer"
    """What `yield_stress` and `consistency` are: those that a rheometer measures in simple shear, or those of the thesis (Fei
    2019, eq. 13.13), which are of the norm of stress: tau_Y = sqrt(3) t_Y, eta = sqrt(2) 2^(n/2) K."""

    @model_validator(mode="after")
    def _has_what_its_flow_needs(self) -> Self:
        if self.shear_modulus is None:
            if self.yield_stress > 0.0:
                raise ValueError("yield_stress needs a shear_modulus: below yield a liquid is elastic")
            if self.flow_index != 1.0:
                raise ValueError("flow_index other than 1 needs a shear_modulus: its stress is that of an elastic strain")
            if self.tearing_strain is not None:
                raise ValueError("tearing_strain needs a shear_modulus: without one nothing counts plastic strain")
        elif self.yield_stress == 0.0 and self.consistency == 0.0:
            raise ValueError("shear_modulus needs a yield_stress or a consistency: without both, flow leaves no elastic strain")
        if self.recovery_rate > 0.0 and self.tearing_strain is None:
            raise ValueError("recovery_rate needs a tearing_strain: only tearing asks for plastic strain")
        return self


class LiquidConstants(NamedTuple):
    """The first fields of `LiquidModel`, in its units and its convention of stress."""

    density: float
    bulk_modulus: float
    shear_modulus: float
    yield_stress: float
    consistency: float
    flow_index: float
    surface_tension: float
    tearing_strain: float
    recovery_rate: float


# Fei 2019, Table 15.2, as printed but in SI: a tenth of its dyne/cm^2 and Ba s^n. Its two Newtonian liquids have a physical
# viscosity, 8.9e-4 Pa s of water at 25 C: taken for eta it would flow with half of that, as eta/2 is the viscosity of
# eq. 13.15, so here it is what a rheometer measures. Which are incompressible is what sec. 15.5 says.
LIQUID_PRESETS = {
    "water": LiquidMaterial(density=1000.0, consistency=8.9e-4),
    "tetrachloroethylene": LiquidMaterial(density=1622.0, consistency=8.9e-4),
    "drilling-mud": LiquidMaterial(
        density=1220.0, shear_modulus=100.0, yield_stress=1.6813, consistency=0.6496, flow_index=0.5173, convention="thesis",
    ),
    "acrylic-paint": LiquidMaterial(
        density=950.0, shear_modulus=400.0, yield_stress=0.96, consistency=17.356, flow_index=0.3162, convention="thesis",
    ),
    "milk-cream": LiquidMaterial(
        density=275.0, bulk_modulus=1.09e5, shear_modulus=1600.0, yield_stress=120.0, consistency=5.0, flow_index=0.27,
        convention="thesis",
    ),
    "shaving-cream": LiquidMaterial(
        density=200.0, bulk_modulus=1.09e5, shear_modulus=290.0, yield_stress=31.9, consistency=27.2, flow_index=0.22,
        convention="thesis",
    ),
    "oyster-sauce": LiquidMaterial(
        density=1207.0, shear_modulus=400.0, yield_stress=2.65, consistency=1.61, flow_index=0.62, convention="thesis",
    ),
    "milk-chocolate": LiquidMaterial(
        density=950.0, bulk_modulus=4.28e5, shear_modulus=400.0, yield_stress=30.0, consistency=2.8, flow_index=0.98,
        convention="thesis",
    ),
}


def known_liquids(materials: dict[str, LiquidMaterial]) -> dict[str, LiquidMaterial]:
    """Return the presets and a scene's own `materials` of liquids, which come first where names agree."""
    return LIQUID_PRESETS | materials


def sticks(material: LiquidMaterial, walls: Literal["slip", "no-slip"] | None) -> bool:
    """Return whether liquid sticks to `walls`: by default where it is elastic, and never without viscosity."""
    if material.shear_modulus is None and material.consistency == 0.0:
        return False
    return material.shear_modulus is not None if walls is None else walls == "no-slip"


def liquid_constants(material: LiquidMaterial) -> LiquidConstants:
    """Return the constants that the engine takes: infinite or zero where the material has none."""
    yield_stress, consistency = material.yield_stress, material.consistency
    if material.convention == "rheometer":
        yield_stress *= sqrt(3.0)
        consistency *= sqrt(2.0) * 2.0 ** (0.5 * material.flow_index)
    return LiquidConstants(
        density=material.density, bulk_modulus=material.bulk_modulus or inf, shear_modulus=material.shear_modulus or 0.0,
        yield_stress=yield_stress, consistency=consistency, flow_index=material.flow_index,
        surface_tension=material.surface_tension, tearing_strain=material.tearing_strain or inf,
        recovery_rate=material.recovery_rate,
    )
