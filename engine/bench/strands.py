"""Strands: seconds per converged step of hair that swings, against the number of strands and of their vertices."""

from collections.abc import Iterator, Sequence
from math import isqrt
from statistics import median
from time import perf_counter

import numpy as np

from engine.bench.suite import Measurement, benchmark
from engine.linalg.banded import WIDTH
from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandAssembly, StrandMaterial
from engine.strands.model import StrandModel, StrandState
from engine.strands.settings import StrandSettings

STEP = 4e-3  # [s]
WARM_UP, TIMED = 5, 5  # steps; the first ones compile
LENGTH, RADIUS = 0.2, 4e-5  # [m]
KERATIN = StrandMaterial(density=1300.0, young=3e9, shear=1e9, damping=1e-3)
GRAVITY = np.array([0.0, 0.0, -9.81])


@benchmark("strands", summary="a step of 4 ms of hair let go from level, without contact")
def strands() -> Iterator[Measurement]:
    """1,000 to 32,000 strands of 16, 32 and 80 vertices."""
    yield from measurements({16: (1_000, 4_000, 16_000, 32_000), 32: (1_000, 8_000), 80: (1_000, 8_000)})


def measurements(sizes: dict[int, Sequence[int]]) -> Iterator[Measurement]:
    """Yield a row for every number of strands, by their vertices."""
    for vertices, counts in sizes.items():
        for count in counts:
            yield of_hair(count, vertices)


def of_hair(count: int, vertices: int) -> Measurement:
    """Return the median time of a step, with the iterations of a strand and how many of them are done in a second."""
    model, state = hair(count, vertices)
    stepper = StrandStepper(model, GRAVITY, StrandSettings(contact="none"))
    seconds, reports, directions = [], [], []
    for _ in range(WARM_UP + TIMED):
        began = perf_counter()
        reports.append(stepper.step(state, STEP))
        seconds.append(perf_counter() - began)
        directions.append(int(stepper.iterations.sum()))
        if not reports[-1].accepted:
            raise RuntimeError(f"a step was rejected: {reports[-1].reason}")
    wanted, solved = median(seconds[WARM_UP:]), sum(directions[WARM_UP:]) / sum(seconds[WARM_UP:])
    multiplications = 4 * vertices * WIDTH * (WIDTH + 1) / 2  # of a factorisation
    return Measurement(
        f"strands of {vertices} vertices", count, wanted, "strands", error=max(report.residual for report in reports[WARM_UP:]),
        details={"newton": sum(directions[WARM_UP:]) / (TIMED * count), "directions_per_s": solved,
                 "factor_gflops": 2e-9 * multiplications * solved},
    )


def hair(count: int, vertices: int) -> tuple[StrandModel, StrandState]:
    """Return so many wavy strands on a square grid, level, clamped at one end."""
    rng = np.random.default_rng(count)
    held = np.zeros((vertices, 4), np.bool_)
    held[:2, :3] = held[0, 3] = True
    along = np.linspace(0.0, LENGTH, vertices)
    assembly, side = StrandAssembly(), isqrt(count)
    for k in range(count):
        phase, waves = rng.uniform(0, 2 * np.pi), rng.uniform(20, 60)
        wave = 2e-3 * np.array([np.cos(phase + waves * along), np.sin(phase + waves * along)])
        across, up = 1e-3 * (k // side) + wave[0], 1e-3 * (k % side) + wave[1]
        assembly.strand(np.column_stack([along, across, up]), RADIUS, KERATIN, held=held)
    return assembly.build()
