"""What the cases of strands share: rods to measure on, rest under loads, stiffness of a shape."""

import numpy as np
from scipy.linalg import eigvals_banded

from engine.arrays import Flags, Floats
from engine.linalg.banded import WIDTH
from engine.steppers.strands import StrandStepper
from engine.strands import potential
from engine.strands.assembly import StrandAssembly, StrandMaterial
from engine.strands.backward_difference import implicit_euler
from engine.strands.loads import StrandLoads, inertia
from engine.strands.model import StrandModel, StrandState
from engine.strands.settings import StrandSettings

EARTH = 9.81  # gravity [m/s^2]
FOREVER = 1e6  # step after which inertia is forgotten [s]
AT_REST = 1e-9  # of a strand's length: no vertex moves by more in such a step


def cantilever(segments: int, length: float, radius: Floats | float, material: StrandMaterial) -> tuple[StrandModel, StrandState]:
    """Return a straight strand along x with m1 along z, clamped in the middle of its first edge, which is at the origin.

    The vertices of that edge are held, and its turn; `length` [m] is of what is free, of so many segments and half of one.
    """
    segment = length / (segments + 0.5)
    x = segment * (np.arange(segments + 2) - 0.5)
    held = np.zeros((len(x), 4), np.bool_)
    held[:2, :3] = held[0, 3] = True
    assembly = StrandAssembly()
    assembly.strand(np.column_stack([x, 0 * x, 0 * x]), radius, material, normal=np.array([0.0, 0.0, 1.0]), held=held)
    return assembly.build()


def settle(model: StrandModel, state: StrandState, gravity: Floats, loads: StrandLoads | None = None) -> None:
    """Bring a state to rest under its loads, in place. Raises RuntimeError where it does not come to rest."""
    stepper = StrandStepper(model, gravity, StrandSettings(tolerance=1e-7, max_newton=500, contact="none"))
    for _ in range(20):
        state.velocity[:] = state.spin[:] = 0.0
        before = state.x.copy()
        report = stepper.step(state, FOREVER, loads)
        if not report.accepted:
            raise RuntimeError(f"{report.reason}, residual {report.residual:.3g}")
        if np.abs(state.x - before).max() < AT_REST * model.rest_length.sum():
            return
    raise RuntimeError("the strand did not come to rest")


def stiffness(model: StrandModel, state: StrandState) -> Floats:
    """Return the Hessian of the elastic energy of a single strand, held unknowns as identity, as `banded` has it [4V, 11]."""
    vertices = len(state.x)
    step, now, base = potential.step_of(vertices), potential.geometry(vertices), potential.geometry(vertices)
    band = np.empty((4 * vertices, WIDTH + 1))
    at_rest = inertia(model, state, StrandLoads(), np.zeros(3), implicit_euler(model, FOREVER))
    potential.begin(model, at_rest, 0, state.x, state.m1, state.twist, step, now, base)
    potential.hessian(now, step, FOREVER, False, np.empty((12, 8)), band)
    return band


def least_stiffness(model: StrandModel, state: StrandState, which: Flags | None = None) -> float:
    """Return the lowest eigenvalue of the stiffness, of the unknowns `which` [V, 4] only where given.

    Its sign says whether the shape is stable; its size has no meaning, for the unknowns are lengths and angles.
    """
    band = stiffness(model, state)
    lower = band.T.copy()
    if which is not None:
        for row in np.flatnonzero(~which.reshape(-1)):
            lower[:, row] = 0.0
            before = np.arange(1, min(int(row), len(lower) - 1) + 1)
            lower[before, row - before] = 0.0
            lower[0, row] = band[:, 0].max()
    return float(eigvals_banded(lower, lower=True, select="i", select_range=(0, 0))[0])
