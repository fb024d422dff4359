"""Strands made up by formula: a job directory of two tufts that sway past a ball, and a frame as large as hair gets."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import trimesh

from engine.run.frames import Frame, StrandFrame
from engine.scene.build import Built, build
from engine.scene.load import load_scene
from engine.scene.schema import Scene
from engine.strands import observe
from tests.viewer import jobs

RADIUS = 6e-4
VERTICES = 17
COLUMNS = 6  # of each tuft, and as many rows


def hanging(x: float, y: float) -> list[list[float]]:
    """A strand of 8 cm that hangs from (x, y, 0)."""
    return [[x, y, -0.005 * i] for i in range(VERTICES)]


def tuft(name: str, x: float) -> dict:
    """Strands 4 mm apart."""
    places = [(x + 0.004 * i, 0.004 * j) for i in range(COLUMNS) for j in range(COLUMNS)]
    return {"name": name, "material": "nylon", "curves": [hanging(*place) for place in places], "root": {"hold": "clamped"}}


SCENE = {
    "strandline": 1,
    "name": "two tufts by formula",
    "duration": 0.3,
    "materials": {"nylon": {"radius": RADIUS, "volume_density": 1150.0, "youngs_modulus": 2e9}},
    "strands": [tuft("left", -0.03), tuft("right", 0.01)],
    "obstacles": [{"shape": "sphere", "radius": 0.01, "position": [0, 0.01, -0.06]}],
}


@cache
def scene() -> Scene:
    """Return the scene of all synthetic jobs of strands."""
    return load_scene(SCENE)


@cache
def built() -> Built:
    """Return what is built from it."""
    return build(scene())


def frame(index: int) -> Frame:
    """Return frame `index`: the further on, the further the tufts have swung and been pressed against the ball."""
    model, state = built().strands, built().strand_state.copy()
    depth = -state.x[:, 2]
    state.x[:, 0] += 0.4 * index * depth**2
    state.x[:, 2] *= 1 + 2e-4 * index
    state.vertex_contact_force = 1e-4 * index * np.maximum(depth - 0.05, 0.0)
    series = jobs.series_of(index, strand_vertices=float(len(depth)), contacts=5.0 * index)
    return Frame(index, index / 30, index * 33, strands=StrandFrame(**observe.strand_frame_arrays(model, state)), series=series)


def write_job(directory: Path, frames: int, state: str = "succeeded") -> None:
    """Make `directory` a job directory with that many frames."""
    jobs.write_job(directory, SCENE, map(frame, range(frames)), state)


def on_a_swelling_ball() -> dict:
    """The scene with a ball in it that swells to 1.4 times its size in a tenth of a second."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.02)
    swollen = {"time": 0.1, "vertices": (1.4 * ball.vertices).tolist()}
    return SCENE | {"obstacles": [{
        "shape": "mesh", "vertices": ball.vertices.tolist(), "faces": ball.faces.tolist(), "shapes": [swollen],
    }]}  # fmt: skip


def write_falling_job(directory: Path) -> None:
    """Make `directory` a job directory of two frames, between which the tufts fall 4 m."""
    first, last = frame(0), frame(1)
    last.strands.positions[:, 2] -= 4.0
    jobs.write_job(directory, SCENE, [first, last])


def curled(strands: int, vertices: int, groups: int = 1) -> StrandFrame:
    """Return hair on a ball of radius 0.1 m in so many groups, of 0.2 m each and a radius of 0.04 mm."""
    number = np.arange(strands)
    height = 1 - (number + 0.5) / strands  # the upper half, by Fibonacci's spiral
    angle = 2 * np.pi * number * 0.6180339887
    out = np.stack([np.sqrt(1 - height**2) * np.cos(angle), np.sqrt(1 - height**2) * np.sin(angle), height], axis=1)
    along = np.linspace(0.0, 0.2, vertices)
    x = 0.1 * out[:, None] + 0.3 * along[:, None] * out[:, None] - np.array([0.0, 0.0, 1.0]) * 4 * along[:, None] ** 2
    count = strands * vertices
    rest = np.tile(along, strands).astype(np.float32)
    return StrandFrame(
        positions=x.reshape(-1, 3).astype(np.float32), offsets=np.arange(0, count + 1, vertices),
        radius=np.full(count, 4e-5, np.float32), group=number % groups, strain=1e-5 * rest, curvature=20 * rest,
        contact_force=np.where(rest > 0.15, 1e-5 * rest, 0.0).astype(np.float32),
    )


@cache
def large() -> StrandFrame:
    """Return 32,000 strands of 16 vertices."""
    return curled(32_000, 16)


def write_large_job(directory: Path) -> None:
    """Make `directory` a job directory of one frame of them; the scene has a strand only, for none of them is read there."""
    ball = {"shape": "sphere", "radius": 0.1}
    one = SCENE["strands"][0] | {"curves": SCENE["strands"][0]["curves"][:1]}
    jobs.write_job(directory, SCENE | {"strands": [one], "obstacles": [ball]}, [Frame(0, 0.0, 0, strands=large())])


def without_contact(strands: StrandFrame) -> StrandFrame:
    """Return the frame where nothing touches."""
    return replace(strands, contact_force=np.zeros_like(strands.contact_force))
