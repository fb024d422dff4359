"""Checkpoints: all state of a run and only state, so that a resumed run continues bitwise like an unbroken one."""

import json
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from engine.run.adaptivity import StepSize
from engine.run.files import hdf5_image, write_whole
from engine.run.statistics import Statistics


class CheckpointMismatch(Exception):
    """A checkpoint does not belong to this scene, or cannot be read."""


@dataclass(frozen=True)
class Checkpoint:
    """Everything that influences later steps, or the report."""

    scene: str  # fingerprint of the scene
    time: float  # [s]
    step: int  # accepted steps so far
    next_frame: int  # index of the first frame that is not written yet
    size: StepSize  # memory of the step controller
    arrays: dict[str, NDArray]  # state of all components, by name
    statistics: Statistics


def checkpoint_path(directory: Path) -> Path:
    """Return where the checkpoint of the job in `directory` is."""
    return directory / "checkpoint.h5"


def write_checkpoint(directory: Path, checkpoint: Checkpoint) -> None:
    """Replace the checkpoint of a job directory; a kill or full disk (OSError) leaves the earlier one."""

    def fill(file: h5py.File) -> None:
        file.attrs["scene"] = checkpoint.scene
        file.attrs["time"], file.attrs["step"] = checkpoint.time, checkpoint.step
        file.attrs["next_frame"] = checkpoint.next_frame
        file.attrs["dt"], file.attrs["calm"] = checkpoint.size.dt, checkpoint.size.calm
        file["statistics"] = json.dumps(checkpoint.statistics.to_dict())
        state = file.create_group("state")
        for name, values in checkpoint.arrays.items():
            state[name] = values

    write_whole(checkpoint_path(directory), hdf5_image(fill))


def read_checkpoint(
    directory: Path, scene: str, expected: dict[str, NDArray], varying: frozenset[str] = frozenset()
) -> Checkpoint:
    """Return the checkpoint of a job directory.

    `scene` is the fingerprint that it must carry, `expected` has the names, shapes and types that its arrays must
    have: they are compared before any array is read. Those of the arrays `varying` may have any number of rows, the same for
    all of them. Raises CheckpointMismatch.
    """
    path = checkpoint_path(directory)
    try:
        with h5py.File(path, "r") as file:
            if file.attrs["scene"] != scene:
                raise CheckpointMismatch(f"{path} belongs to another scene")
            return Checkpoint(
                scene=scene, time=float(file.attrs["time"]), step=int(file.attrs["step"]),
                next_frame=int(file.attrs["next_frame"]),
                size=StepSize(float(file.attrs["dt"]), int(file.attrs["calm"])),
                arrays=_read_arrays(file["state"], expected, varying, path),
                statistics=Statistics(**json.loads(file["statistics"][()])),
            )
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise CheckpointMismatch(f"{path} cannot be read: {error}") from error


def _read_arrays(
    state: h5py.Group, expected: dict[str, NDArray], varying: frozenset[str], path: Path
) -> dict[str, NDArray]:
    if set(state) != set(expected):
        raise CheckpointMismatch(f"{path} holds other arrays than this version: {sorted(set(state) ^ set(expected))}")
    rows = next((state[name].shape[:1] for name in sorted(varying)), ())
    for name, like in expected.items():
        shape = rows + like.shape[1:] if name in varying else like.shape
        if state[name].shape != shape or state[name].dtype != like.dtype:
            raise CheckpointMismatch(
                f"{path}: {name} is {state[name].dtype}{list(state[name].shape)}, not {like.dtype}{list(shape)}"
            )
    return {name: np.ascontiguousarray(state[name][()]) for name in expected}
