"""What the time loop asks of whatever a scene simulates."""

from typing import TYPE_CHECKING, Protocol

from numpy.typing import NDArray

from engine.run.frames import Components
from engine.run.statistics import Invariants

if TYPE_CHECKING:  # kernels are imported only for the components that a scene has
    from engine.scene.schema import Scene
    from engine.steppers.step_report import StepReport


class Simulated(Protocol):
    """A scene in motion."""

    report_keys: set[str]  # optional keys of the report that make sense for it
    nodes: int  # that memory is held for, in use or not; one where yarns touch
    varying: frozenset[str]  # arrays whose number of rows, the same for all, changes from step to step

    def step(self, time: float, h: float) -> "StepReport":
        """Try to advance from `time` by `h` [s]; the state is as before when the report says rejected."""

    def arrays(self) -> dict[str, NDArray]:
        """Return all state by name, not copied."""

    def restore(self, arrays: dict[str, NDArray]) -> None:
        """Replace all state by arrays as `arrays` gives them."""

    def counts(self) -> dict[str, int]:
        """Return how many nodes of each kind there are."""

    def energies(self) -> dict[str, float]:
        """Return `kinetic` and `potential` energy [J]."""

    def invariants(self, time: float, energies: dict[str, float]) -> Invariants:
        """Return what the exact motion from time 0 to `time` [s] would have kept; `energies` are the present ones."""

    def components(self) -> Components:
        """Return what is simulated as it is drawn."""

    def half_step_errors(self, before: dict[str, NDArray], time: float, h: float) -> dict[str, float] | None:
        """Return by field how far the state is from two half steps taken from `before`; None where one is rejected."""


def assemble(scene: "Scene") -> Simulated:
    """Return what `scene` simulates, at its initial state."""
    if scene.strands:
        from engine.run.strands import StrandsInMotion

        return StrandsInMotion(scene)
    if scene.liquid is not None:
        from engine.run.liquid import LiquidInMotion

        return LiquidInMotion(scene)
    from engine.run.yarns import YarnsInMotion

    return YarnsInMotion(scene)
