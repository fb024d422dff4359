"""The recording of a run, `recording.rrd`: what the live page shows, for the Rerun viewer, offline.

Every frame is flushed, so that all frames but the one being written are readable after a crash. A run that goes on
after one writes a second file under the same recording id; closing joins the two. Large frames are recorded as coarse
as they are drawn (`viewer.detail`): the frames themselves hold everything, a recording is to look at.
"""

import logging
import os
import subprocess
import sys
import tempfile
import uuid
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from rerun.components import LineStrip3DBatch

from engine.arrays import Floats, Ints
from engine.contact.obstacles import posed
from engine.run.frames import Frame, LiquidFrame, StrandFrame, YarnFrame
from engine.scene.build import build
from engine.scene.schema import Scene
from viewer import detail, layers, liquid_detail, shapes, strand_detail
from viewer.lay import layout_of
from viewer.layers import Paint
from viewer.scales import SCALES, in_words
from viewer.spill import Spill

TIMELINE = "simulated"  # time of the scene [s]
CLOTH, NODES, OBSTACLES, SERIES = "cloth/yarns", "nodes", "obstacles", "series"
STRANDS, LIQUID, SURFACE, PAINTED, KEY = "strands", "liquid", "surface", "painted", "key"
PAINTS = layers.STRAND_PAINTS[1:]  # those that change from frame to frame
LIQUID_PAINTS = layers.LIQUID_PAINTS[1:]
PAINTED_SEGMENTS = 10_000  # each has a colour and so is a line of its own, for every paint: 1 MB a frame at most
PAINTED_PARTICLES = 10_000  # with a place and a colour for every paint: 0.8 MB a frame
PLOTS = {
    "Newton residual": ("residual",),
    "Iterations": ("newton_iterations", "linear_iterations"),
    "Contacts": ("eol_intra", "eol_inter", "eil"),
    "Energy [J]": ("kinetic_energy", "potential_energy"),
}
STRAND_PLOTS = PLOTS | {"Contacts": ("contacts",), "Overlap [radii]": ("contact_gap",)}
LIQUID_PLOTS = {
    "Iterations for pressure": ("linear_iterations",), "Particles": ("particles",), "Energy [J]": PLOTS["Energy [J]"],
}
NEARER = 0.65  # Rerun's eye sees a wider field than the live page's
BACKGROUND = (238, 236, 232)
log = logging.getLogger(__name__)


class Recorder:
    """Writes the recording of one job. A failure to record is logged and ends the recording, never the run."""

    def __init__(self, scene: Scene, directory: Path):
        """Record into `directory`. An interrupted recording there is gone on with, unless frame 0 comes first."""
        built = build(scene)
        self._scene = scene
        self._path = directory / "recording.rrd"
        self._obstacles, self._handles = built.obstacles, built.handles
        self._layout = layout_of(scene, built)
        self._stream: rr.RecordingStream | None = None
        self._file: Spill | None = None
        self._broken = False

    def log(self, frame: Frame) -> None:
        """Add one frame."""
        self._attempt(lambda: self._add(frame), f"frame {frame.index}")

    def close(self) -> None:
        """Finish the recording, joined with what an earlier, interrupted run left."""
        self._attempt(self._finish, "the end")

    def _attempt(self, action: Callable[[], None], what: str) -> None:
        if self._broken:
            return
        try:
            action()
        except (OSError, subprocess.SubprocessError) as problem:
            self._broken, self._stream = True, None
            log.error("recording stops at %s, the run goes on: %s", what, problem)

    def _add(self, frame: Frame) -> None:
        if self._stream is None or self._file is None:
            self._stream, self._file = self._open(frame)
        stream = self._stream
        stream.set_time(TIMELINE, duration=frame.time)
        stream.set_time("frame", sequence=frame.index)
        for index, move in shapes.moves(self._obstacles, self._handles, frame.time).items():
            turned = rr.Quaternion(xyzw=np.roll(move.wxyz, -1))
            stream.log(f"{OBSTACLES}/{index}", rr.Transform3D(translation=move.position, quaternion=turned))
        for index, vertices in shapes.changed_vertices(self._obstacles, frame.time).items():
            stream.log(f"{OBSTACLES}/{index}", rr.Mesh3D.from_fields(vertex_positions=vertices))
        if frame.yarns is not None:
            yarns = detail.coarse(frame.yarns, detail.FINE)
            drawn = self._layout(yarns, detail.FINE.segments)
            for path, lines, thickness in ((CLOTH, drawn, 1.0), (f"{NODES}/lines", yarns, layers.LINE_SCALE)):
                shape = strips(lines.line_positions, lines.line_offsets)
                stream.log(path, rr.LineStrips3D.from_fields(strips=shape, radii=thickness * lines.radius))
            points = layers.node_points(yarns)
            stream.log(f"{NODES}/points", rr.Points3D(points.points, colors=points.colours, radii=points.radii[:1]))
        if frame.strands is not None:
            log_strands(stream, frame.strands)
        if frame.liquid is not None:
            log_liquid(stream, frame.liquid)
        for key, value in frame.series.items():
            stream.log(f"{SERIES}/{key}", rr.Scalars(value))
        stream.flush()
        self._file.settle()

    def _open(self, first: Frame) -> tuple[rr.RecordingStream, Spill]:
        parts = recording_parts(self._path)
        if first.index == 0:
            for part in parts:
                part.unlink()
            parts = []
        target = self._path if not parts else self._path.with_suffix(f".{len(parts)}.rrd")
        low, high = layers.scene_bounds(first, posed(self._obstacles, self._handles, first.time))
        identity = uuid.uuid5(uuid.NAMESPACE_URL, f"{self._path.absolute()} {self._scene.model_dump_json()}")
        stream = rr.RecordingStream("strandline", recording_id=str(identity))
        file = Spill(target)
        stream.save(file.entrance, default_blueprint=blueprint(low, high, first))
        file.seal()
        stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        changing = shapes.changed_vertices(self._obstacles, first.time)
        for index in range(len(self._obstacles.kind)):
            mesh = shapes.obstacle_mesh(self._obstacles, index, low, high)
            stream.log(f"{OBSTACLES}/{index}", obstacle(mesh, places=index not in changing), static=True)
        if first.yarns is not None:
            log_looks(stream, first.yarns)
        if first.strands is not None:
            drawn = strand_detail.part(first.strands, "fine", np.zeros(3)).strands
            stream.log(STRANDS, rr.LineStrips3D.from_fields(colors=layers.group_colours(drawn.group)), static=True)
        return stream, file

    def _finish(self) -> None:
        if self._stream is None or self._file is None:
            return
        self._stream.disconnect()
        self._stream = None
        self._file.close()
        parts = recording_parts(self._path)
        if len(parts) > 1:
            join(parts, self._path)


def recording_parts(path: Path) -> list[Path]:
    """Return the files of an interrupted recording in the order in which they were written."""
    later = sorted(path.parent.glob(f"{path.stem}.*.rrd"), key=lambda part: int(part.suffixes[-2][1:]))
    return ([path] if path.exists() else []) + later


def join(parts: list[Path], path: Path) -> None:
    """Write the recording at `path` from its parts, whose torn ends are left out, and delete these.

    Raises OSError or subprocess.SubprocessError where it cannot; the parts are then untouched.
    """
    aside = path.with_name(path.name + ".aside")
    command = [sys.executable, "-m", "rerun", "rrd", "merge", "--continue-on-error", "-o", str(aside), *map(str, parts)]
    # in a home of its own the program finds no settings, and what runs for the first time reports to nobody
    with tempfile.TemporaryDirectory() as home:
        places = dict.fromkeys(("HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME"), home)
        subprocess.run(command, env={**os.environ, **places}, check=True, capture_output=True)
    os.replace(aside, path)
    for part in parts:
        if part != path:
            part.unlink()


def strips(positions: NDArray[np.floating], offsets: Ints) -> pyarrow.ListArray:
    """Return polylines in Rerun's own layout, ten times faster than from a list of arrays."""
    points = pyarrow.FixedSizeListArray.from_arrays(
        positions.astype(np.float32).ravel(), type=LineStrip3DBatch._ARROW_DATATYPE.value_type
    )
    return pyarrow.ListArray.from_arrays(offsets.astype(np.int32), points, type=LineStrip3DBatch._ARROW_DATATYPE)


def log_looks(stream: rr.RecordingStream, yarns: YarnFrame) -> None:
    """Log what never changes about yarns, their colour, once."""
    colours = layers.told_apart(layers.fabric_colours(yarns.fabric))
    for path in (CLOTH, f"{NODES}/lines"):
        stream.log(path, rr.LineStrips3D.from_fields(colors=colours), static=True)


def log_strands(stream: rr.RecordingStream, strands: StrandFrame) -> None:
    """Log strands as lines, those of fewer coloured by what each paint shows, and the key to these colours."""
    drawn = strand_detail.part(strands, "fine", np.zeros(3)).strands
    radii = np.maximum.reduceat(drawn.radius, drawn.offsets[:-1])
    stream.log(STRANDS, rr.LineStrips3D.from_fields(strips=strips(drawn.positions, drawn.offsets), radii=radii))
    fewer, key = strand_detail.seen(strand_detail.coarse(strands, PAINTED_SEGMENTS), strands), []
    for paint in PAINTS:
        limit = layers.paint_limit(strands, paint)
        segments = layers.strand_segments(fewer, paint, limit)
        lines = strips(segments.points.reshape(-1, 3), np.arange(0, 2 * len(segments.points) + 1, 2))
        colours = segments.colours.mean(axis=1).astype(np.uint8)
        stream.log(f"{PAINTED}/{paint}", rr.LineStrips3D.from_fields(strips=lines, radii=segments.radii, colors=colours))
        key.append(f"- {in_words(SCALES[paint], limit)}")
    stream.log(KEY, rr.TextDocument("\n".join(key), media_type="text/markdown"))


def log_liquid(stream: rr.RecordingStream, liquid: LiquidFrame) -> None:
    """Log particles and surface, fewer particles coloured by what each paint shows, and the key to these colours."""
    drawn = layers.liquid_points(liquid_detail.coarse(liquid, detail.FINE.segments))
    stream.log(LIQUID, rr.Points3D(drawn.points, radii=drawn.radii, colors=layers.LIQUID_COLOUR))
    if len(liquid.surface_faces):
        stream.log(SURFACE, obstacle(shapes.surface(liquid)))
    fewer, key = liquid_detail.coarse(liquid, PAINTED_PARTICLES), []
    for paint in LIQUID_PAINTS:
        points = layers.liquid_points(fewer, paint, layers.paint_limit(liquid, paint))
        stream.log(f"{PAINTED}/{paint}", rr.Points3D(points.points, radii=points.radii, colors=points.colours))
        key += layers.colours_in_words(Frame(0, 0.0, 0, liquid=liquid), paint)
    stream.log(KEY, rr.TextDocument("\n".join(f"- {said}" for said in key), media_type="text/markdown"))


def obstacle(mesh: shapes.Mesh, places: bool = True) -> rr.Mesh3D:
    """Return a mesh for Rerun, without the places of its vertices where these are logged frame by frame."""
    vertices = mesh.vertices if places else None
    return rr.Mesh3D.from_fields(vertex_positions=vertices, triangle_indices=mesh.faces, albedo_factor=mesh.colour)


def blueprint(low: Floats, high: Floats, first: Frame) -> rrb.Blueprint:
    """Return the layout of the page for frames like the `first`, plots on its right.

    Beside them are the cloth, and its discretisation in a second tab, or strands or liquid, and in further tabs its surface
    and what colours show.
    """
    position, target = layers.viewpoint(low, high)
    position = target + NEARER * (position - target)
    eye = rrb.EyeControls3D(position=position, look_target=target, eye_up=(0, 0, 1))
    tabs, plotted = [("Cloth", CLOTH.split("/")[0]), ("Nodes", NODES)], PLOTS
    if first.strands is not None:
        tabs, plotted = [("Strands", STRANDS), *_painted(PAINTS)], STRAND_PLOTS
    elif first.liquid is not None:
        surface = [("Surface", SURFACE)] if len(first.liquid.surface_faces) else []
        tabs, plotted = [*surface, ("Particles", LIQUID), *_painted(LIQUID_PAINTS)], LIQUID_PLOTS
    views = (
        rrb.Spatial3DView(
            origin="/", name=name, contents=[f"+ /{OBSTACLES}/**", f"+ /{what}/**"],
            background=BACKGROUND, line_grid=False, eye_controls=eye,
        )
        for name, what in tabs
    )  # fmt: skip
    plots = (
        rrb.TimeSeriesView(origin=f"/{SERIES}", name=name, contents=[f"+ /{SERIES}/{key}" for key in keys])
        for name, keys in plotted.items()
    )
    key = [rrb.TextDocumentView(origin=f"/{KEY}", name="Colours of this frame")] if plotted is not PLOTS else []
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Tabs(*views), rrb.Vertical(*plots, *key), column_shares=[3, 1]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _painted(paints: tuple[Paint, ...]) -> list[tuple[str, str]]:
    """Return tabs for what colours show: names and contents."""
    names = ((SCALES[paint].label if paint in SCALES else paint).capitalize() for paint in paints)
    return [(name, f"{PAINTED}/{paint}") for name, paint in zip(names, paints, strict=True)]
