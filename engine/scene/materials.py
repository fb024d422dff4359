"""Materials of yarns and strands as scenes give them, presets among them, and the constants that the engine takes."""

from math import pi
from typing import Annotated, Self

from pydantic import Field, model_validator

from engine.scene.quantities import NotNegative, Part, Positive
from engine.yarns.assembly import YarnMaterial

# one of each pair of keys says the same thing
_EITHER = (("linear_density", "volume_density"), ("stretch_stiffness", "youngs_modulus"))
_AT_MOST = ("bending_stiffness", "bending_modulus")


class Material(Part):
    """What a yarn or strand is made of. Damping, and stiffness in bending and shear, are zero where not given."""

    radius: Annotated[float, Field(ge=1e-7, le=10)]
    """Radius R [m]."""
    linear_density: Positive | None = None
    """Mass per undeformed length rho [kg/m]; this or `volume_density`."""
    volume_density: Positive | None = None
    """Mass per volume [kg/m^3] of the round yarn, the air in it included; this or `linear_density`."""
    stretch_stiffness: Positive | None = None
    """Force per strain k_s [N]; this or `youngs_modulus`."""
    youngs_modulus: Positive | None = None
    """Y [Pa], for k_s = Y pi R^2; this or `stretch_stiffness`."""
    bending_stiffness: NotNegative | None = None
    """k_b = E I [N m^2]; this or `bending_modulus` or neither."""
    bending_modulus: NotNegative | None = None
    """E [Pa], for k_b = E pi R^4/4; far below Young's modulus in yarns, whose fibres slide on each other."""
    shear_stiffness: NotNegative = 0.0
    """k_x [N], with which crossings within a fabric hold each pair of a warp and a weft segment at right angles: a fabric of
    shear rigidity G [N/m], of the order of 50 N/m for light cotton, has k_x = G spacing / 4. It jams where yarns meet."""
    mass_damping: NotNegative = 0.0
    """Damping alpha [1/s] of all motion."""
    stretch_damping: NotNegative = 0.0
    """Damping beta [s] of the rate of stretch, of strands also of those of bending and twist, relative to the stiffness."""
    poisson_ratio: Annotated[float, Field(gt=-1, le=0.5)] = 0.35
    """Of strands, for their stiffness in twist; yarns have none."""

    @model_validator(mode="after")
    def _says_each_thing_once(self) -> Self:
        for pair in _EITHER:
            if sum(getattr(self, name) is not None for name in pair) != 1:
                raise ValueError(f"exactly one of {pair[0]} and {pair[1]}")
        if None not in [getattr(self, name) for name in _AT_MOST]:
            raise ValueError(f"at most one of {_AT_MOST[0]} and {_AT_MOST[1]}")
        return self


PRESETS = {
    # the radius of the tablecloths of Sánchez-Banderas 2020; cotton of which half the volume is air
    "cotton-thick": Material(
        radius=2.25e-3, volume_density=770.0, youngs_modulus=5e5, bending_modulus=1e5,
        mass_damping=0.1, stretch_damping=1e-3,
    ),
    # the yarn of published research code on woven cloth, for a spacing of 1 mm
    "cotton-fine": Material(
        radius=0.5e-3, linear_density=2e-3, youngs_modulus=5e5, bending_modulus=1.6e3,
        mass_damping=0.1, stretch_damping=1e-3,
    ),
    # Cotton as above, for 44 yarns an inch: 0.57 kg/m^2. Stiffness such that a strip extends by 5 % under 490 N/m and the
    # cloth has a bending rigidity of 1.6e-5 N m, as Kawabata's tests of six denims found (4.7 to 5.7 %, 1.4e-5 to
    # 2.2e-5 N m: Journal of Textiles 2016, 4614168, table 5).
    "denim": Material(
        radius=0.26e-3, volume_density=770.0, youngs_modulus=2.5e7, bending_modulus=2.5e6,
        mass_damping=0.1, stretch_damping=1e-3,
    ),
    # human hair, a strand
    "hair": Material(radius=4e-5, volume_density=1300.0, youngs_modulus=3e9, mass_damping=1.0, stretch_damping=1e-4),
}


def known_materials(materials: dict[str, Material]) -> dict[str, Material]:
    """Return the presets and a scene's own `materials`, which come first where names agree."""
    return PRESETS | materials


def yarn_material(material: Material) -> YarnMaterial:
    """Return the constants that the engine takes."""
    area = pi * material.radius**2
    density, stretch, bending = material.linear_density, material.stretch_stiffness, material.bending_stiffness
    if material.volume_density is not None:
        density = material.volume_density * area
    if material.youngs_modulus is not None:
        stretch = material.youngs_modulus * area
    if material.bending_modulus is not None:
        bending = material.bending_modulus * area * material.radius**2 / 4
    assert density is not None and stretch is not None  # the validator saw to it
    return YarnMaterial(
        radius=material.radius, density=density, stretch_stiffness=stretch, bending_stiffness=bending or 0.0,
        shear_stiffness=material.shear_stiffness, mass_damping=material.mass_damping, stretch_damping=material.stretch_damping,
    )
