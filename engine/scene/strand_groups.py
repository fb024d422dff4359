"""What a scene may say about strands: hair, fur, bristles, single rods. Units are SI, angles are in degrees."""

from typing import Annotated, Literal, Self

from pydantic import Field, Strict, model_validator

from engine.scene.quantities import Angles, Friction, Length, Many, Name, Part, Share, Vector

STRAND_LIMIT = 100_000  # of one groom
MOST_VERTICES = 1000  # of one strand
GROOMED_VERTICES = 16  # of one strand of a groom, by default

_Curve = Annotated[Many[Vector], Field(min_length=2)]
_Sides = Annotated[tuple[Length, Length], Strict(False)]
_Ratio = Annotated[float, Field(ge=0.01, le=100)]


class StrandHold(Part):
    """How one end of every strand is held."""

    hold: Literal["free", "pinned", "clamped"] | None = None
    """`pinned` fixes the position of the end, `clamped` its direction and turn too: the last two vertices and the edge
    between them. By default the roots of grooms are clamped, all other ends free."""
    handle: Name | None = None
    """Handle of `script` that carries the end; by default that of the obstacle which a groom grows on carries its roots."""


class Curl(Part):
    """A helix around the way that a strand would take without it. All turn alike, so that neighbours nest."""

    radius: Length
    """Of the helix [m], reached after the first turn."""
    pitch: Length
    """Way along its axis in one turn [m]."""


class Clump(Part):
    """Tufts: strands draw near to one in their middle, the more the nearer to the tips."""

    count: Annotated[int, Field(ge=1, le=STRAND_LIMIT)]
    """Number of tufts."""
    strength: Share = 0.7
    """Share of their distance by which tips draw nearer; strands keep apart by their own thickness."""


class Groom(Part):
    """Strands that grow on a surface, their roots spread evenly."""

    on: Name | None = None
    """Obstacle whose surface it is, of a cylinder its side, of a plane none; this or `rectangle`."""
    rectangle: _Sides | None = None
    """Sides along x and y [m] of a flat ground from which strands grow along z; this or `on`."""
    position: Vector = (0.0, 0.0, 0.0)
    """Centre of the rectangle [m]."""
    rotation: Angles = (0.0, 0.0, 0.0)
    """Rotations of the rectangle about the fixed x, y, z axes through its centre, in this order."""
    facing: Vector | None = None
    """Only where the surface faces this way, the strands grow; everywhere by default."""
    within: Annotated[float, Field(gt=0, le=180)] = 90.0
    """Angle to `facing` within which it does."""
    count: Annotated[int, Field(ge=1, le=STRAND_LIMIT)]
    """Number of strands."""
    length: Length
    """Length of the strands, along their curls [m]."""
    length_spread: Annotated[float, Field(ge=0, le=0.9)] = 0.0
    """Lengths differ at random by up to this share of `length`, either way."""
    direction: Vector | None = None
    """Way to which strands are combed; by default they stand upright on the surface."""
    lean: Share = 0.5
    """From upright (0) to `direction` (1). They always rise a little from the surface."""
    curl: Curl | None = None
    clump: Clump | None = None
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    """Of all that is random; the same one gives the same strands."""

    @model_validator(mode="after")
    def _says_each_thing_once(self) -> Self:
        if (self.on is None) == (self.rectangle is None):
            raise ValueError("exactly one of on and rectangle")
        if self.on is not None and any((*self.position, *self.rotation)):
            raise ValueError("position and rotation with rectangle only: an obstacle has its own")
        return self


class Strands(Part):
    """A group of strands of one kind."""

    name: Name
    material: Name
    """One whose bending follows from its section: without stiffness or modulus of bending, without stiffness in shear."""
    width_ratio: _Ratio = 1.0
    """Second semi-axis of an elliptic section over the first, which is the radius of the material."""
    normal: Vector | None = None
    """What the first semi-axis is along at the root, as far as it is across the strand there; by default any direction."""
    tip_ratio: _Ratio = 1.0
    """Thickness at the tip over that at the root; linear in between."""
    friction: Friction = 0.3
    """Coulomb coefficient; of two different strands, the geometric mean of theirs."""
    curves: Many[_Curve] = ()
    """Each strand as points from the root to the tip [m]; this, `file` or `groom`."""
    file: Annotated[str, Field(min_length=1, max_length=255)] | None = None
    """OBJ with lines (`l`) or CSV with columns strand, x, y, z, beside the scene's own file or below it; read when the scene
    is, from a file only."""
    groom: Groom | None = None
    vertices: Annotated[int, Field(ge=3, le=MOST_VERTICES)] | None = None
    """Vertices of each strand, at even distances. By default 16 in grooms; curves keep their own points."""
    root: StrandHold = StrandHold()
    tip: StrandHold = StrandHold()
    rest: Literal["as-is", "straight"] = "as-is"
    """Shape without forces: as the strands are at the start, or straight with edges as long."""

    @model_validator(mode="after")
    def _says_each_thing_once(self) -> Self:
        if sum((bool(self.curves), self.file is not None, self.groom is not None)) != 1:
            raise ValueError("exactly one of curves, file and groom")
        return self

    @property
    def vertex_counts(self) -> tuple[int, ...]:
        """Number of vertices of each strand."""
        if self.groom is not None:
            return (self.vertices or GROOMED_VERTICES,) * self.groom.count
        return tuple(self.vertices or len(curve) for curve in self.curves)

    def ends(self, carrier: str | None) -> tuple[StrandHold, StrandHold]:
        """Return how roots and tips are held, nothing left to defaults; `carrier` is the handle of what a groom grows on."""
        root = StrandHold(hold=self.root.hold or ("free" if self.groom is None else "clamped"), handle=self.root.handle)
        if root.handle is None and root.hold != "free":
            root = root.model_copy(update={"handle": carrier})
        return root, StrandHold(hold=self.tip.hold or "free", handle=self.tip.handle)

    def widest(self, radius: float) -> float:
        """Return the largest semi-axis of the strands [m]; `radius` is that of their material."""
        return radius * max(1.0, self.width_ratio) * max(1.0, self.tip_ratio)
