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
from engine.run.frames import Frame, YarnFrame
from engine.yarns.model import NodeState
from viewer.detail import line_yarns

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Paint = Literal["fabric", "strain"]

# Fabrics from the bottom of a stack up, green lowest as in Sánchez-Banderas 2020, Figs. 1 and 7. The hues are Okabe and
# Ito's, told apart by all common kinds of colour vision, lightened where shading would turn them muddy.
FABRIC_COLOURS = np.array(
    [(0, 150, 106), (240, 166, 20), (66, 140, 214), (204, 121, 167), (213, 106, 40), (230, 220, 110)], np.uint8
)
DARKER = 0.78
SINGLE_YARN_COLOUR = np.array((196, 178, 150), np.uint8)

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
OBSTACLE_REACH = 1.0  # an obstacle is framed if its half diagonal is below this many diagonals of the yarns' box

# Strain runs from compressed to stretched through a pale middle (ColorBrewer's RdBu, safe for colour-blind eyes).
STRAIN_LIMIT = 0.002
_STRAIN_STOPS = np.linspace(-STRAIN_LIMIT, STRAIN_LIMIT, 5)
_STRAIN_COLOURS = np.array([(33, 102, 172), (146, 197, 222), (247, 247, 247), (244, 165, 130), (178, 24, 43)], float)


@dataclass(frozen=True)
class Segments:
    """Straight pieces of round yarn."""

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
    channels = [np.interp(strain, _STRAIN_STOPS, _STRAIN_COLOURS[:, c]) for c in range(3)]
    return np.stack(channels, axis=-1).round().astype(np.uint8)


def yarn_segments(yarns: YarnFrame, paint: Paint = "fabric", thickness: float = 1.0) -> Segments:
    """Return the polylines through the nodes of all yarns, at `thickness` times their real radius.

    `paint` chooses the colour of the fabric, or that of the stretch strain at each node.
    """
    yarn = line_yarns(yarns)
    first = np.flatnonzero(yarn[:-1] == yarn[1:])
    ends = np.stack([first, first + 1], axis=1)
    by_node = fabric_colours(yarns.fabric)[yarn] if paint == "fabric" else strain_colours(yarns.line_strain)
    return Segments(
        yarns.line_positions[ends].astype(np.float32),
        by_node[ends],
        (thickness * yarns.radius[yarn[first]]).astype(np.float32),
    )


def node_points(yarns: YarnFrame) -> Points:
    """Return all active points as balls coloured by NodeState."""
    palette = np.array([NODE_COLOURS[NodeState(s)] for s in range(len(NODE_COLOURS))], np.uint8)
    radius = NODE_SCALE * float(yarns.radius.max(initial=0.0))
    count = len(yarns.node_positions)
    return Points(
        yarns.node_positions.astype(np.float32), palette[yarns.node_states], np.full(count, radius, np.float32)
    )


def scene_bounds(frame: Frame, obstacles: Solids) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and highest corner of the box that a view should show [m]; `obstacles` as they stand then.

    It holds the yarns and, of obstacles that are no larger than a few times these, what is solid of them: a plane has
    no size, and a wall around the scene would leave the yarns a speck.
    """
    boxes = []
    if frame.yarns is not None and len(frame.yarns.line_positions):
        margin = frame.yarns.radius.max()
        boxes.append((frame.yarns.line_positions.min(axis=0) - margin, frame.yarns.line_positions.max(axis=0) + margin))
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
