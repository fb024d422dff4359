"""What a scene may say. All units are SI but for yarns per inch, angles are in degrees."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, Strict, Tag, model_validator

from engine.scene.materials import Material
from engine.scene.patterns import PatternName
from engine.scene.quantities import (
    Angles,
    Count,
    Extent,
    Few,
    Friction,
    Length,
    Many,
    Name,
    OneOrPair,
    Part,
    Place,
    Positive,
    Seconds,
    Several,
    Sizes,
    Text,
    Triangle,
    Vector,
    by_form,
)
from engine.scene.steps import Step, StrandStep
from engine.scene.strand_groups import Strands

INCH = 0.0254  # [m]


class Hold(Part):
    """How one end of a yarn is held."""

    hold: Literal["free", "pinned", "clamped"] = "free"
    """`pinned` fixes the position, `clamped` the direction too: the end and the fixed point next to it."""
    handle: Name | None = None
    """Handle of `script` that carries the end."""


class Eyelet(Part):
    """A fixed place that a yarn slides through."""

    point: Annotated[int, Field(ge=1, le=100_000)]
    """Index of the point of the yarn that the eyelet holds, neither the first nor the last."""
    friction: Friction = 0.0


class Yarn(Part):
    """A single rod along a line of points."""

    name: Name
    material: Name
    points: Annotated[Many[Vector], Field(min_length=2)]
    """Corners of the line [m]. All but those with an eyelet or a crossing are fixed points of the discretisation."""
    segments: Count = 1
    """Further fixed points divide the line so that no segment is longer than its length over this."""
    length_factor: Annotated[float, Field(ge=0.1, le=10)] = 1.0
    """Undeformed length over the length of the line; above 1 the yarn is slack."""
    start: Hold = Hold()
    end: Hold = Hold()
    kinematic: bool = False
    """The shape is given: all fixed points are pinned."""
    eyelets: Many[Eyelet] = ()


class YarnPoint(Part):
    """One of the points of a single yarn."""

    yarn: Name
    point: Annotated[int, Field(ge=1, le=100_000)]
    """Index in the `points` of the yarn, neither the first nor the last."""


class Crossing(Part):
    """A place where two single yarns touch, each at one of its points; the two points coincide."""

    lower: YarnPoint
    upper: YarnPoint
    up: Vector = (0.0, 0.0, 1.0)
    """Any vector from the lower to the upper yarn."""
    friction: Friction = 0.0
    kind: Literal["crossing", "contact", "stitch"] = "crossing"
    """A `crossing` stays, a `contact` ends where the yarns part, at a `stitch` neither yarn slides."""


Edge = Literal["left", "right", "bottom", "top"]
"""Side of a patch, seen from above: wefts run from left to right, warps from bottom to top."""

_Row = Annotated[tuple[Literal[0, 1], ...], Strict(False), Field(min_length=1, max_length=64)]
_Rows = Annotated[tuple[_Row, ...], Strict(False), Field(min_length=1, max_length=64)]
Pattern = Annotated[Annotated[PatternName, Tag("single")] | Annotated[_Rows, Tag("list")], by_form]


class EdgeHold(Part):
    """How the yarn ends along one edge of a patch are held."""

    edge: Edge
    """Where yarns end: warps at `bottom` and `top`, wefts at `left` and `right`."""
    extent: Extent = (0.0, 1.0)
    """Part of the edge, as shares of its length from left to right or from bottom to top."""
    hold: Literal["pinned", "clamped"] = "pinned"
    """`pinned` fixes the positions of the ends, `clamped` those of the crossings next to them too."""
    handle: Name | None = None
    """Handle of `script` that carries them."""


class Fabric(Part):
    """A woven patch: warps run along its y axis, wefts along its x axis."""

    name: Name
    material: Name
    """Material of the warps and, without `weft_material`, of the wefts."""
    weft_material: Name | None = None
    warp_stripes: Several[Name] = ()
    """Materials of the warps one by one from the left, over and over; `material` where there are none."""
    weft_stripes: Several[Name] = ()
    """Materials of the wefts one by one from the bottom, over and over; in place of `weft_material`."""
    pattern: Pattern = "plain"
    """Which yarn is on top: a name, or one repeat as rows of 0 and 1, 1 where the warp is over the weft. Rows are wefts
    from the bottom up, their entries warps from the left. Twills are right-hand, satins warp-faced, denim is twill-3/1."""
    warps: Annotated[int, Field(ge=2, le=100_000)]
    """Number of yarns along y."""
    wefts: Annotated[int, Field(ge=2, le=100_000)]
    """Number of yarns along x."""
    spacing: OneOrPair[Length] | None = None
    """Distance of neighbouring yarns [m], or of [warps, wefts]; yarns end half of it beyond the last crossing. This or
    `yarns_per_inch`."""
    yarns_per_inch: OneOrPair[Positive] | None = None
    """Yarns per inch of cloth, or [warps, wefts] per inch; this or `spacing`."""
    outline: Annotated[tuple[Place, ...], Strict(False), Field(min_length=3, max_length=256)] | None = None
    """Corners [x, y] of a polygon in the plane of the patch about its centre [m], to which yarns are cut; it must not
    cross itself. Without it the patch is the whole rectangle of warps and wefts."""
    position: Vector = (0.0, 0.0, 0.0)
    """Centre of the patch [m]."""
    rotation: Angles = (0.0, 0.0, 0.0)
    """Rotations about the fixed x, y, z axes through the centre, in this order."""
    segments_per_crossing: Annotated[int, Field(ge=1, le=8)] = 1
    """Segments of a yarn between neighbouring crossings: with more than one, fixed points of the discretisation lie between
    them, and between an end and the crossing next to it where these are further apart than such a segment is long."""
    friction: Friction = 0.5
    """Friction of warps on wefts."""
    crimp: Literal["flat", "set", "free"] = "flat"
    """Where centre lines pass that stretch and bend: through the point at which two yarns touch (`flat`), or at their radii
    from it, bent without force as they are woven (`set`), or pressed into the weave (`free`), which then spreads. The
    latter two cost several times as much, and are for fabrics without `contacts` and `outline` in scenes
    without `edges` of boxes. Yarns that are `set` press and rub on each other only as loads make them."""
    kinematic: bool = False
    """The patch is rigid and stays where it is."""
    pins: Literal["none", "corners", "edges"] = "none"
    """Yarn ends pinned in space: those of the first and last warp and weft (`corners`) or all (`edges`)."""
    holds: Few[EdgeHold] = ()
    """What holds the edges; of two that hold the same point, the later one does."""
    obstacle_distance: Length | None = None
    """Distance at which obstacles begin to push [m]. By default the radius times 0.9 to the power of the number of
    fabrics that `contacts` puts below this one: layers coincide, and the lowest should carry those above it."""

    @model_validator(mode="after")
    def _says_each_thing_once(self) -> Self:
        if (self.spacing is None) == (self.yarns_per_inch is None):
            raise ValueError("exactly one of spacing and yarns_per_inch")
        if self.weft_material is not None and self.weft_stripes:
            raise ValueError("at most one of weft_material and weft_stripes")
        return self

    @property
    def spacings(self) -> tuple[float, float]:
        """Distances of neighbouring warps and of neighbouring wefts [m]."""
        given = self.spacing if self.yarns_per_inch is None else self.yarns_per_inch
        assert given is not None  # the validator saw to it
        warps, wefts = given if isinstance(given, tuple) else (given, given)
        return (warps, wefts) if self.yarns_per_inch is None else (INCH / warps, INCH / wefts)

    @property
    def yarn_materials(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of the materials of warps and of wefts, each over and over."""
        return self.warp_stripes or (self.material,), self.weft_stripes or (self.weft_material or self.material,)


class Seam(Part):
    """A strip along an edge of the upper patch in which it is sewn onto the lower one."""

    edge: Edge
    """Side of the upper patch's whole rectangle, whatever its outline."""
    width: Length | None = None
    """Width of the strip [m], by default twice the spacing of the yarns along the edge."""


class Contact(Part):
    """Two fabrics, one on top of the other in one plane. Their yarns touch where they cross at the start."""

    lower: Name
    upper: Name
    friction: Friction = 0.5
    min_angle: Annotated[float, Field(ge=1, le=90)] = 45.0
    """Yarns touch where they cross at this angle at least."""
    reach: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Yarns that would cross if they were longer by this [m] at both ends may come to touch, with `step.dynamic_contacts`."""
    seams: Few[Seam] = ()
    """Where the two are sewn together: yarns that touch there never slide nor part."""


class _Solid(Part):
    name: Name | None = None
    """What grooms call it."""
    position: Vector = (0.0, 0.0, 0.0)
    """Centre [m], for a plane any of its points."""
    rotation: Angles = (0.0, 0.0, 0.0)
    """Rotations about the fixed x, y, z axes through `position`, in this order."""
    friction: Friction = 0.5
    handle: Name | None = None
    """Handle of `script` that carries the obstacle; it drags along what rubs on it."""


class Plane(_Solid):
    """A plane, solid below its local z axis."""

    shape: Literal["plane"]


class Box(_Solid):
    """A box."""

    shape: Literal["box"]
    size: Sizes
    """Lengths of its sides [m]."""
    edges: bool = False
    """Yarns of fabrics that lie on the top (local z) at the start slide over its edges on nodes of their own, where
    they cross the edges at 10 degrees or more. Over another fabric they do so with the friction of the two fabrics. A yarn
    that slides to an end of an edge leaves it. Such a box stays where it is."""


class Sphere(_Solid):
    """A ball."""

    shape: Literal["sphere"]
    radius: Length


class Cylinder(_Solid):
    """A cylinder along its local z axis."""

    shape: Literal["cylinder"]
    radius: Length
    height: Length


class MeshShape(Part):
    """What a mesh has become at a time."""

    time: Annotated[float, Field(gt=0, le=1e6)]
    """[s]; at 0 s the mesh has its own vertices."""
    file: Annotated[str, Field(min_length=1, max_length=255)] | None = None
    """A file as that of the mesh with the same triangles in the same order; this or `vertices`."""
    vertices: Many[Vector] = ()
    """The vertices of the mesh, in their order, where they are then, in the body's own frame [m]."""


class Mesh(_Solid):
    """A body with a closed surface of triangles, felt through samples of its distance."""

    shape: Literal["mesh"]
    file: Annotated[str, Field(min_length=1, max_length=255)] | None = None
    """STL, OBJ, PLY or GLB file beside the scene's own, or below it; read when the scene is, from a file only."""
    vertices: Many[Vector] = ()
    """Corners in the body's own frame [m]."""
    faces: Many[Triangle] = ()
    """Triangles as indices of three vertices, all turned the same way seen from outside."""
    resolution: Length | None = None
    """Spacing of the samples [m], by default 1/64 of the longest side; edges are rounded by about as much."""
    shapes: Few[MeshShape] = ()
    """What it changes to, by ascending time: vertices move evenly from one shape to the next and rest after the last. Strands
    of a groom on it go with the triangles that they grow on, and turn with them; all that touches it feels the new shape.
    Friction drags along as `handle` moves it, not as the shape changes."""


Obstacle = Annotated[Plane | Box | Sphere | Cylinder | Mesh, Field(discriminator="shape")]


class Collisions(Part):
    """How yarns keep apart where no crossing or contact joins them: cloth and cloth, or parts of one."""

    self: bool = False
    """Whether they do. It costs a search in every step; friction does not act there."""
    thickness: Annotated[float, Field(ge=0.1, le=10)] = 1.0
    """Distance at which their centre lines begin to push, over the sum of their radii."""
    stiffness: Positive = 1.0
    """Stiffness of the push, over stretch stiffness / rest segment."""
    spacing: Annotated[float, Field(ge=0.1, le=2.5)] = 0.5
    """Distance of the spheres that stand for a yarn, in its radii, at most."""


class Keyframe(Part):
    """Where a handle is at a time."""

    time: Annotated[float, Field(ge=0, le=1e6)]
    """[s]"""
    offset: Vector = (0.0, 0.0, 0.0)
    """Translation from the start [m]."""
    rotation: Angles = (0.0, 0.0, 0.0)
    """Rotations from the start about the fixed x, y, z axes through the pivot, in this order, before the translation."""


class Handle(Part):
    """Something that moves what it holds: linear in time between keyframes, still before and after."""

    name: Name
    pivot: Vector = (0.0, 0.0, 0.0)
    """Place that rotations leave where it is [m]."""
    keyframes: Annotated[Many[Keyframe], Field(min_length=1)]
    """By ascending time."""


class Script(Part):
    """What is moved."""

    handles: Few[Handle] = ()


class Output(Part):
    """What a job leaves behind."""

    frames: bool = True
    """Write a file for each frame."""
    recording: bool = True
    """Write the recording that the Rerun viewer plays."""
    checkpoint_every: Count = 10
    """Frames from one checkpoint to the next."""
    surface: bool = False
    """Write a mesh of the liquid's surface into every frame."""
    error_estimate: bool = False
    """Repeat sampled steps as two half steps and report the difference."""


class Scene(Part):
    """A scene: yarns and fabrics or strands, what they touch, what moves them, and how they are simulated."""

    strandline: Literal[1]
    """Version of the format."""
    name: Annotated[Text, Field(min_length=1, max_length=200)]
    description: Text = ""
    gravity: Vector = (0.0, 0.0, -9.81)
    """[m/s^2]"""
    duration: Seconds
    """Simulated time [s]."""
    fps: Annotated[float, Field(ge=1e-3, le=1e6)] = 30.0
    """Frames per simulated second."""
    step: Step = Step()
    strand_step: StrandStep = StrandStep()
    materials: Annotated[dict[Name, Material], Field(max_length=1000, default_factory=dict)]
    """Materials by name, beside the presets."""
    yarns: Several[Yarn] = ()
    crossings: Many[Crossing] = ()
    fabrics: Few[Fabric] = ()
    contacts: Several[Contact] = ()
    contact: Collisions = Collisions()
    strands: Several[Strands] = ()
    obstacles: Few[Obstacle] = ()
    script: Script = Script()
    output: Output = Output()


def scene_schema() -> dict[str, Any]:
    """Return the JSON Schema of a scene."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | Scene.model_json_schema()
