"""A corner of cloth over a table's edge: what segments between crossings and the time step do to it, against finer runs."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from math import cos, pi, sqrt
from time import perf_counter

import numpy as np

from engine.arrays import Floats
from engine.scene.build import build
from engine.scene.load import load_scene
from engine.validate.catalogue import CaseResult, Row, case
from engine.validate.fit import fitted_exponent
from engine.validate.rods import DOWN, stepper
from engine.yarns.model import PointKind, YarnModel, YarnState

YARNS, SPACING = 10, 5.6e-3  # of each family; [m]
ROW = SPACING / sqrt(2.0)  # of crossings, from one to the next across the edge, over which the patch lies with its diagonal [m]
EDGE, CLAMP = 1.5, -5  # rows beyond the middle of the patch: the edge, and the last row that is held
HANGING = (YARNS - 1 - EDGE) * ROW  # from the edge to the outermost crossing, whose place is measured [m]
# the preset cotton-thick with resistance to shear, and damped so that it comes to rest
COTTON = {"radius": 2.25e-3, "volume_density": 770.0, "youngs_modulus": 5e5, "bending_modulus": 1e5, "shear_stiffness": 0.08,
          "mass_damping": 20.0, "stretch_damping": 1e-3}
RAMP = 0.1  # in which its weight comes on: at once, it would start vibrations that the longer steps swallow [s]
PATH = (0.02, 0.04, 0.06, 0.08, 0.1)  # when the place of the moving corner is compared [s]
SETTLED, LONG = 0.8, 8e-3  # time at which it hangs still, and the step to get there [s]
SEGMENTS, STEPS = (1, 2, 3), (4e-3, 2e-3, 1e-3)  # of which the first and the last are a scene's defaults
FINE = 2.5e-4  # step of the finest run [s]


@case("woven-drape", bar=0.02, order=0.9, summary="corner over a table's edge: its place at the default segments and step")
def drape(quick: bool) -> CaseResult:
    """Error of the corner's place over its hanging length at the defaults; the order is that in the step."""
    [finest] = corner(4 if quick else 5, LONG, [SETTLED])
    corner(SEGMENTS[0], STEPS[0], PATH)  # compiles what the rows are timed without
    at_rest, moving = [], []
    for segments in SEGMENTS:
        began = perf_counter()
        error = float(np.linalg.norm(corner(segments, LONG, [SETTLED])[0] - finest)) / HANGING
        at_rest.append(Row("segments per crossing", segments, error, perf_counter() - began))
    # two steps without their common error of first order
    path = 2.0 * corner(SEGMENTS[0], FINE, PATH) - corner(SEGMENTS[0], 2.0 * FINE, PATH)
    for dt in STEPS:
        began = perf_counter()
        error = float(np.linalg.norm(corner(SEGMENTS[0], dt, PATH) - path)) / sqrt(len(PATH)) / HANGING
        moving.append(Row("dt [s]", dt, error, perf_counter() - began))
    order = fitted_exponent(STEPS, [row.error for row in moving])
    failures = []
    if any(finer.error >= row.error for row, finer in pairwise(at_rest)):
        failures.append("more segments do not bring the corner at rest closer to where it belongs")
    note = (f"{1e3 * HANGING:.3g} mm hang over the edge, the corner {-1e3 * finest[2]:.3g} mm below it; at the defaults it is "
            f"off by {at_rest[0].error:.1%} at rest and by {moving[-1].error:.1%} on its way")
    return CaseResult(at_rest + moving, max(at_rest[0].error, moving[-1].error), order, note, failures)


def corner(segments: int, dt: float, times: Sequence[float]) -> Floats:
    """Return the place of the hanging corner about the edge at each of `times` [T], shape [T, 3] [m].

    Raises RuntimeError when a step is rejected.
    """
    model, state = cloth(segments)
    crossings = np.flatnonzero(model.point_kind == PointKind.CROSSING)
    outermost = crossings[np.argmax(state.x[crossings, 0])]
    read_at, places = [round(time / dt) for time in times], []
    for step in _hanging(model, state, dt, read_at[-1]):
        if step in read_at:
            places.append(state.x[outermost].copy())
    return np.array(places)


def _hanging(model: YarnModel, state: YarnState, dt: float, steps: int) -> Iterator[int]:
    """Advance `state` and yield the number of steps after each."""
    for step in range(steps):
        share = min((step + 1) * dt / RAMP, 1.0)
        report = stepper(model, 0.5 * (1.0 - cos(pi * share)) * DOWN).step(state, step * dt, dt)
        if not report.accepted:
            raise RuntimeError(f"step {step} of {dt:.3g} s: {report.reason}, residual {report.residual:.3g}")
        yield step + 1


def cloth(segments: int) -> tuple[YarnModel, YarnState]:
    """Return a square patch whose diagonal lies along an edge, at x = 0 and the height of its yarns.

    Its yarns slide over the edge on points of their own. Nothing else of the table is felt: behind the edge cloth lifts off it,
    up to the rows that are clamped.
    """
    table = {"shape": "box", "size": [0.4, 0.4, 0.1], "position": [-0.2, 0.0, -0.05], "edges": True, "friction": 1.0}
    patch = {"name": "cloth", "material": "cotton", "warps": YARNS, "wefts": YARNS, "spacing": SPACING,
             "segments_per_crossing": segments, "position": [-EDGE * ROW, 0.0, 0.0], "rotation": [0.0, 0.0, 45.0]}
    built = build(load_scene({"strandline": 1, "name": "drape", "duration": 1.0, "materials": {"cotton": COTTON},
                              "fabrics": [patch], "obstacles": [table]}))
    assert built.yarns is not None and built.state is not None
    held = built.state.x[:, 0] < (CLAMP - EDGE + 1e-6) * ROW
    return replace(built.yarns, free_directions=built.yarns.free_directions * ~held[:, None, None]), built.state
