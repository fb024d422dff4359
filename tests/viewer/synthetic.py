"""A job directory made up by formula: two small cloths on a table that sag and slide, no simulation needed."""

import json
from functools import cache
from pathlib import Path

import numpy as np

from engine.run.frames import Frame, YarnFrame, write_frame
from engine.scene.build import Built, build
from engine.scene.load import load_scene
from engine.scene.schema import Scene
from engine.yarns import observe
from engine.yarns.model import PointKind

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
    series = {
        "dt": 1e-3, "newton_iterations": 3.0 + index % 2, "linear_iterations": 40.0, "contact_gap": 1e-4,
        "residual": 10.0 ** (-5 - 0.1 * (index % 5)), "kinetic_energy": 1e-4 * index,
        "potential_energy": 1e-2 - 1e-4 * index, **{name: float(value) for name, value in count.items()},
    }  # fmt: skip
    return Frame(index, index / 30, index * 33, YarnFrame(**observe.yarn_frame_arrays(model, state)), series)


def write_job(directory: Path, frames: int, state: str = "succeeded") -> None:
    """Make `directory` a job directory with that many frames."""
    directory.mkdir(parents=True)
    (directory / "scene.json").write_text(json.dumps(SCENE))
    (directory / "job.json").write_text(json.dumps({"state": state}))
    for index in range(frames):
        write_frame(directory, frame(index))
