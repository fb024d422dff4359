"""Speed against error of whole scenes: what the time step and the tolerance cost, and what they buy."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from engine.arrays import Floats
from engine.bench.choices import Choice, rows
from engine.bench.suite import Measurement, benchmark
from engine.run.adaptivity import StepTooSmall
from engine.scene.load import load_scene, shipped_scenes
from engine.validate.eol_march import March
from engine.yarns.model import PointKind
from engine.yarns.settings import YarnSettings

SCENES = ("tablecloth-small-friction", "shirt-tag-stretch-h-small")
STEPS = (4.0, 2.0, 1.0, 0.5)  # of the scene's default
TOLERANCES = (1e-2, 1e-3, 1e-4)
REFERENCE = (0.125, 1e-4)  # step and tolerance of what all are compared with
SIMULATED = 40  # default steps


@dataclass(frozen=True)
class Run:
    """A scene simulated with one choice of the knobs."""

    step: float  # of the scene's default
    tolerance: float
    seconds: float
    crossings: Floats | None  # places of the fabrics' crossings at the end [m], None where the run failed


@benchmark("front", summary="error against wall time of a stack of tablecloths and a sewn tag, by time step and tolerance")
def front() -> Iterator[Measurement]:
    """Every pair of four steps and three tolerances, for two scenes."""
    for name in SCENES:
        yield from of_scene(name, STEPS, TOLERANCES, REFERENCE, SIMULATED)


def of_scene(
    name: str, steps: Sequence[float], tolerances: Sequence[float], reference: tuple[float, float], simulated: int
) -> Iterator[Measurement]:
    """Yield a row for every pair of knobs; its size is how many steps cover the time of `simulated` default ones.

    The error is the root mean square of the distance to the reference [spacings].
    """
    document = json.loads(shipped_scenes()[name].read_text())
    simulate(document, 1.0, YarnSettings.tolerance, 2)  # compiles the kernels, untimed
    wanted = simulate(document, *reference, simulated).crossings
    if wanted is None:
        raise RuntimeError(f"the reference run of {name} failed")
    spacing = float(March(document).model.rest_segment.max())
    runs = [simulate(document, step, tolerance, simulated) for step in steps for tolerance in tolerances]
    yield from rows([
        Choice(f"{name}, tolerance {run.tolerance:g}", simulated / run.step, run.seconds,
               None if run.crossings is None else distance(run.crossings, wanted) / spacing,
               default=(run.step, run.tolerance) == (1.0, YarnSettings.tolerance))
        for run in runs
    ])


def simulate(document: dict, step: float, tolerance: float, simulated: int) -> Run:
    """Run a scene for so many default steps with `step` times the default one."""
    default = load_scene(document).step.default
    knobs = document.get("step", {}) | {"default": step * default, "tolerance": tolerance}
    march = March(document | {"step": knobs})
    began = perf_counter()
    try:
        march.reach(simulated * default)
    except StepTooSmall:
        return Run(step, tolerance, perf_counter() - began, None)
    seconds = perf_counter() - began
    return Run(step, tolerance, seconds, march.state.x[march.model.point_kind == PointKind.CROSSING])


def distance(a: Floats, b: Floats) -> float:
    """Return the root mean square of the distances between places a and b [n, 3]."""
    return float(np.sqrt(np.mean(np.sum((a - b) ** 2, axis=1))))
