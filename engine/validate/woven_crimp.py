"""Uniaxial and biaxial stretch of a plain weave, against the equilibrium of the two yarns of its unit cell."""

from dataclasses import dataclass, replace
from math import atan, hypot
from typing import Any

import numpy as np
from scipy.optimize import root

from engine.arrays import Floats
from engine.geometry.handles import Handles
from engine.validate.catalogue import CaseResult, case, timed_rows
from engine.validate.rods import WEIGHTLESS, march, stepper
from engine.yarns.assembly import YarnAssembly, YarnMaterial
from engine.yarns.model import YarnModel, YarnState

WARP = YarnMaterial(radius=0.6e-3, density=1e-3, stretch_stiffness=12.0, bending_stiffness=1e-7, mass_damping=50.0)
WEFT = YarnMaterial(radius=0.8e-3, density=1e-3, stretch_stiffness=20.0, bending_stiffness=2e-7, mass_damping=50.0)
SPACING = (5e-3, 4e-3)  # of the crossings along warps and along wefts, as woven [m]
LOADS = {"uniaxial": None, "biaxial 1:1": 1.0, "biaxial 2:1": 0.5}  # strain of the wefts over that of the warps, or free
STRAINS = (0.01, 0.02, 0.04)  # of the warps, one after the other
DT, RAMP, REST = 0.05, 0.1, 0.4  # time step, time from one strain to the next, and time at rest [s]
STICKING = 1e3  # friction: in the cell no yarn slides
TIGHT: dict[str, Any] = dict(tolerance=1e-2, linear_tolerance=1e-6, friction_factor=10.0)


@dataclass(frozen=True)
class Cell:
    """What a gauge in the middle of a patch measures, or the unit cell has."""

    spacing: tuple[float, float]  # of the crossings along warps and along wefts [m]
    force: tuple[float, float]  # with which each warp and each weft is pulled [N]
    normal_force: float  # with which they press on each other at each crossing [N]

    @property
    def contraction(self) -> float:
        """By how much the wefts became shorter, over by how much the warps became longer."""
        along, across = (now / woven - 1.0 for now, woven in zip(self.spacing, SPACING, strict=True))
        return -across / along


@case("woven-biaxial", bar=0.02, summary="plain weave stretched: force per yarn and contraction against two-yarn equilibrium")
def biaxial(quick: bool) -> CaseResult:
    """Worst relative error of forces and of lateral contraction over loads and strains, against the yarns of a patch."""
    of_load: dict[str, float] = {}

    def error(yarns: float) -> float:
        of_load.clear()
        for load, ratio in LOADS.items():
            of_load[load] = max(_wrong(cell, ratio) for cell in stretched(int(yarns), ratio))
        return max(of_load.values())

    rows = timed_rows("yarns", (4, 6, 8) if quick else (4, 6, 8, 12), error)
    said = ", ".join(f"{load}: {wrong:.1e}" for load, wrong in of_load.items())
    ends = [unit_cell((1.0 + strain) * SPACING[0]) for strain in (STRAINS[0], STRAINS[-1])]
    note = f"over its strain, the patch contracts by {ends[0].contraction:.2f} to {ends[1].contraction:.2f}; {said}"
    return CaseResult(rows, rows[-1].error, note=note)


def _wrong(measured: Cell, ratio: float | None) -> float:
    """Relative error of what a gauge measured, given the spacings that the load prescribes."""
    cell = unit_cell(measured.spacing[0], None if ratio is None else measured.spacing[1])
    pairs = [(measured.force[0], cell.force[0]), (measured.normal_force, cell.normal_force)]
    pairs.append((measured.contraction, cell.contraction) if ratio is None else (measured.force[1], cell.force[1]))
    return max(abs(found / wanted - 1.0) for found, wanted in pairs)


def unit_cell(along: float, across: float | None = None) -> Cell:
    """Return the equilibrium of a warp and a weft whose crossings are `along` and `across` [m] apart; free where None.

    Each rises and falls by its amplitude about its middle plane, from crossing to crossing in straight pieces as long as
    woven, with V = k_s L (l/L - 1)^2 / 2 + k_b theta^2 / (2 L) for each; the amplitudes add up to the sum of the radii.
    """
    height = WARP.radius + WEFT.radius

    def pulls(amplitude: float, across: float) -> tuple[tuple[float, float], tuple[float, float]]:
        return _pull(WARP, SPACING[0], along, amplitude), _pull(WEFT, SPACING[1], across, height - amplitude)

    def unbalanced(q: Floats) -> list[float]:
        """In shares of the height and of the spacing, so that all numbers are of order one."""
        amplitude = height * q[0]
        (_, on_warp), (weft, on_weft) = pulls(amplitude, SPACING[1] * q[1] if across is None else across)
        return [on_warp - on_weft, weft if across is None else q[1] - 1.0]

    found = root(unbalanced, [WARP.radius / height, 1.0], tol=1e-13)
    if np.abs(unbalanced(found.x)).max() > 1e-10:
        raise RuntimeError(f"no equilibrium of the unit cell: {found.message}")
    across = SPACING[1] * found.x[1] if across is None else across
    (warp, press), (weft, _) = pulls(height * found.x[0], across)
    return Cell((along, across), (warp, weft), press)


def _pull(yarn: YarnMaterial, woven: float, spacing: float, amplitude: float) -> tuple[float, float]:
    """Forces dV/dspacing along a crimped yarn, and dV/damplitude with which it presses on each yarn it crosses [N]."""
    rest, length = hypot(woven, 2 * yarn.radius), hypot(spacing, 2 * amplitude)
    tension = yarn.stretch_stiffness * (length / rest - 1.0)
    moment = yarn.bending_stiffness * 2 * atan(2 * amplitude / spacing) / rest
    return (tension * spacing / length - moment * 4 * amplitude / length**2,
            tension * 4 * amplitude / length + moment * 4 * spacing / length**2)


def stretched(yarns: int, ratio: float | None) -> list[Cell]:
    """Return what a gauge between the middle crossings of a patch of `yarns` warps and wefts measures at each strain."""
    model, state = patch(yarns, ratio)
    times, strain = [0.0], [0.0]
    for next_strain in STRAINS:
        times += [times[-1] + RAMP, times[-1] + RAMP + REST]
        strain += [next_strain, next_strain]
    moved = np.zeros((4, len(times), 3))  # bottom, top, left, right
    for end, side in ((0, -0.5), (1, 0.5)):
        moved[end, :, 1] = side * yarns * SPACING[0] * np.array(strain)
        moved[2 + end, :, 0] = side * yarns * SPACING[1] * np.array(strain) * (ratio or 0.0)
    handles = Handles(np.arange(5) * len(times), np.tile(times, 4), moved.reshape(-1, 3))
    cells, read_at = [], [round(time / DT) for time in times[2::2]]
    for step, _ in enumerate(march(stepper(model, WEIGHTLESS, handles, **TIGHT), state, times[-1], DT), 1):
        if step in read_at:
            cells.append(_gauge(state, yarns))
    return cells


def patch(yarns: int, ratio: float | None) -> tuple[YarnModel, YarnState]:
    """Return a plain weave; its first points are its crossings [warp, weft], the next the ends of its warps and wefts.

    Clamps hold ends in the middle plane. They slide sidewards with the patch, so that it stretches alike everywhere.
    """
    assembly = YarnAssembly()
    warps, wefts = (np.array([assembly.yarn(material, yarns * spacing, spacing, fabric=0) for _ in range(yarns)])
                    for material, spacing in ((WARP, SPACING[0]), (WEFT, SPACING[1])))
    i, j = np.divmod(np.arange(yarns**2), yarns)
    u, v = (j + 0.5) * SPACING[0], (i + 0.5) * SPACING[1]
    above = (i + j) % 2 == 0
    assembly.crossings(
        np.where(above, wefts[j], warps[i]), np.where(above, v, u), np.where(above, warps[i], wefts[j]), np.where(above, u, v),
        np.column_stack([v, u, 0.0 * u]), np.array([0.0, 0.0, 1.0]), STICKING, crimp=True)
    k = np.arange(yarns) + 0.5
    held: list[tuple[Any, list[float]]] = []
    for end in (0, 1):
        far = np.full(yarns, end * yarns * SPACING[0])
        held.append((assembly.lagrangians(warps, far, np.column_stack([k * SPACING[1], far, 0.0 * far]), True, end), [1.0, 0, 0]))
    for end in (0, 1):
        far = np.full(yarns, end * yarns * SPACING[1])
        handle, free = (-1, [1.0, 1.0, 0.0]) if ratio is None else (2 + end, [0.0, 1.0, 0.0])
        held.append((assembly.lagrangians(wefts, far, np.column_stack([far, k * SPACING[0], 0.0 * far]), True, handle), free))
    model, state = assembly.build()
    directions = model.free_directions.copy()
    for points, free in held:
        directions[points] = np.diag(free)
    return replace(model, free_directions=directions), state


def _gauge(state: YarnState, yarns: int) -> Cell:
    middle = slice(yarns // 2 - 1, yarns // 2 + 1)  # two of an even number
    x = state.x[: yarns**2].reshape(yarns, yarns, 3)[middle, middle]
    ends = -state.contact_force[yarns**2 :].reshape(4, yarns, 3)[:, middle].mean(axis=1)
    return Cell((float(np.diff(x[:, :, 1], axis=1).mean()), float(np.diff(x[:, :, 0], axis=0).mean())),
                (float(ends[1, 1]), float(ends[3, 0])),
                float(state.normal_force[: yarns**2].reshape(yarns, yarns)[middle, middle].mean()))
