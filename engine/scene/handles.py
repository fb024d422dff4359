"""What moves parts of a scene."""

import numpy as np

from engine.geometry.handles import Handles
from engine.scene.schema import Script


def scripted_handles(script: Script) -> Handles:
    """Return the handles of a script as steppers take them."""
    keyframes = [keyframe for handle in script.handles for keyframe in handle.keyframes]
    counts = [len(handle.keyframes) for handle in script.handles]
    return Handles(
        start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        time=np.array([keyframe.time for keyframe in keyframes], float),
        offset=np.array([keyframe.offset for keyframe in keyframes], float).reshape(-1, 3),
        angles=np.array([keyframe.rotation for keyframe in keyframes], float).reshape(-1, 3),
        pivot=np.array([handle.pivot for handle in script.handles], float).reshape(-1, 3),
    )


def handle_numbers(script: Script) -> dict[str | None, int]:
    """Return numbers of handles by name, -1 for None."""
    return {None: -1, **{handle.name: number for number, handle in enumerate(script.handles)}}
