"""Frames: what viewer and recorder draw, one HDF5 file each, with `trajectory.h5` linking to all of them."""

import re
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TypedDict

import h5py
import numpy as np
from numpy.typing import NDArray

from engine.arrays import Flags, Floats, Ints, Singles
from engine.run.files import hdf5_image, write_whole

_FRAME_FILE = re.compile(r"\d{6,}\.h5")


@dataclass(frozen=True)
class YarnFrame:
    """All yarns at one time: Y yarns with K nodes and M points that are in use, N Eulerian coordinates.

    Positions, strains and coordinates are float32 where that is far below a yarn's radius, else float64.
    """

    line_positions: Floats  # nodes in order along each yarn, EIL nodes where they are interpolated [m], shape [K, 3]
    line_offsets: Ints  # yarn y is line_positions[line_offsets[y]:line_offsets[y+1]], shape [Y+1]
    line_strain: Floats  # stretch lambda - 1, averaged to nodes, shape [K]
    line_points: NDArray[np.int32]  # index of the node's point in the model; yarns that touch share it, shape [K]
    radius: Floats  # [m], shape [Y]
    fabric: Ints  # -1 for a single yarn, shape [Y]
    node_positions: Floats  # [m], shape [M, 3]
    node_states: NDArray[np.uint8]  # NodeState, shape [M]
    node_points: NDArray[np.int32]  # index of the point in the model, shape [M]
    u: Floats  # Eulerian coordinates [m], shape [N]


@dataclass(frozen=True)
class StrandFrame:
    """All strands at one time: S strands with V vertices."""

    positions: Singles  # of vertices in order along each strand [m], shape [V, 3]
    offsets: Ints  # strand s is positions[offsets[s]:offsets[s+1]], shape [S+1]
    radius: Singles  # of the edge towards the next vertex, were its section of the same area round [m], shape [V]
    group: Ints  # of strands that belong together, shape [S]
    strain: Singles  # stretch of edges, averaged to vertices, shape [V]
    curvature: Singles  # [1/m], shape [V]
    contact_force: Singles  # sum of the magnitudes of the contact forces on a vertex [N], shape [V]


@dataclass(frozen=True)
class LiquidFrame:
    """All liquid at one time: P particles, and their surface of N vertices and T triangles, 0 where nobody asked."""

    positions: Singles  # [m], shape [P, 3]
    radius: Singles  # of a ball of the particle's volume [m], shape [P]
    speed: Singles  # [m/s], shape [P]
    pressure: Singles  # [Pa], shape [P]
    shear: Singles  # magnitude of the shear stress [Pa], shape [P]
    yielded: Flags  # whether it flows, shape [P]
    surface_vertices: Singles  # [m], shape [N, 3]
    surface_faces: NDArray[np.int32]  # counter-clockwise seen from outside, shape [T, 3]


class Components(TypedDict, total=False):
    """What a scene has at one time; components that it lacks are not there."""

    yarns: YarnFrame
    strands: StrandFrame
    liquid: LiquidFrame


_COMPONENTS = {"yarns": YarnFrame, "strands": StrandFrame, "liquid": LiquidFrame}  # by their names in files


@dataclass(frozen=True)
class Frame:
    """The scene at one time; components that it lacks are None."""

    index: int
    time: float  # [s]
    step: int  # accepted steps so far
    yarns: YarnFrame | None = None
    strands: StrandFrame | None = None
    liquid: LiquidFrame | None = None
    series: dict[str, float] = field(default_factory=dict)  # one value per frame: dt, residual, energies, counts, ...


def frame_path(directory: Path, index: int) -> Path:
    """Return where frame `index` of the job in `directory` is."""
    return directory / "frames" / f"{index:06d}.h5"


def frame_paths(directory: Path) -> list[Path]:
    """Return the frames in a job directory, in order of time."""
    paths = [path for path in (directory / "frames").glob("*.h5") if _FRAME_FILE.fullmatch(path.name)]
    return sorted(paths, key=lambda path: int(path.stem))


def write_frame(directory: Path, frame: Frame) -> Path:
    """Write `frame` into the job directory and link it into the trajectory; returns its path.

    Raises OSError where the disk is full; only whole frames are left then.
    """
    path = frame_path(directory, frame.index)
    path.parent.mkdir(exist_ok=True)
    write_whole(path, hdf5_image(lambda file: _fill(file, frame)))
    _link(directory, path)
    return path


def read_frame(path: Path) -> Frame:
    """Return the frame in the file `path`."""
    with h5py.File(path, "r") as file:
        return Frame(
            index=int(file.attrs["index"]), time=float(file.attrs["time"]), step=int(file.attrs["step"]),
            series={name: float(value) for name, value in file["series"].attrs.items()},
            **{
                name: component(**{entry.name: file[name][entry.name][()] for entry in fields(component)})
                for name, component in _COMPONENTS.items() if name in file
            },
        )


def drop_frames(directory: Path) -> None:
    """Delete all frames of a job directory and the trajectory that links to them."""
    (directory / "trajectory.h5").unlink(missing_ok=True)
    for path in frame_paths(directory):
        path.unlink()


def _fill(file: h5py.File, frame: Frame) -> None:
    file.attrs["index"], file.attrs["time"], file.attrs["step"] = frame.index, frame.time, frame.step
    for component in _COMPONENTS:
        if (part := getattr(frame, component)) is not None:
            group = file.create_group(component)
            for name, values in vars(part).items():
                group[name] = values
    file.create_group("series").attrs.update(frame.series)


def _link(directory: Path, path: Path) -> None:
    """Add the frame at `path` to the trajectory, whose file is replaced as a whole: it is never seen torn."""
    trajectory = directory / "trajectory.h5"

    def fill(file: h5py.File) -> None:
        links = file.require_group("frames")
        if path.stem not in links:
            links[path.stem] = h5py.ExternalLink(f"frames/{path.name}", "/")

    write_whole(trajectory, hdf5_image(fill, trajectory if trajectory.exists() else None))
