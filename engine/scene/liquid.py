"""What a scene may say about liquid: where it is, where it comes from and goes to. Units are SI, angles are in degrees."""

from typing import Annotated, Literal, Self

from pydantic import Field, Strict, model_validator

from engine.scene.quantities import Angles, Few, Length, Many, Name, Part, Positive, Share, Triangle, Vector

Axis = Literal["x", "y", "z"]
Side = Literal["left", "right", "front", "back", "bottom", "top"]
SIDES: tuple[Side, ...] = ("left", "right", "front", "back", "bottom", "top")  # low and high x, low and high y, low and high z

_Whole = Literal[1, 8, 27, 64]  # cubes: a lattice has as many particles along each side of a cell
_Time = Annotated[float, Field(ge=0, le=1e6)]


class Region(Part):
    """A box whose sides are along the axes."""

    low: Vector
    """Corner with the least coordinates [m]."""
    high: Vector
    """Corner with the largest [m]."""

    @model_validator(mode="after")
    def _has_a_volume(self) -> Self:
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise ValueError("each coordinate of low less than that of high")
        return self


class Wave(Part):
    """A wave of the free surface: its height is amplitude cos(2 pi x / wavelength), from the low side of the box."""

    amplitude: Length
    """[m]"""
    wavelength: Length
    """[m]"""


class _Seeded(Part):
    velocity: Vector = (0.0, 0.0, 0.0)
    """Of its middle [m/s]."""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """About the x, y, z axes through its middle, as one vector [degrees/s]."""
    particles_per_cell: _Whole | None = None
    """By default that of the liquid."""


class LiquidBox(_Seeded, Region):
    """A box whose sides are along the axes; particles are spread so that they fill it exactly."""

    shape: Literal["box"]
    wave: Wave | None = None
    """Of its top (high z). What is below is stretched upright, evenly from the bottom on."""

    @model_validator(mode="after")
    def _has_a_trough(self) -> Self:
        if self.wave is not None and self.wave.amplitude >= self.high[2] - self.low[2]:
            raise ValueError("an amplitude of the wave less than the height of the box")
        return self


class LiquidBall(_Seeded):
    """A ball."""

    shape: Literal["ball"]
    centre: Vector
    """[m]"""
    radius: Length


class LiquidCylinder(_Seeded):
    """A cylinder."""

    shape: Literal["cylinder"]
    centre: Vector
    """Its middle [m]."""
    axis: Vector = (0.0, 0.0, 1.0)
    """Any vector along its axis."""
    radius: Length
    height: Length


class LiquidMesh(_Seeded):
    """What a closed surface of triangles holds."""

    shape: Literal["mesh"]
    file: Annotated[str, Field(min_length=1, max_length=255)] | None = None
    """STL, OBJ, PLY or GLB file beside the scene's own, or below it; read when the scene is, from a file only."""
    vertices: Many[Vector] = ()
    """Corners in the body's own frame [m]."""
    faces: Many[Triangle] = ()
    """Triangles as indices of three vertices, all turned the same way seen from outside."""
    position: Vector = (0.0, 0.0, 0.0)
    """Where the origin of its own frame is [m]; it turns about this place."""
    rotation: Angles = (0.0, 0.0, 0.0)
    """Rotations about the fixed x, y, z axes through `position`, in this order."""


LiquidShape = Annotated[LiquidBox | LiquidBall | LiquidCylinder | LiquidMesh, Field(discriminator="shape")]


class Nozzle(Part):
    """An opening from which liquid flows at an even speed: speed times area times time, in whole layers of particles."""

    centre: Vector
    """[m]"""
    direction: Vector
    """Any vector along the flow."""
    radius: Length | None = None
    """Of a round opening [m]; this or `rectangle`."""
    rectangle: Annotated[tuple[Length, Length], Strict(False)] | None = None
    """Sides of an opening [m], the first as near to the x axis as it may be turned, to the y axis where liquid flows along x."""
    speed: Positive
    """Relative to the opening [m/s]."""
    begin: _Time = 0.0
    """When it begins to flow [s]."""
    end: _Time | None = None
    """When it ceases to [s]; by default never."""
    handle: Name | None = None
    """Handle of `script` that carries it."""

    @model_validator(mode="after")
    def _says_each_thing_once(self) -> Self:
        if (self.radius is None) == (self.rectangle is None):
            raise ValueError("exactly one of radius and rectangle")
        return self


class Tank(Region):
    """Walls around a box, solid outside of it; cells of the grid begin at its low corner."""

    open: Few[Side] = ("top",)
    """Sides without a wall: left and right have the least and the largest x, front and back the least and the largest y,
    bottom and top the least and the largest z. Sides across an axis that is `periodic` have none either."""


class Liquid(Part):
    """Liquid of one kind: particles that move on a grid of cells, of which only those near to them are there."""

    material: Name
    """Preset or name in `liquid_materials`."""
    spacing: Length
    """Size of the grid's cells [m]."""
    particles_per_cell: _Whole = 8
    """Particles that a cell full of liquid has."""
    jitter: Share = 0.0
    """How far particles are from their places on a regular lattice, over half of its spacing, at most."""
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    """Of the jitter; the same one gives the same particles."""
    walls: Literal["slip", "no-slip"] | None = None
    """Whether liquid slides along obstacles and walls; by default it does where its material has no shear modulus, and always
    where it has no viscosity."""
    initial: Few[LiquidShape] = ()
    """What is full of liquid at the start; shapes that overlap hold it once, as the first of them says. There is none in
    obstacles nor beyond walls."""
    sources: Few[Nozzle] = ()
    sinks: Few[Region] = ()
    """Boxes that take away what enters them."""
    tank: Tank | None = None
    periodic: Annotated[tuple[Axis, ...], Strict(False), Field(max_length=3)] = ()
    """Axes along which the world repeats itself after the length of the tank or, without one, of `bounds`: a multiple of
    8 cells, or 4 cells."""
    bounds: Region | None = None
    """Box beyond which liquid is removed; by default one that reaches twenty times as far as all that is there at the start."""

    @property
    def pitch(self) -> float:
        """Distance of particles on their lattice [m]."""
        return pitch(self.spacing, self.particles_per_cell)

    @property
    def repeated(self) -> Region | None:
        """What the world repeats along the axes that are periodic."""
        return self.tank or self.bounds


def pitch(spacing: float, particles_per_cell: int) -> float:
    """Return the distance of particles on a lattice with so many in a cell of `spacing` [m]."""
    return spacing / round(particles_per_cell ** (1 / 3))
