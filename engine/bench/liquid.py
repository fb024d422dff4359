"""Liquid: particle-steps per second of a step and its parts against the number of particles."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import is_dataclass
from functools import partial
from statistics import median
from time import perf_counter

import numba
import numpy as np

from engine.arrays import Floats
from engine.bench import peer_mpm
from engine.bench.suite import Measurement, Note, benchmark, median_seconds
from engine.contact.obstacles import motion
from engine.geometry.solids import Solids
from engine.liquid import evolve
from engine.liquid.grid import Grid, sorted_grid, taken
from engine.liquid.model import LiquidModel, LiquidState
from engine.liquid.shear import add_elastic_impulse, add_tangent_impulse
from engine.liquid.transfer import to_grid, to_particles
from engine.scene.build import build
from engine.scene.load import load_scene
from engine.steppers.liquid import LiquidStepper
from engine.steppers.step_report import StepReport, Stopwatch

SPACING = 5e-3  # of cells [m]
PER_CELL = 8
SPEED = 1.0  # of the block at the start [m/s]
COURANT = 0.6
WARM_UP, TIMED = 3, 3  # steps; the first ones compile and let the block go out of its lattice
TRANSFERS = 5
STAGES = {"water": ("pressure",), "milk-cream": ("shear", "pressure")}


@benchmark("liquid", summary="blocks of water and of milk cream that slide over a floor, at a Courant number of 0.6")
def liquid() -> Iterator[Measurement | Note]:
    """0.1 to 3 million particles: steps, shear, pressure, transfers beside a peer, one product of the shear solve."""
    yield from measurements((100_000, 300_000, 1_000_000, 3_000_000))


@benchmark("liquid-small", summary="as liquid, with 30,000 and 100,000 particles")
def liquid_small() -> Iterator[Measurement | Note]:
    """What takes seconds."""
    yield from measurements((30_000, 100_000))


def measurements(counts: Sequence[int]) -> Iterator[Measurement | Note]:
    """Yield the rows of blocks of about so many particles."""
    for count in counts:
        for material in STAGES:
            yield from of_block(material, count)
    if not peer_mpm.installed():
        yield Note(f"{peer_mpm.NAME} is not installed")


def of_block(material: str, particles: int) -> Iterator[Measurement]:
    """Yield a block's rows."""
    block = Block(material, particles)
    count, model, state = len(block.state.x), block.model, block.state
    block.take(WARM_UP)
    seconds, reports = zip(*block.take(TIMED), strict=True)
    measured = partial(Measurement, size=count, unit="particles")
    stages = {stage: median(report.stages[stage] for report in reports) for stage in reports[0].stages}
    error = max(report.residual for report in reports)
    iterations = {"newton": sum(report.newton_iterations for report in reports) / TIMED,
                  "linear": sum(report.linear_iterations for report in reports) / TIMED}
    memory = {"state_bytes": bytes_of(state) / count,
              "grid_bytes": bytes_of((block.stepper.flow, block.stepper.wet)) / count}
    yield measured(f"{material}, step", seconds=median(seconds), error=error,
                   details={f"{stage.replace(' ', '_')}_s": spent for stage, spent in stages.items()} | iterations | memory)
    for stage in STAGES[material]:
        yield measured(f"{material}, {stage}", seconds=stages[stage], error=error, details=iterations)
    if model.elastic:
        product, moved = shear_product(model, state)
        yield measured(f"{material}, one product of shear", seconds=median_seconds(product), bytes_moved=moved)
        return
    parts, moved = transfers(model, state)
    details = {f"{part}_s": spent for part, spent in parts.items()}
    peer_seconds = None
    if peer_mpm.installed():
        peer_seconds, details["peer_double_s"] = (
            peer_mpm.seconds_of_step(state.x, SPEED, SPACING, model.density, bits, numba.get_num_threads()) for bits in (32, 64)
        )
    yield measured(f"{material}, transfers", seconds=sum(parts.values()), bytes_moved=moved, details=details,
                   peer=None if peer_seconds is None else f"{peer_mpm.NAME}, single precision", peer_seconds=peer_seconds)


class Block:
    """A cube of liquid in the middle of a long tank, and its stepper."""

    def __init__(self, material: str, particles: int):
        """Build the scene with about so many particles."""
        side = SPACING * round((particles / PER_CELL) ** (1 / 3))
        built = build(load_scene({
            "strandline": 1, "name": "bench", "duration": 1.0,
            "liquid": {
                "material": material, "spacing": SPACING, "particles_per_cell": PER_CELL,
                "tank": {"low": [0, 0, 0], "high": [4 * side, side, 2 * side]},
                "initial": [{"shape": "box", "low": [side, 0, 0], "high": [2 * side, side, side], "velocity": [SPEED, 0, 0]}],
            },
        }))
        assert built.liquid is not None and built.liquid_state is not None and built.liquid_obstacles is not None
        self.model, self.state = built.liquid, built.liquid_state
        self.stepper = LiquidStepper(self.model, np.array(built.gravity), built.liquid_settings)
        self.solids: Solids = motion(built.liquid_obstacles, built.handles, 0.0, 1.0).end

    def take(self, steps: int) -> list[tuple[float, StepReport]]:
        """Take steps of the Courant number; returns seconds and report of each. Raises RuntimeError if one is rejected."""
        done = []
        for _ in range(steps):
            began = perf_counter()
            report = self.stepper.step(self.state, step_of(self.state), self.solids, self.solids)
            done.append((perf_counter() - began, report))
            if not report.accepted:
                raise RuntimeError(f"a step was rejected: {report.reason}")
        return done


def step_of(state: LiquidState) -> float:
    """Return the step [s] in which the fastest particle crosses COURANT cells."""
    return COURANT * SPACING / float(np.abs(state.velocity).max())


def bytes_of(thing: object) -> int:
    """Return the bytes of all arrays in dataclasses, tuples and lists, each of them once."""
    arrays: dict[int, int] = {}

    def count(part: object) -> None:
        if isinstance(part, np.ndarray):
            arrays[id(part)] = part.nbytes
        elif isinstance(part, tuple | list):
            for one in part:
                count(one)
        elif is_dataclass(part):
            count(list(vars(part).values()))

    count(thing)
    return sum(arrays.values())


def transfers(model: LiquidModel, state: LiquidState) -> tuple[dict[str, float], float]:
    """Return the median seconds of the parts of an explicit step without stress, and the bytes that it moves.

    It is what the peer's step does: particles are sorted, mapped to the grid and back, and moved, in `state` itself.
    """
    h, watches = step_of(state), []
    for _ in range(1 + TRANSFERS):
        watch = Stopwatch()
        grid = _sort(model, state)
        watch.lap("sort")
        mass, u, filled = _to_grid(grid, model, state)
        watch.lap("to_grid")
        np.divide(u, mass, out=u, where=mass > 0.0)
        watch.lap("on_grid")
        to_particles(grid, state.x, u, state.velocity, state.affine)
        evolve.move(state.x, state.velocity, h)
        watch.lap("to_particles")
        watches.append(watch.laps)
    moved = 4 * bytes_of(state) + 3 * bytes_of((mass, u, filled))  # sorted, read and written; the grid is set to zero as well
    return {part: median(laps[part] for laps in watches[1:]) for part in watches[0]}, moved


def shear_product(model: LiquidModel, state: LiquidState) -> tuple[Callable[[], None], float]:
    """Return what multiplies a change of u by the matrix of the shear solve once, and the bytes that it moves."""
    grid = _sort(model, state)
    mass, u, _ = _to_grid(grid, model, state)
    np.divide(u, mass, out=u, where=mass > 0.0)
    force, tangent = grid.faces(), np.empty((len(state.x), 8), np.float32)
    add_elastic_impulse(grid, state.x, state.volume, state.strain, u, step_of(state), model.shear_modulus,
                        np.sqrt(2.0 / 3.0) * model.yield_stress, model.consistency, model.flow_index, True, force, tangent)
    return lambda: add_tangent_impulse(grid, state.x, tangent, u, force), bytes_of((state.x, tangent, u)) + 2 * bytes_of(force)


def _sort(model: LiquidModel, state: LiquidState) -> Grid:
    grid, order = sorted_grid(model, state.x)
    for name, values in vars(state).items():
        if values is not None and len(values) == len(order):
            setattr(state, name, taken(values, order))
    return grid


def _to_grid(grid: Grid, model: LiquidModel, state: LiquidState) -> tuple[Floats, Floats, Floats]:
    """Mass and momentum of faces [3, B, 64], and what is filled of cells [B, 64]."""
    mass, momentum, filled = grid.faces(), grid.faces(), grid.cells()
    to_grid(grid, state.x, state.velocity, state.affine, state.volume, model.density, 0.0, 0.0, np.zeros((0, 6)), mass, momentum,
            filled)
    return mass, momentum, filled
