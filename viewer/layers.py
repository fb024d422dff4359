"""What a frame looks like: pure functions from state to coloured primitives.

The live page and the recorder both draw what these functions return, so a colour means the same in both. Lengths are
in metres, colours are 8-bit sRGB. Shapes below use S segments, M points, K line nodes, Y yarns.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from engine.contact.obstacles import ObstacleKind
from engine.geometry.solids import Solids
from engine.run.frames import Frame, LiquidFrame, StrandFrame, YarnFrame
from engine.yarns.model import NodeState
from viewer import curves
from viewer.detail import line_yarns
from viewer.scales import SCALES, colours_of, in_words, limit_of
from viewer.strand_detail import scattered, vertex_strands

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Paint = Literal[
    "fabric", "group", "strain", "curvature", "force", "liquid", "speed", "pressure", "shear", "yielded"
]
# What colours can say of each, first what they say where nobody asks.
YARN_PAINTS: tuple[Paint, ...] = ("fabric", "strain")
STRAND_PAINTS: tuple[Paint, ...] = ("group", "strain", "curvature", "force")
LIQUID_PAINTS: tuple[Paint, ...] = ("liquid", "speed", "pressure", "shear", "yielded")

# Fabrics from the bottom of a stack up, green lowest as in Sánchez-Banderas 2020, Figs. 1 and 7. The hues are Okabe and
# Ito's, told apart by all common kinds of colour vision, lightened where shading would turn them muddy.
FABRIC_COLOURS = np.array(
    [(0, 150, 106), (240, 166, 20), (66, 140, 214), (204, 121, 167), (213, 106, 40), (230, 220, 110)], np.uint8
)
DARKER = 0.78
SINGLE_YARN_COLOUR = np.array((196, 178, 150), np.uint8)

# Groups of strands, the first one brown, the others in the hues of fabrics; each strand in a shade of its own, since light
# does not shade what is thinner than a pixel.
GROUP_COLOURS = np.array(
    [(146, 92, 58), (66, 140, 214), (240, 166, 20), (0, 150, 106), (204, 121, 167), (213, 106, 40), (230, 220, 110)], np.uint8
)
DARKEST = 0.6

LIQUID_COLOUR = (72, 142, 200)
YIELD_COLOURS = np.array([(132, 142, 156), (236, 150, 36)], np.uint8)
YIELD_LABELS = ("not yielded: elastic", "yielded: flows")

# Node colours of the paper's Fig. 1; Lagrangian nodes, which it does not draw, are blue.
NODE_COLOURS = {
    NodeState.LAGRANGIAN: (16, 62, 196),
    NodeState.EOL: (255, 255, 255),
    NodeState.EOL_EIL: (255, 130, 192),
    NodeState.EIL_EIL: (222, 25, 32),
}
NODE_LABELS = {
    NodeState.LAGRANGIAN: "Lagrangian: end or fixed point",
    NodeState.EOL: "EoL contact",
    NodeState.EOL_EIL: "EoL–EIL contact",
    NodeState.EIL_EIL: "EIL–EIL contact",
}

# Where nodes are shown, they and the centre lines of yarns are drawn where they are computed, in these shares of the
# yarns' radius: thin enough to see all of them.
NODE_SCALE = 0.5
LINE_SCALE = 0.2

VIEW_DIRECTION = np.array((0.62, -0.64, 0.46))  # from the scene's middle to the eye
FIELD_OF_VIEW = np.radians(35)  # a lens long enough that yarns near the border are not distorted
FILL = 1.0  # distance of the eye against that at which the ball around the scene touches the picture's border
OBSTACLE_REACH = 1.0  # an obstacle is framed if its half diagonal is below this many diagonals of the box of what moves

STRAIN_LIMIT = 0.002  # of yarns; the colours of strands end where 1 % of a frame is beyond


@dataclass(frozen=True)
class Segments:
    """Straight pieces of round yarns or strands."""

    points: Floats  # ends [m], shape [S, 2, 3]
    colours: Bytes  # at the ends, shape [S, 2, 3]
    radii: Floats  # [m], shape [S]


@dataclass(frozen=True)
class Points:
    """Balls."""

    points: Floats  # centres [m], shape [M, 3]
    colours: Bytes  # shape [M, 3]
    radii: Floats  # [m], shape [M]


def fabric_colours(fabric: NDArray[np.int64]) -> Bytes:
    """Return one colour per yarn from the fabric it belongs to (-1: a single yarn), shape [Y, 3]."""
    return np.where((fabric < 0)[:, None], SINGLE_YARN_COLOUR, FABRIC_COLOURS[fabric % len(FABRIC_COLOURS)])


def told_apart(colours: Bytes) -> Bytes:
    """Return the colours of yarns with every other one darker, for displays that do not shade lines."""
    return np.where((np.arange(len(colours)) % 2 == 1)[:, None], colours * DARKER, colours).astype(np.uint8)


def strain_colours(strain: NDArray[np.float64]) -> Bytes:
    """Return colours of stretch strains, blue compressed to red stretched, saturated at STRAIN_LIMIT, shape [K, 3]."""
    return colours_of(strain, SCALES["strain"], STRAIN_LIMIT)


def yarn_segments(yarns: YarnFrame, paint: Paint = "fabric", thickness: float = 1.0) -> Segments:
    """Return the polylines through the nodes of all yarns, at `thickness` times their real radius.

    `paint` chooses the colour of the fabric, or that of the stretch strain at each node.
    """
    yarn = line_yarns(yarns)
    first = np.flatnonzero(yarn[:-1] == yarn[1:])
    ends = np.stack([first, first + 1], axis=1)
    by_node = strain_colours(yarns.line_strain) if paint == "strain" else fabric_colours(yarns.fabric)[yarn]
    return Segments(
        yarns.line_positions[ends].astype(np.float32),
        by_node[ends],
        (thickness * yarns.radius[yarn[first]]).astype(np.float32),
    )


def paints_of(frame: Frame) -> tuple[Paint, ...]:
    """Return what colours can say about a frame, first what they say where nobody asks."""
    said = ((frame.yarns, YARN_PAINTS), (frame.strands, STRAND_PAINTS), (frame.liquid, LIQUID_PAINTS))
    there = [paint for part, paints in said if part is not None for paint in paints]
    return tuple(dict.fromkeys(there)) or YARN_PAINTS


def paint_among(paints: tuple[Paint, ...], paint: Paint | None) -> Paint:
    """Return what colours say of a part of a frame of which they can say `paints`, where they should say `paint`."""
    return paint if paint in paints else paints[0]


def group_colours(group: NDArray[np.int64]) -> Bytes:
    """Return one colour per strand from the group it belongs to, in a shade that tells it from its neighbours, shape [S, 3]."""
    shade = 1.0 - (1.0 - DARKEST) * scattered(len(group)) / max(len(group), 1)
    return (GROUP_COLOURS[group % len(GROUP_COLOURS)] * shade[:, None]).round().astype(np.uint8)


def paint_values(part: StrandFrame | LiquidFrame, paint: Paint) -> Floats:
    """Return what a colour scale shows of the vertices of strands, shape [V], or of a liquid's particles, shape [P]."""
    return getattr(part, "contact_force" if paint == "force" else paint)


def paint_limit(part: StrandFrame | LiquidFrame, paint: Paint) -> float:
    """Return where the colours of a frame's strands or liquid end, in the unit of what they show; 1 where that is no number."""
    return limit_of(paint_values(part, paint), SCALES[paint]) if paint in SCALES else 1.0


def colours_in_words(frame: Frame, paint: Paint | None) -> list[str]:
    """Return what colours mean where a frame is painted by something that needs a key."""
    if paint == "yielded" and frame.liquid is not None:
        return ["yielded (orange) or not (grey)"]
    said = ((frame.strands, STRAND_PAINTS), (frame.liquid, LIQUID_PAINTS))
    return [in_words(SCALES[paint], paint_limit(part, paint)) for part, paints in said
            if part is not None and paint in paints and paint in SCALES]


def strand_segments(strands: StrandFrame, paint: Paint = "group", limit: float = 1.0, most: int = 0) -> Segments:
    """Return all strands at their radius, as curves of up to `most` pieces where they have fewer.

    `paint` chooses the colour of the group, or that of a number at each vertex on its scale, which ends at `limit`.
    """
    fine = curves.smooth(strands.positions.astype(np.float64), strands.offsets, most)
    if paint in SCALES:
        colours = colours_of(fine.between(paint_values(strands, paint)), SCALES[paint], limit)
    else:
        colours = group_colours(strands.group)[vertex_strands(strands)[fine.before]]
    begins = np.ones(len(fine.positions), np.bool_)
    begins[fine.offsets[1:] - 1] = False
    ends = np.flatnonzero(begins)[:, None] + np.array([0, 1])
    return Segments(
        fine.positions[ends].astype(np.float32), colours[ends], strands.radius[fine.before[ends[:, 0]]].astype(np.float32)
    )


def node_points(yarns: YarnFrame) -> Points:
    """Return all active points as balls coloured by NodeState."""
    palette = np.array([NODE_COLOURS[NodeState(s)] for s in range(len(NODE_COLOURS))], np.uint8)
    radius = NODE_SCALE * float(yarns.radius.max(initial=0.0))
    count = len(yarns.node_positions)
    return Points(
        yarns.node_positions.astype(np.float32), palette[yarns.node_states], np.full(count, radius, np.float32)
    )


def liquid_points(liquid: LiquidFrame, paint: Paint = "liquid", limit: float = 1.0) -> Points:
    """Return particles as balls of their volume.

    `paint` chooses one colour for all, whether each has yielded, or a number on its scale, which ends at `limit`.
    """
    if paint in SCALES:
        colours = colours_of(paint_values(liquid, paint), SCALES[paint], limit)
    elif paint == "yielded":
        colours = YIELD_COLOURS[liquid.yielded.astype(np.int64)]
    else:
        colours = np.tile(np.array(LIQUID_COLOUR, np.uint8), (len(liquid.positions), 1))
    return Points(liquid.positions, colours, liquid.radius)


def scene_bounds(frame: Frame, obstacles: Solids) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and highest corner of the box that a view should show [m]; `obstacles` as they stand then.

    It holds yarns, strands and liquid and, of obstacles that are no larger than a few times these, what is solid of them: a plane
    has no size, and a wall around the scene would leave what moves a speck.
    """
    boxes = []
    if frame.yarns is not None and len(frame.yarns.line_positions):
        boxes.append(_box(frame.yarns.line_positions, frame.yarns.radius))
    if frame.strands is not None and len(frame.strands.positions):
        boxes.append(_box(frame.strands.positions, frame.strands.radius))
    if frame.liquid is not None and len(frame.liquid.positions):
        boxes.append(_box(frame.liquid.positions, frame.liquid.radius))
    reach = OBSTACLE_REACH * np.linalg.norm(boxes[0][1] - boxes[0][0]) if boxes else np.inf
    for kind, centre, rotation, size in zip(
        obstacles.kind, obstacles.centre, obstacles.rotation, obstacles.size, strict=True
    ):
        if kind != ObstacleKind.PLANE:
            half = {ObstacleKind.SPHERE: size[[0, 0, 0]], ObstacleKind.CYLINDER: size[[0, 0, 1]]}.get(kind, size)
            extent = np.abs(rotation) @ half
            if np.linalg.norm(extent) < reach:
                boxes.append((centre - extent, centre + extent))
    if not boxes:
        return np.full(3, -0.5), np.full(3, 0.5)
    lows, highs = zip(*boxes, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def viewpoint(low: NDArray[np.float64], high: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where the eye is and what it looks at so that the box from `low` to `high` fills the picture [m]."""
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    distance = FILL * size / 2 / np.tan(FIELD_OF_VIEW / 2)
    return middle + distance * VIEW_DIRECTION / np.linalg.norm(VIEW_DIRECTION), middle


def _box(positions: NDArray[np.floating], radius: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and highest corner of the box around round lines or balls [m]."""
    return positions.min(axis=0) - radius.max(), positions.max(axis=0) + radius.max()
