"""Yarns: seconds per step and memory of stacks of denim and of patches against their size, and until the first frame."""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import isqrt
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np
from numba.core import event

import engine
from engine.bench.suite import Measurement, benchmark, median_seconds
from engine.contact.obstacles import motion
from engine.linalg.block_matrix import BLOCK
from engine.run.memory import ProgramMemory, memory_peak
from engine.run.threads import threads_for
from engine.scene.build import Built, build
from engine.scene.load import load_scene
from engine.steppers.incremental_potential import IncrementalPotential
from engine.steppers.newton_system import NewtonSystem
from engine.steppers.step_report import StepReport, Stopwatch
from engine.steppers.yarns import YarnStepper
from engine.yarns import observe
from engine.yarns.model import PointKind, YarnModel

STEP = 1e-3  # [s]
WARM_UP = 10  # steps from rest that are not timed; they compile the kernels as well
TIMED = 10  # steps
SPACING = 5.6e-3
FEW = 2  # steps that are timed of stacks of denim, the largest of which take a minute each
STAGES = ("assign", "assemble", "pieces", "factor", "solve", "line_search", "commit")
ENTRY = 8  # bytes of an index, or of a number of a vector

FIRST_FRAME = """
import sys
from engine.run.compile_cache import prepare_compile_cache
prepare_compile_cache()
from pathlib import Path
from engine.run.compile_ahead import compile_ahead
from engine.run.simulation import run
from engine.scene.load import load_scene, shipped_scenes
scene = load_scene(shipped_scenes()["quickstart"])
compile_ahead(scene)
run(scene, Path(sys.argv[1]), until=1 / scene.fps, on_frame=lambda frame: print(frame.index, flush=True))
"""


@benchmark("yarns", summary="a step of 1 ms of cloth hung by two corners, and of a stack; time to the first frame")
def yarns() -> Iterator[Measurement]:
    """Two layers of denim up to the jeans pocket's size, patches, a stack, the linear solve, the first frame."""
    yield from scaling(points=(10_000, 40_000, 160_000, 645_000))
    yield from measurements(patches=(1_000, 10_000, 100_000), stack=5_000, system=10_000)
    yield from first_frames()


@benchmark("yarns-small", summary="as yarns, with patches of up to 1,000 crossings and without compilation")
def yarns_small() -> Iterator[Measurement]:
    """What takes seconds."""
    yield from measurements(patches=(250, 500, 1_000), stack=500, system=1_000)


def measurements(patches: Sequence[int], stack: int, system: int) -> Iterator[Measurement]:
    """Yield the rows for patches, for a stack of two layers and for a linear system, all of about these crossings."""
    for crossings in patches:
        yield of_steps("patch", hung_by_two_corners(crossings))
    yield of_steps("stack of two", stacked(stack))
    yield from against_peer(system)


def scaling(points: Sequence[int]) -> Iterator[Measurement]:
    """Yield the rows of two layers of denim of about so many `points`, which ascend: memory is that of the largest yet."""
    program = ProgramMemory()
    with event.install_listener(ProgramMemory.EVENT, program):
        for count in points:
            yield of_denim(count, program)


def of_denim(points: int, program: ProgramMemory) -> Measurement:
    """Return the median time of a step from rest, after the first one; no memory where earlier work held as much."""
    earlier = memory_peak()
    steps = Steps(denim(points))
    steps.take(1)
    timed = steps.take(FEW)
    reports = [report for _, report in timed]
    details = {name: sum(getattr(report, f"{name}_iterations") for report in reports) / FEW for name in ("newton", "linear")}
    if (peak := memory_peak()) > earlier:
        details["bytes_per_point"] = (peak - program.bytes) / steps.model.point_count
    return Measurement(
        "two layers of denim", steps.model.point_count, median(seconds for seconds, _ in timed), "points",
        error=max(report.residual for report in reports), details=details,
    )


@dataclass
class Steps:
    """Accepted steps one after the other, and how long each took."""

    built: Built
    time: float = 0.0

    def __post_init__(self) -> None:
        b = self.built
        assert b.yarns is not None and b.state is not None
        self.model, self.state = b.yarns, b.state
        self.stepper = YarnStepper(b.yarns, b.settings, b.gravity, b.obstacles, b.handles, b.collisions)

    def take(self, count: int) -> list[tuple[float, StepReport]]:
        """Return seconds and report of `count` steps; raises RuntimeError where one is rejected."""
        taken = []
        for _ in range(count):
            began = perf_counter()
            with threads_for(self.model.node_count):
                report = self.stepper.step(self.state, self.time, STEP)
            taken.append((perf_counter() - began, report))
            if not report.accepted:
                raise RuntimeError(f"the step at {self.time:g} s was rejected: {report.reason}")
            self.time += STEP
        return taken

    def system(self) -> tuple[NewtonSystem, IncrementalPotential]:
        """Return the linear system of the next step, without its values."""
        chain = observe.chain_now(self.model, self.state)
        obstacles = motion(self.built.obstacles, self.built.handles, self.time, STEP)
        potential = IncrementalPotential(self.model, self.built.settings, self.built.gravity, obstacles, self.state, chain,
                                         STEP)
        return NewtonSystem(potential, self.built.settings, Stopwatch()), potential


def of_steps(case: str, built: Built) -> Measurement:
    """Return the median time of a step once the motion has begun; the error is the largest residual force."""
    steps = Steps(built)
    steps.take(WARM_UP)
    timed = steps.take(TIMED)
    reports = [report for _, report in timed]
    newton = sum(report.newton_iterations for report in reports) / TIMED
    linear = sum(report.linear_iterations for report in reports) / TIMED
    per_newton, per_linear = traffic(steps.system()[0])
    counts = observe.counts(steps.model, steps.state)
    return Measurement(
        case, crossings_of(steps.model), median(seconds for seconds, _ in timed), "crossings",
        bytes_moved=newton * per_newton + linear * per_linear,
        error=max(report.residual for report in reports),
        details={
            "newton": newton, "cg_per_newton": linear / newton if newton else 0.0,
            "bytes_per_newton": per_newton + (linear / newton * per_linear if newton else 0.0),
            "eil_share": counts["eil"] / float(np.sum(steps.state.active)),
            **{f"{stage}_s": sum(report.stages.get(stage, 0.0) for report in reports) / TIMED for stage in STAGES},
        },
    )


def traffic(system: NewtonSystem) -> tuple[float, float]:
    """Return the bytes that must pass for one Newton iteration without its linear solve, and for one of that solve.

    Assembly clears and fills the matrix, factorisation reads its lower half and writes the factor. An iteration of
    conjugate gradients reads the matrix once and the factor twice, and passes over 14 vectors.
    """
    matrix = system.layout.matrix
    block = BLOCK * BLOCK * matrix.block.itemsize + ENTRY  # a block and its column
    rows, blocks, lower = matrix.rows, len(matrix.column), len(system.factor.lower)
    per_newton = 2 * blocks * block + 2 * (lower + rows) * block
    return per_newton, (blocks + 2 * (lower + rows)) * block + 14 * rows * BLOCK * ENTRY


def against_peer(crossings: int) -> Iterator[Measurement]:
    """Yield the time to factorise and solve a system as it arises, and that of smoothed aggregation.

    Both start from the assembled matrix and end at the same relative residual. Without pyamg there is no such row.
    """
    try:
        import pyamg
    except ImportError:
        return
    from scipy.sparse import bsr_array

    steps = Steps(hung_by_two_corners(crossings))
    steps.take(WARM_UP)
    system, potential = steps.system()
    system.settings = replace(system.settings, linear_tolerance=1e-8)
    x, u = steps.state.x, steps.state.u
    _, gradient = potential.gradient(x, u)
    samples = []
    for _ in range(3):
        system.watch.laps.clear()
        system.forget_factor()  # that of the sample before
        direction, iterations = system.direction(x, u, gradient, goal=0.0)
        samples.append(system.watch.laps["factor"] + system.watch.laps["solve"])
    matrix, point = system.layout.matrix, system.layout.point  # a patch has no contacts that would be condensed
    a = bsr_array((matrix.block.astype(np.float64), matrix.column, matrix.start))  # the same numbers: the peer needs double
    b = -gradient[point].ravel()
    residual = float(np.linalg.norm(b - a @ direction[point].ravel()) / np.linalg.norm(b))

    peer_residuals: list[float] = []

    def peer() -> None:
        peer_residuals.clear()
        solver = pyamg.smoothed_aggregation_solver(a)
        solver.solve(b, tol=residual, accel="cg", maxiter=1000, residuals=peer_residuals)

    peer_seconds = median_seconds(peer, repeats=3)
    yield Measurement(
        "linear system", crossings_of(steps.model), median(samples), "crossings", peer="pyamg smoothed aggregation",
        peer_seconds=peer_seconds, error=residual,
        details={"cg": iterations, "peer_cg": len(peer_residuals) - 1,
                 "peer_error": float(peer_residuals[-1] / np.linalg.norm(b))},
    )


def first_frames() -> Iterator[Measurement]:
    """Yield the time from the start of a process to the first simulated frame of the quick start scene.

    Once from an empty compile cache, once more from the cache that this left.
    """
    with TemporaryDirectory() as cache:
        for case in ("first frame, nothing compiled", "first frame, warm"):
            picture, frame = first_frame(Path(cache))
            yield Measurement(case, 1, frame, "frames", details={"initial_state_s": picture})


def first_frame(cache: Path) -> tuple[float, float]:
    """Return the seconds to the frame of the initial state and to the first simulated one, in a process of its own.

    `cache` is the directory of compile caches. Raises subprocess.CalledProcessError when the run fails.
    """
    environment = dict(os.environ, STRANDLINE_CACHE_DIR=str(cache), PYTHONPATH=str(Path(engine.__path__[0]).parent))
    environment.pop("NUMBA_CACHE_DIR", None)  # which this process has set for itself
    with TemporaryDirectory() as job:
        began = perf_counter()
        command = [sys.executable, "-c", FIRST_FRAME, str(Path(job) / "job")]
        with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            told = [perf_counter() - began for _ in process.stdout]
        if process.returncode != 0:
            raise subprocess.CalledProcessError(process.returncode, command[:1])
    return told[0], told[1]


def crossings_of(model: YarnModel) -> int:
    """Return how many places there are where two yarns meet."""
    return int(np.sum(model.point_kind != PointKind.LAGRANGIAN))


def hung_by_two_corners(crossings: int) -> Built:
    """Return a level patch of about so many crossings that is held at two neighbouring corners, and falls."""
    side = isqrt(crossings)
    built = _build([_cloth("cloth", side) | {"pins": "corners"}], [])
    assert built.yarns is not None and built.state is not None
    let_go = (built.state.x[:, 1] < 0.0) & (built.yarns.point_kind == PointKind.LAGRANGIAN)
    free = built.yarns.free_directions.copy()
    free[let_go] = np.eye(3)
    return replace(built, yarns=replace(built.yarns, free_directions=free))


def stacked(crossings: int) -> Built:
    """Return a patch held at its corners with another lying on it, at 20 degrees and off its weave."""
    side = isqrt(crossings // 4)  # there are about as many contacts between the layers as crossings in them
    lower, upper = _cloth("lower", side), _cloth("upper", side)
    return _build(
        [lower | {"pins": "corners"}, upper | {"rotation": [0, 0, 20], "position": [0.3 * SPACING, 0.2 * SPACING, 0]}],
        [{"lower": "lower", "upper": "upper", "friction": 0.3}],
    )


def denim(points: int) -> Built:
    """Return a patch of denim held at its edges, with one lying on it as the jeans pocket does, of about so many points."""
    side = isqrt(points // 4)
    cloth = {"material": "denim", "pattern": "denim", "warps": side, "wefts": side, "yarns_per_inch": 44}
    return _build(
        [cloth | {"name": "lower", "pins": "edges"}, cloth | {"name": "upper", "position": [0.0001732, -0.0001155, 0]}],
        [{"lower": "lower", "upper": "upper", "friction": 0.5}],
    )


def _cloth(name: str, side: int) -> dict:
    return {"name": name, "material": "cotton-thick", "warps": side, "wefts": side, "spacing": SPACING}


def _build(fabrics: list[dict], contacts: list[dict]) -> Built:
    return build(load_scene({
        "strandline": 1, "name": "bench", "duration": 1.0, "step": {"default": STEP}, "fabrics": fabrics,
        "contacts": contacts,
    }))
