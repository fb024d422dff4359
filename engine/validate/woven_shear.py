"""The picture-frame test: a patch sheared by a frame of its own side lengths, against the summed shear energy."""

from dataclasses import replace
from math import asin, cos, pi, radians, sin
from typing import Any

import numpy as np

from engine.arrays import Floats
from engine.geometry.handles import Handles
from engine.validate.catalogue import CaseResult, case, timed_rows
from engine.validate.rods import WEIGHTLESS, stepper
from engine.yarns.assembly import YarnAssembly, YarnMaterial
from engine.yarns.model import PointKind, YarnModel, YarnState
from engine.yarns.shear import JAMMING

YARNS, SPACING = 6, 5.6e-3  # of each family; [m]
COTTON = YarnMaterial(radius=2.25e-3, density=0.012, stretch_stiffness=8.0, bending_stiffness=2e-6, shear_stiffness=0.08,
                      mass_damping=50.0)
ANGLES = (80.0, 70.0, 60.0, 50.0, 47.0, 44.0, 42.0)  # of the frame, one after the other; the yarns meet at 47.4 [deg]
RATE, REST = 50.0, 0.1  # of the angle between rests, and time at rest [deg/s], [s]
STICKING = 1e3  # friction: yarns that slide gather, and shear more where their segments are short
FINEST = 0.5  # angle that the frame turns between two keyframes: its sides must not shorten by their chords [deg]
TIGHT: dict[str, Any] = dict(tolerance=0.1, linear_tolerance=1e-6, friction_factor=10.0)  # relative to a tension near zero


@case("woven-picture-frame", bar=1e-2, summary="patch sheared in a frame: moment of the frame against the summed shear law")
def picture_frame(quick: bool) -> CaseResult:
    """Worst relative error of the moment at rest over the angles of the frame, before and after the yarns jam."""
    of_angle = {}

    def error(dt: float) -> float:
        measured = frame_moments(dt)
        wanted = np.array([law(radians(angle)) for angle in ANGLES])
        of_angle[dt] = np.abs(measured / wanted - 1.0)
        return float(of_angle[dt].max())

    rows = timed_rows("dt [s]", (0.02, 0.01) if quick else (0.02, 0.01, 0.005), error)
    said = ", ".join(f"{angle:g} deg: {value:.1e}" for angle, value in zip(ANGLES, of_angle[rows[-1].value], strict=True))
    return CaseResult(rows, rows[-1].error, note=f"{YARNS} x {YARNS} yarns; {said}")


def law(phi: float) -> float:
    """dV/dphi of the whole patch by the energy that sec. 4.2 takes from Cirio 2014, and its jamming [N m]."""
    a, jammed = phi - pi / 2, 2.0 * asin(COTTON.radius / SPACING)
    beyond = max(jammed - phi, 0.0)
    return 4 * YARNS**2 * COTTON.shear_stiffness * SPACING * (a - JAMMING * beyond**2)


def frame_moments(dt: float) -> Floats:
    """Moment with which the frame holds the patch at each of ANGLES, in the direction of growing angle [N m]."""
    model, state, sides = patch()
    times, lean, ends = [0.0], [90.0], []
    for angle in ANGLES:
        turned = np.linspace(lean[-1], angle, round((lean[-1] - angle) / FINEST) + 1)[1:]
        times += [*(times[-1] + (lean[-1] - turned) / RATE), times[-1] + (lean[-1] - angle) / RATE + REST]
        lean += [*turned, angle]
        ends.append(round(times[-1] / dt))
    # what lies at Y along the leaning side has moved by Y (e(phi) - e(90 deg))
    moved = np.array([[cos(radians(angle)), sin(radians(angle)) - 1.0, 0.0] for angle in lean])
    handles = Handles(np.arange(len(sides) + 1) * len(times), np.tile(times, len(sides)),
                      np.concatenate([side * moved for side in sides]))
    yarns = stepper(model, WEIGHTLESS, handles, **TIGHT)
    held = np.flatnonzero(model.handle >= 0)
    moments: list[float] = []
    for step in range(ends[-1]):
        report = yarns.step(state, step * dt, dt)
        if not report.accepted:
            raise RuntimeError(f"step {step} of {dt:.3g} s: {report.reason}, residual {report.residual:.3g}")
        if step + 1 == ends[len(moments)]:
            phi = radians(ANGLES[len(moments)])
            turning = np.array([-sin(phi), cos(phi), 0.0])
            moments.append(-np.sum(sides[model.handle[held]] * (state.contact_force[held] @ turning)))
    return np.array(moments)


def patch() -> tuple[YarnModel, YarnState, Floats]:
    """Return a plain weave whose ends a frame holds: one handle for each place along its leaning side, and those places [m].

    It lies between plates: a sheared patch would wrinkle.
    """
    yarns, length = YarnAssembly(), YARNS * SPACING
    place = (np.arange(YARNS) + 0.5) * SPACING
    sides = np.concatenate([[0.0], place, [length]])
    warp, weft = ([yarns.yarn(COTTON, length, SPACING, fabric=0) for _ in range(YARNS)] for _ in range(2))
    for k in range(YARNS):
        for end in (0, 1):
            yarns.lagrangian(warp[k], end * length, np.array([place[k], end * length, 0.0]), True, end * (YARNS + 1))
            yarns.lagrangian(weft[k], end * length, np.array([end * length, place[k], 0.0]), True, 1 + k)
        for j in range(YARNS):
            below, above = (warp[k], place[j]), (weft[j], place[k])
            if (k + j) % 2:
                below, above = above, below
            yarns.crossing(*below, *above, np.array([place[k], place[j], 0.0]), np.array([0.0, 0.0, 1.0]),
                           friction=STICKING, kind=PointKind.CROSSING)
    model, state = yarns.build()
    return replace(model, free_directions=model.free_directions * np.diag([1.0, 1.0, 0.0])), state, sides
