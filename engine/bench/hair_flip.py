"""The shipped flip of hair, thinned and cut short, by steps, tolerance of contact and vertices."""

import json

import numpy as np

from engine.arrays import Floats
from engine.run.adaptivity import StepLimits, after_accepted, after_rejected, first_size, plan
from engine.run.strands import StrandsInMotion
from engine.run.threads import threads_for
from engine.scene.load import load_scene, shipped_scenes

SCENE = "hair-flip-dry-small"
ROUND_OFF = 1e-9  # of a step: what is left of the time is no step


def thinned(hairs: int) -> dict:
    """Return the shipped scene with so many hairs, in fewer tufts accordingly."""
    document = json.loads(shipped_scenes()[SCENE].read_text())
    groom = document["strands"][0]["groom"]
    groom["clump"]["count"] = max(1, round(groom["clump"]["count"] * hairs / groom["count"]))
    groom["count"] = hairs
    return document


def flip(document: dict, segments: int, step: float, tolerance: float, duration: float) -> Floats:
    """Return where the vertices of each hair are at `duration` [s], shape [hairs, segments + 1, 3] [m].

    `step` is over that of the scene, `tolerance` that of contact. Raises StepTooSmall as a run would.
    """
    scene = load_scene(document | {
        "step": document["step"] | {"default": step * document["step"]["default"]},
        "strand_step": {"contact_tolerance": tolerance},
        "strands": [group | {"vertices": segments + 1} for group in document["strands"]],
    })
    motion, limits = StrandsInMotion(scene), StepLimits(scene.step.default, scene.step.min, scene.step.max)
    time, size = 0.0, first_size(limits)
    with threads_for(motion.nodes):
        while duration - time > ROUND_OFF * limits.default:
            h = plan(size.dt, duration - time)
            if motion.step(time, h).accepted:
                time, size = time + h, after_accepted(size, limits)
            else:
                size = after_rejected(h, limits)
    return motion.state.x.reshape(-1, segments + 1, 3)


def distance(a: Floats, b: Floats) -> float:
    """Return the root mean square distance of the places that hairs a and b have in common, over the length of the hair.

    Both are [hairs, segments + 1, 3] [m]; the larger number of segments is a multiple of the other.
    """
    fewest = min(a.shape[1], b.shape[1]) - 1
    a, b = (x[:, :: (x.shape[1] - 1) // fewest] for x in (a, b))
    length = np.linalg.norm(np.diff(a, axis=1), axis=2).sum(axis=1).mean()
    return float(np.sqrt(np.mean(np.sum((a - b) ** 2, axis=2))) / length)
