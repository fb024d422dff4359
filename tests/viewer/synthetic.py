"""A job directory made up by formula: two small cloths on a table that sag and slide, no simulation needed."""

from functools import cache
from pathlib import Path

import numpy as np

from engine.run.frames import Frame, YarnFrame
from engine.scene.build import Built, build
from engine.scene.load import load_scene
from engine.scene.schema import Scene
from engine.yarns import observe
from engine.yarns.model import PointKind
from tests.viewer import jobs

RADIUS = 0.00225
SCENE = {
    "strandline": 1,
    "name": "two cloths by formula",
    "duration": 0.3,
    "fabrics": [
        {"name": "lower", "material": "cotton-thick", "warps": 8, "wefts": 8, "spacing": 0.0056,
         "position": [0, 0, RADIUS]},
        {"name": "upper", "material": "cotton-thick", "warps": 6, "wefts": 6, "spacing": 0.0056,
         "position": [0.004, 0.002, RADIUS], "rotation": [0, 0, 30]},
    ],
    "contacts": [{"lower": "lower", "upper": "upper", "friction": 0.1}],
    "obstacles": [
        {"shape": "box", "size": [0.03, 0.03, 0.04], "position": [0, 0, -0.02]},
        {"shape": "sphere", "radius": 0.006, "position": [0.04, -0.02, -0.034]},
        {"shape": "plane", "position": [0, 0, -0.04]},
    ],
}  # fmt: skip


@cache
def scene() -> Scene:
    """Return the scene of all synthetic jobs."""
    return load_scene(SCENE)


@cache
def built() -> Built:
    """Return what is built from it."""
    return build(scene())


def frame(index: int) -> Frame:
    """Return frame `index`: the further on, the further the cloths have sagged over the table's border."""
    model, state = built().yarns, built().state.copy()
    x, y = state.x[:, 0], state.x[:, 1]
    over = np.maximum(np.hypot(x, y) - 0.013, 0.0)
    state.x[:, 0] += 0.001 * index
    state.x[:, 2] -= 3.0 * index * over**2
    # near the border, contacts between the cloths lose one or both of their EoL nodes
    first, second = model.point_nodes.T
    contact = model.point_kind == PointKind.CONTACT
    state.eil[first[contact & (over > 0)]] = True
    state.eil[second[contact & (over > 0.002)]] = True
    count = observe.counts(model, state)
    series = jobs.series_of(index, **{name: float(value) for name, value in count.items()})
    return Frame(index, index / 30, index * 33, YarnFrame(**observe.yarn_frame_arrays(model, state)), series=series)


def write_job(directory: Path, frames: int, state: str = "succeeded") -> None:
    """Make `directory` a job directory with that many frames."""
    jobs.write_job(directory, SCENE, map(frame, range(frames)), state)


LARGE_SCENE = {
    "strandline": 1,
    "name": "two large cloths by formula",
    "duration": 0.1,
    "materials": {"thin": {"radius": 0.00028, "linear_density": 2e-4, "stretch_stiffness": 100.0}},
    "fabrics": [
        {"name": "lower", "material": "thin", "warps": 500, "wefts": 500, "spacing": 0.00058, "position": [0, 0, 0.001]},
        {"name": "upper", "material": "thin", "warps": 387, "wefts": 387, "spacing": 0.00058, "position": [0, 0, 0.001],
         "rotation": [0, 0, 5]},
    ],
    "contacts": [{"lower": "lower", "upper": "upper", "friction": 0.1}],
}  # fmt: skip


@cache
def large() -> tuple[Built, YarnFrame]:
    """Return two cloths as large as the largest of Sánchez-Banderas 2020, Table 1, that hang in folds from their middle.

    Towards their border contacts between them have lost EoL nodes.
    """
    made = build(load_scene(LARGE_SCENE))
    model, state = made.yarns, made.state.copy()
    distance, angle = np.hypot(state.x[:, 0], state.x[:, 1]), np.arctan2(state.x[:, 1], state.x[:, 0])
    state.x[:, 2] -= 5 * np.maximum(distance - 0.05, 0) ** 2 * (1 + 0.5 * np.cos(5 * angle))
    first, second = model.point_nodes.T
    contact = model.point_kind == PointKind.CONTACT
    state.eil[first[contact & (distance > 0.12)]] = True
    state.eil[second[contact & (distance > 0.14)]] = True
    return made, YarnFrame(**observe.yarn_frame_arrays(model, state))


def write_large_job(directory: Path) -> None:
    """Make `directory` a job directory of one frame of the large cloths."""
    jobs.write_job(directory, LARGE_SCENE, [Frame(0, 0.0, 0, large()[1])])
