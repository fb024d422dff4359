"""What the cases of liquids share: boxes of liquid on a lattice, planes around them, and steps."""

from collections.abc import Callable, Sequence
from math import inf
from time import perf_counter

import numpy as np

from engine.arrays import Floats
from engine.geometry.solids import Solids
from engine.liquid.model import LiquidModel, LiquidState
from engine.liquid.settings import LiquidSettings
from engine.scene.liquid import LiquidBox, Wave
from engine.scene.liquid_materials import LiquidMaterial, liquid_constants
from engine.scene.liquid_seeding import frame, seeded
from engine.steppers.liquid import LiquidStepper
from engine.steppers.step_report import StepReport
from engine.validate.catalogue import Row

Side = tuple[Floats, Floats]  # of a plane: a place on it [m], and its normal, which points to the liquid

EARTH = 9.81  # gravity [m/s^2]
PER_SIDE = 2  # particles along each side of a cell
SEED = 5  # of jitter
LEAST_STEP = 1.0 / 64.0  # of the step that was asked for, below which a run has failed
FLOOR: Side = (np.zeros(3), np.array([0.0, 0.0, 1.0]))


def liquid(material: LiquidMaterial, spacing: float, period: Sequence[int] = (0, 0, 0), no_slip: bool = False) -> LiquidModel:
    """Return a material on a grid of `spacing` [m] from the origin on, that repeats after `period` [cells] and has no end."""
    return LiquidModel(
        *liquid_constants(material), spacing=spacing, origin=np.zeros(3), period=np.array(period, np.int64), no_slip=no_slip,
        low=np.full(3, -inf), high=np.full(3, inf),
    )


def box(model: LiquidModel, size: Sequence[float], jitter: float = 0.0, wave: Wave | None = None) -> LiquidState:
    """Return liquid at rest in a box of `size` [3] [m] from the origin on, 8 particles in a cell.

    They lie off a lattice at random by up to `jitter` halves of its pitch; `wave` is that of the top.
    """
    low, high = (0.0, 0.0, 0.0), (size[0], size[1], size[2])
    shape = LiquidBox(shape="box", low=low, high=high, wave=wave)
    x, volume = seeded(shape, model.spacing / PER_SIDE, jitter, np.random.default_rng(SEED))
    count = len(x)
    return LiquidState(
        x=x, velocity=np.zeros((count, 3)), affine=np.zeros((count, 3, 3)), volume=volume,
        strain=np.tile([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], (count, 1)) if model.elastic else None,
        compression=None if model.incompressible else np.ones(count),
        plastic_strain=np.zeros(count) if model.elastic else None, emitted=np.zeros(0, np.int64), drained=np.zeros(1),
    )


def planes(*sides: Side) -> Solids:
    """Return planes as solids."""
    count = len(sides)
    return Solids(
        kind=np.zeros(count, np.int64), centre=np.array([place for place, _ in sides]).reshape(-1, 3),
        rotation=np.array([frame(normal) for _, normal in sides]).reshape(-1, 3, 3), size=np.zeros((count, 3)),
        lattice=np.zeros((count, 4), np.int64), samples=np.zeros(0),
    )


def ends(length: float, axis: int = 0) -> tuple[Side, Side]:
    """Return walls across an axis at 0 and at a `length` [m]."""
    normal = np.eye(3)[axis]
    return (0.0 * normal, normal), (length * normal, -normal)


class Vessel:
    """A liquid between planes that stand still."""

    def __init__(self, model: LiquidModel, state: LiquidState, gravity: Sequence[float], walls: Solids,
                 settings: LiquidSettings | None = None):
        """Take a state as it is at the start; `gravity` [3] in m/s^2."""
        self.model, self.state, self.walls = model, state, walls
        self.stepper = LiquidStepper(model, np.array(gravity), settings)

    def step(self, h: float) -> StepReport:
        """Advance by `h` [s]. Raises RuntimeError where the stepper refuses."""
        report = self.stepper.step(self.state, h, self.walls, self.walls)
        if not report.accepted:
            raise RuntimeError(report.reason)
        return report

    def reach(self, h: float) -> None:
        """Advance by `h` [s] in steps as short as the stepper asks for. Raises RuntimeError where none is short enough."""
        left, part = h, h
        while left > 1e-9 * h:
            part = min(part, left)
            if self.stepper.step(self.state, part, self.walls, self.walls).accepted:
                left -= part
            elif part > LEAST_STEP * h:
                part *= 0.5
            else:
                raise RuntimeError(f"no step down to {part:.2g} s is accepted")

    def volume(self) -> float:
        """Return the volume that the liquid takes up [m^3]."""
        return self.stepper.volume(self.state, self.walls, self.walls)


def rows(knob: str, values: Sequence[float], error: Callable[[float], float]) -> list[Row]:
    """Return a row for each of the knob's values; runs are long, so it is short ones before that have to compile the kernels."""
    found = []
    for value in values:
        began = perf_counter()
        off = error(value)
        found.append(Row(knob, value, off, perf_counter() - began))
    return found
