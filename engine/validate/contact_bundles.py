"""A bundle of hairs dropped across another one on a slope, as the shipped scene has it: Coulomb's law of many strands at once.

The held bundle is taut and straight down the slope, so that whatever the dropped one's hairs do to each other, and however many
touch the held ones, friction on all of them together is mu times what presses them on it.
"""

import json
from time import perf_counter
from typing import NamedTuple

import numpy as np

from engine.arrays import Floats
from engine.run.strands import StrandsInMotion
from engine.run.threads import threads_for
from engine.scene.load import load_scene, shipped_scenes
from engine.validate.catalogue import CaseResult, Row, case

SCENE = "two-bundles-friction-small"
SLIDE = (0.1, 0.2, 0.3, 0.4)  # coefficients with which acceleration is compared; the slope's tangent is 0.5
BESIDE = 0.02  # from the slope's tangent, to coefficients with which the bundle slides still or stays already
STICKY = 0.8
SETTLED, END = 0.04, 0.08  # between which acceleration is measured [s]


class Slide(NamedTuple):
    """How the dropped bundle moves along the slope."""

    acceleration: float  # between SETTLED and END [m/s^2]
    coulomb: float  # g (sin a - mu cos a) [m/s^2]
    stays: bool  # at END it goes no further in a step than the tolerance of contact


@case("contact-bundles", bar=0.01, summary="bundle of hairs on another: slides below mu = tan a with g (sin a - mu cos a)")
def bundles(quick: bool) -> CaseResult:
    """Worst relative error of the acceleration; that the bundle stays or slides is a condition beside it."""
    failures, rows, found = [], [], []
    stay, just_slide = tangent() + BESIDE, tangent() - BESIDE
    for mu, stays in ((stay, True), (just_slide, False), (STICKY, True))[: 2 if quick else 3]:
        if slide(mu).stays != stays:
            failures.append(f"mu = {mu:g}: it {'slides' if stays else 'stays'}")
    for mu in SLIDE[2:3] if quick else SLIDE:
        start = perf_counter()
        seen = slide(mu)
        rows.append(Row("mu", mu, abs(seen.acceleration / seen.coulomb - 1.0), perf_counter() - start))
        found.append(f"{seen.acceleration:.4f} (mu {mu:g}, Coulomb {seen.coulomb:.4f})")
    return CaseResult(rows, max(row.error for row in rows), failures=failures,
                      note=f"accelerations in m/s^2: {', '.join(found)}; slides with {just_slide:.2f}, stays with {stay:.2f}")


def tangent() -> float:
    """Return the slope's tangent, tan a: the coefficient at which the bundle is on the verge of sliding."""
    motion = with_friction(STICKY)
    along, across = gravity(motion, slope(motion))
    return along / across


def slide(mu: float) -> Slide:
    """Return how the dropped bundle moves with friction `mu`. Raises RuntimeError where a step is rejected."""
    motion, step = with_friction(mu), load_scene(shipped_scenes()[SCENE]).step.default
    model, down = motion.model, slope(motion)
    dropped = np.repeat(model.group, np.diff(model.start)) == 1
    along, across = gravity(motion, down)
    steps, settled, speed = round(END / step), round(SETTLED / step), [0.0]
    with threads_for(motion.nodes):
        for number in range(steps):
            report = motion.step(number * step, step)
            if not report.accepted:
                raise RuntimeError(report.reason)
            velocity = np.average(motion.state.velocity[dropped], axis=0, weights=model.mass[dropped])
            speed.append(float(velocity @ down))
    tolerated = motion.stepper.settings.contact_tolerance * 2.0 * model.radius.min()
    acceleration = (speed[-1] - speed[settled]) / ((steps - settled) * step)
    return Slide(acceleration, along - mu * across, abs(speed[-1]) * step <= tolerated)


def with_friction(mu: float) -> StrandsInMotion:
    """Return the scene at its start, both bundles with friction `mu`."""
    document = json.loads(shipped_scenes()[SCENE].read_text())
    return StrandsInMotion(load_scene(document | {"strands": [group | {"friction": mu} for group in document["strands"]]}))


def slope(motion: StrandsInMotion) -> Floats:
    """Return the unit vector [3] down the slope, along the held hairs, at the start."""
    first, last = motion.state.x[motion.model.start[0]], motion.state.x[motion.model.start[1] - 1]
    return (last - first) / np.linalg.norm(last - first)


def gravity(motion: StrandsInMotion, down: Floats) -> tuple[float, float]:
    """Return g sin a and g cos a [m/s^2], with `down` [3] the unit vector down the slope."""
    along = float(motion.gravity @ down)
    return along, float(np.linalg.norm(motion.gravity - along * down))
